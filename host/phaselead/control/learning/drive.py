"""Trials along the paths of one learning: driven, judged, listed, and the best of them kept."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning.law import Step
from phaselead.control.learning.learned import Learned, LearnedPath, Trial, one_period
from phaselead.control.learning.lines import Amplitudes, error_lines, rest_of, values_of
from phaselead.control.learning.look import SETTLE_S, Look, line_count, trial_seconds
from phaselead.control.learning.moved_modes import Moved, moved_modes, stage_with_modes_at
from phaselead.control.learning.response import turns_of
from phaselead.control.rehearsal import OnRehearsed, rehearse
from phaselead.control.run import Run
from phaselead.control.run_away import tell_of
from phaselead.control.tracking import check_paths, run_recording, track
from phaselead.control.true_position import Follows, followed
from phaselead.device import TICK_HZ, Device, DeviceFault
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage
from phaselead.waveforms import Replaced, Waveform

LARGEST_CORRECTION = 2.0
"""Of the swing. A path at the mode of a model that has it 10 % off takes 1.7; what is further off is another stage."""
AT_LIMIT = 0.995
"""Of the slew limit: a code of the converter is 0.2 % of the usual one, a tick long."""


class TooLarge(BadInput):
    """A correction that the reference cannot take."""


class RefusedOnModel(BadInput):
    """A trial that ends badly there, so that it was not driven."""


@dataclass(frozen=True)
class Given:
    """What is learned, on what, and by which rules."""

    device: Device
    wanted: dict[str, Waveform]
    mode: str
    stage: Stage | None
    known: Stage
    """The same, or what the device holds."""
    sha256: str
    gains: dict[str, Gains]
    """Empty without feedback."""
    gains_chosen: bool
    """By somebody, so that they stay."""
    follows: Follows
    force: bool
    kept: KeptRuns
    on_rehearsed: OnRehearsed | None = None
    """Is given what the model says of the path before anything is learned."""


class Drive:
    """Drives the trials, with the inverse of the model whose modes it was last told."""

    def __init__(self, given: Given) -> None:
        self.given, self.wanted, self.known, self.stage = given, given.wanted, given.known, given.stage
        self.modes = dict.fromkeys(given.wanted, 1.0)
        self.seconds = trial_seconds(given.wanted)
        asked = followed(given.wanted, given.stage, given.follows, given.mode)
        self._base = {axis: one.played if isinstance(one, Replaced) else one_period(one) for axis, one in asked.items()}
        self._lag_s = {axis: one.lag_s if isinstance(one, Replaced) else 0.0 for axis, one in asked.items()}
        self.count = {axis: line_count(one) for axis, one in given.wanted.items()}
        self.turns = {axis: turns_of(one_period(one)) for axis, one in given.wanted.items()}
        self.trials: list[Trial] = []
        self.best: Look | None = None
        self._run: Run | None = None
        self._limited: set[str] = set()

    def put_modes_at(self, factors: Mapping[str, float]) -> None:
        """Goes on with the modes of each axis at so many times the frequency that the model was given with."""
        if self.modes == factors:
            return
        assert self.given.stage is not None
        self.modes = dict(factors)
        self.stage = self.known = stage_with_modes_at(self.given.stage, factors)

    def moved(self) -> dict[str, Moved]:
        """Where the last trial has the modes of each axis."""
        assert self._run is not None
        rows, found = slice(round(SETTLE_S * TICK_HZ), None), {}
        for axis, wave in self.wanted.items():
            model, record = self.known.axis(axis), self._run.recording.axes[axis]
            assert record.x_um is not None
            assert record.u_V is not None
            sampled = self._run.t_s[rows], record.u_V[rows], record.x_um[rows]
            found[axis] = moved_modes(model, *sampled, wave.f_Hz, self.turns[axis], TICK_HZ)
        return found

    def no_correction(self) -> dict[str, Amplitudes]:
        return {axis: np.zeros(count + 1, complex) for axis, count in self.count.items()}

    def _waves(self, correction: Mapping[str, Amplitudes]) -> dict[str, Replaced]:
        return {
            axis: Replaced.of(
                wanted,
                self._base[axis] + values_of(np.arange(self.count[axis] + 1), correction[axis]),
                lag_s=self._lag_s[axis],
                trial_s=self.seconds,
            )
            for axis, wanted in self.wanted.items()
        }

    def corrected(
        self, correction: dict[str, Amplitudes], steps: Mapping[str, Step], gains: Mapping[str, Gains]
    ) -> Look:
        """Drives one trial with a correction that the reference can take. Raises TooLarge for another, RefusedOnModel
        where the trial ends badly there."""
        self._refuse_too_large(correction)
        return self.look(correction, steps, gains)

    def _refuse_too_large(self, correction: Mapping[str, Amplitudes]) -> None:
        for axis, wanted in self.wanted.items():
            added = values_of(np.arange(self.count[axis] + 1), correction[axis])
            if np.abs(added).max() > LARGEST_CORRECTION * wanted.swing:
                raise TooLarge(
                    f"{axis}: it would add {np.abs(added).max():.3g} um to a path of {wanted.swing:.4g} um; the model "
                    "is not of this stage: identify it again"
                )
        if not self.given.force:
            try:
                check_paths(self._waves(correction), self.given.mode, self.known)
            except BadInput as error:
                raise TooLarge(str(error)) from None

    def look(self, correction: dict[str, Amplitudes], steps: Mapping[str, Step], gains: Mapping[str, Gains]) -> Look:
        """Drives one trial and adds it to the list; the best so far is kept. Raises RefusedOnModel."""
        waves = self._waves(correction)
        if not self.given.force:
            try:
                predicted = rehearse(waves, self.given.mode, self.stage, gains, self.seconds)
            except BadInput as error:
                raise RefusedOnModel(str(error)) from None
            if self.given.on_rehearsed is not None and not self.trials:
                self.given.on_rehearsed(predicted)
        self._run = run = self._driven(waves, gains)
        look = self._judged(run, waves, correction, gains)
        figures = dict(run.of_axes())
        true = {axis: one["true"]["max_um"] for axis, one in figures.items() if "true" in one}
        kept = self.best is None or look.worth < self.best.worth
        self.best = look if kept else self.best
        self.trials.append(
            Trial(
                number=len(self.trials),
                kept=kept,
                learned_lines={axis: int(steps[axis].learned.sum()) if steps else 0 for axis in waves},
                probed_lines={axis: int(steps[axis].probed.sum()) if steps else 0 for axis in waves},
                max_um={axis: one["max_um"] for axis, one in figures.items()},
                rms_um={axis: one["rms_um"] for axis, one in figures.items()},
                true_max_um=true or None,
                judged_pct=100 * math.sqrt(look.worth / len(waves)),
                source=self.given.kept.add(f"trial-{len(self.trials)}", run),
            )
        )
        return look

    def _driven(self, waves: Mapping[str, Waveform], gains: Mapping[str, Gains]) -> Run:
        given, stage = self.given, self.stage
        try:
            return track(given.device, waves, given.mode, stage=stage, gains=gains, duration_s=self.seconds, force=True)
        except DeviceFault as fault:
            recording = run_recording(fault.capture, given.mode, stage)
            tell_of(fault, recording, gains_given=given.gains_chosen)
            raise

    def _judged(
        self, run: Run, waves: Mapping[str, Replaced], correction: dict[str, Amplitudes], gains: Mapping[str, Gains]
    ) -> Look:
        """From where it has settled on."""
        rows = slice(round(SETTLE_S * TICK_HZ), None)
        error, rest_um, worth = {}, {}, 0.0
        for axis, wave in waves.items():
            measured_um, u_V = run.recording.axes[axis].x_um, run.recording.axes[axis].u_V
            assert measured_um is not None
            assert u_V is not None
            fastest_V_per_s = float(np.abs(np.diff(u_V[rows])).max()) * TICK_HZ
            if fastest_V_per_s > AT_LIMIT * self.known.axis(axis).limits.slew_V_per_s:
                self._limited.add(axis)
            off_um = (wave.value(run.t_s) - measured_um)[rows]
            error[axis] = error_lines(run.t_s[rows], off_um, wave.f_Hz, self.count[axis], TICK_HZ)
            rest_um[axis] = rest_of(error[axis], run.t_s[rows], off_um, wave.f_Hz)
            worth += float(np.mean(off_um**2)) / self.wanted[axis].swing ** 2
        return Look(correction, error, rest_um, dict(gains), dict(self.modes), worth)

    def about_limits(self) -> str:
        """What no learning mends: an axis whose output was at its slew limit in any trial."""
        each = (
            f"{a} was at its slew limit of {self.known.axis(a).limits.slew_V_per_s:g} V/s"
            for a in sorted(self._limited)
        )
        return "".join(f"; the output of {one}: a smaller or slower path would not be" for one in each)

    def learned(self, reason: str, *, in_fault: bool = False) -> Learned:
        best = self.best
        assert best is not None
        waves = self._waves(best.correction)
        paths = {
            axis: LearnedPath(
                wanted.f_Hz,
                one_period(wanted),
                waves[axis].played,
                self._lag_s[axis],
                self.seconds,
                best.gains.get(axis),
                best.modes[axis],
            )
            for axis, wanted in self.wanted.items()
        }
        given = self.given
        return Learned(given.sha256, given.mode, given.follows, paths, tuple(self.trials), reason, in_fault=in_fault)
