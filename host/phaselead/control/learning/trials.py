"""Iterative learning of periodic paths on a device: drive, look at what repeats, correct the reference, again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from phaselead.control.held import held_sha256, held_stage
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning.law import Step, next_step, reached
from phaselead.control.learning.learned import Learned, LearnedPath, Trial, one_period
from phaselead.control.learning.lines import Amplitudes, error_lines, rest_of, values_of
from phaselead.control.learning.look import SETTLE_S, End, Look, line_count, trial_seconds
from phaselead.control.learning.quieter import HALVINGS, larger, louder, quieter, share_of
from phaselead.control.learning.response import (
    Response,
    in_other_loop,
    model_response,
    other_loop,
    same_voltage,
    turns_of,
)
from phaselead.control.modes import INVERTS
from phaselead.control.rehearsal import rehearse
from phaselead.control.run import Run
from phaselead.control.run_away import tell_of
from phaselead.control.tracking import check_paths, loop_warnings, run_recording, track
from phaselead.control.true_position import Follows, followed
from phaselead.device import TICK_HZ, Device, DeviceFault
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage
from phaselead.waveforms import Replaced, Waveform

LARGEST_CORRECTION = 2.0
"""Of the swing. A path at the mode of a model that has it 10 % off takes 1.7; what is further off is another stage."""
SHRINKS = 0.98
"""An error that falls by less than 2 % a trial has settled."""
MOST_FAILURES = 3
"""Trials in a row that took less than 2 % off the best, before it is given up; after one that took nothing off the step
is halved."""
AT_LIMIT = 0.995
"""Of the slew limit: a code of the converter is 0.2 % of the usual one, a tick long."""

Progress = Callable[[float], None]


def learn(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str = "inverse+pid",
    *,
    stage: Stage | None,
    gains: Mapping[str, Gains],
    trials: int = 10,
    follows: Follows = "true",
    force: bool = False,
    turn_down: bool = False,
    kept: KeptRuns | None = None,
    on_progress: Progress | None = None,
) -> Learned:
    """Drives the paths as they are, then up to ``trials`` times corrected by what was seen, and keeps the best.

    Each line of the period is corrected by what the error has of it that repeats, through the response of the model,
    itself corrected by what the trials show (``law``, ``response``). In mode ``inverse`` the reference becomes the
    voltage, so that it is the voltage that is learned. The error is against the path that was asked for. Every trial
    runs on the model first; ends early when what is left does not repeat, or no longer shrinks. ``turn_down``: from the
    first correction on with less of the gains, unless that leaves more of what does not repeat. ``kept`` takes every
    trial's run. Without ``stage`` it learns with the model that the device holds, as far as that can be read back: its
    modes cannot, so that nothing runs on it first.

    Raises:
        BadInput: a path, mode or model that it is not for, or the first trial ends in a fault on the model.
        DeviceFault: the first trial ended in one. A later one ends the learning; the best trial before it is kept.
    """
    known = stage or held_stage(device)
    sha256 = held_sha256(device) if stage is None else stage.sha256
    if known is None or sha256 is None:
        raise BadInput(
            "learning needs a model, and the device holds none: --model STAGE.toml (`phaselead identify` makes one, "
            "`phaselead upload --persist` keeps it on the device)"
        )
    _refuse(waveforms, mode, trials)
    check_paths(waveforms, mode, known)
    loop_warnings(stage, mode, gains, force=force)
    given = _Given(
        device,
        dict(waveforms),
        mode,
        stage,
        known,
        sha256,
        gains=dict(gains) if mode.endswith("pid") else {},
        gains_chosen=not turn_down,
        follows=follows,
        force=force or stage is None,
        kept=kept or KeptRuns(None),
    )
    less = turn_down and stage is not None
    return _Course(given).run(trials, turn_down=less, on_progress=on_progress or (lambda share: None))


def _refuse(waveforms: Mapping[str, Waveform], mode: str, trials: int) -> None:
    if mode not in INVERTS:
        raise BadInput(f"mode {mode} is not learned in; use inverse+pid, or inverse for the voltage alone")
    if trials < 1:
        raise BadInput(f"{trials} trials: give one or more")
    for axis, waveform in waveforms.items():
        if not waveform.periodic:
            raise BadInput(f"{axis}: a move is driven once and cannot be learned; write it as a period (file:...@1Hz)")


class _TooLarge(BadInput):
    """A correction that the reference cannot take."""


class _RefusedOnModel(BadInput):
    """A trial that ends badly there, so that it was not driven."""


@dataclass(frozen=True)
class _Given:
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


class _Course:
    """The trials of one learning."""

    def __init__(self, given: _Given) -> None:
        self._given, self._wanted, self._known = given, given.wanted, given.known
        self._gains = dict(given.gains)
        wanted, stage = given.wanted, given.stage
        self._seconds = trial_seconds(wanted)
        asked = followed(wanted, stage, given.follows, given.mode)
        self._base = {axis: one.played if isinstance(one, Replaced) else one_period(one) for axis, one in asked.items()}
        self._lag_s = {axis: one.lag_s if isinstance(one, Replaced) else 0.0 for axis, one in asked.items()}
        self._count = {axis: line_count(one) for axis, one in wanted.items()}
        self._f_Hz = {axis: one.f_Hz * np.arange(self._count[axis] + 1.0) for axis, one in wanted.items()}
        self._turns = {axis: turns_of(one_period(one)) for axis, one in wanted.items()}
        self._response = self._of_model(self._gains)
        self._trials: list[Trial] = []
        self._best: Look | None = None
        self._limited: set[str] = set()

    def _of_model(self, gains: Mapping[str, Gains]) -> dict[str, Response]:
        return {
            axis: model_response(self._known.axis(axis), gains.get(axis), f_Hz, self._turns[axis])
            for axis, f_Hz in self._f_Hz.items()
        }

    def run(self, trials: int, *, turn_down: bool, on_progress: Progress) -> Learned:
        first = self._look({axis: np.zeros(count + 1, complex) for axis, count in self._count.items()}, {})
        base = self._with_gains(first, self._quieter(first)) if turn_down else first
        end = self._learn(base, first, trials, on_progress)
        while self._wants_more_feedback(end, first) and len(self._trials) <= trials:
            end = self._with_more(end, first, trials, on_progress)
        if turn_down:
            end = self._quieted(end, first, trials, on_progress)
        return self._learned(end.reason + self._about_feedback() + self._about_limits())

    def _learn(self, base: Look, first: Look, trials: int, on_progress: Progress) -> End:
        share, failures = 1.0, 0
        while (number := len(self._trials)) <= trials:
            on_progress(number / (trials + 1))
            steps = {axis: next_step(base.error[axis], self._response[axis], share) for axis in self._wanted}
            if not any(step.change.any() for step in steps.values()):
                return End(
                    f"ended after trial {number - 1}: what is left does not repeat, or cannot be corrected", base
                )
            correction = {axis: base.correction[axis] + step.change for axis, step in steps.items()}
            try:
                self._refuse_too_large(correction)
            except _TooLarge as error:
                return End(f"stopped before trial {number}: {error}", base, refused=True)
            try:
                found = self._look(correction, steps)
            except _RefusedOnModel as error:  # less of it may not end badly there
                share, failures = share / 2, failures + 1
                if failures == MOST_FAILURES:
                    return End(f"stopped before trial {number}: {error}", base)
                continue
            except DeviceFault as error:
                return End(f"stopped: {error}", None)
            if found.gains != base.gains:  # the first of another loop: only a forecast to compare it with
                if self._repeats(found) > self._repeats(base):
                    self._compare(base, found, forecast_of=first)
                    share, failures = share / 2, failures + 1
                    if failures < MOST_FAILURES:
                        continue
                base, share, failures = self._unless_it_shakes_more(found, first), 1.0, 0
                continue
            self._compare(base, found)
            if found.worth < base.worth:
                settled = found.worth > SHRINKS**2 * base.worth
                base, share, failures = found, min(2 * share, 1.0), failures + 1 if settled else 0
            else:
                share, failures = share / 2, failures + 1
            if failures == MOST_FAILURES:
                return End(f"stopped after trial {number}: {MOST_FAILURES} trials brought less than 2 %", base)
        return End(f"ended after {trials} trials, as asked", base)

    def _wants_more_feedback(self, end: End, first: Look) -> bool:
        """Where less of it left more that repeats than does not, out of reach: its correction was refused, or the stage
        turned out not to follow."""
        if end.look is None or self._gains == first.gains:
            return False
        if end.refused:
            return end.look.mostly_repeats
        lost = {axis: response.followed & ~reached(response) for axis, response in self._response.items()}
        return replace(end.look, error={a: one.only(lost[a]) for a, one in end.look.error.items()}).mostly_repeats

    def _quieter(self, first: Look, halvings: int | None = HALVINGS) -> dict[str, Gains]:
        seen_s = self._seconds - SETTLE_S
        return {axis: quieter(self._known.axis(axis), own, seen_s, halvings) for axis, own in first.gains.items()}

    def _with_more(self, end: End, first: Look, trials: int, on_progress: Progress) -> End:
        """Goes on with twice the feedback, from the voltage that was learned, or anew where the reference cannot make
        that."""
        assert end.look is not None
        more = {axis: louder(own, first.gains[axis]) for axis, own in self._gains.items()}
        try:
            found = self._with_same_voltage(end.look, more)
        except DeviceFault as error:
            return End(f"stopped: {error}", None)
        return self._learn(found or self._with_gains(first, more), first, trials, on_progress)

    def _quieted(self, end: End, first: Look, trials: int, on_progress: Progress) -> End:
        """Goes on with as little feedback as drift allows, where noise is most of what is left; with more of it where
        the reference cannot make up for what that leaves."""
        if end.look is None or end.look.mostly_repeats:
            return end
        before, less = dict(self._gains), self._quieter(first, None)
        while less != before and len(self._trials) <= trials:
            try:
                found = self._with_same_voltage(end.look, less)
            except DeviceFault as error:
                return End(f"stopped: {error}", None)
            if found is not None:
                return self._learn(found, first, trials, on_progress) if found.rests_less_than(end.look) else end
            less = {axis: own if own == before[axis] else louder(own, first.gains[axis]) for axis, own in less.items()}
        return end

    def _with_same_voltage(self, look: Look, gains: dict[str, Gains]) -> Look | None:
        """One more trial, with other gains and the reference that makes them ask for the voltage of ``look``; None,
        and nothing has changed, where it is refused."""
        correction, response = dict(look.correction), self._of_model(gains)
        for axis, f_Hz in self._f_Hz.items():
            model, loops = self._known.axis(axis), (look.gains[axis], gains[axis])
            apart_um = look.correction[axis] + look.error[axis].heard
            correction[axis] = correction[axis] + same_voltage(model, loops, f_Hz, response[axis].voltage, apart_um)
            response[axis] = in_other_loop(model, loops, f_Hz, self._response[axis], response[axis])
        before = self._gains, self._response
        self._gains, self._response = gains, response
        try:
            self._refuse_too_large(correction)
            return self._look(correction, {})
        except (_TooLarge, _RefusedOnModel):
            self._gains, self._response = before
            return None

    def _with_gains(self, first: Look, gains: dict[str, Gains]) -> Look:
        """Goes on with other gains; gives the first trial's error as the model has it with them."""
        error = dict(first.error)
        for axis, own in first.gains.items():
            model = self._known.axis(axis)
            error[axis] = first.error[axis].times(other_loop(model, own, gains[axis], self._f_Hz[axis]))
        self._gains = gains
        self._response = self._of_model(self._gains)
        return replace(first, error=error)

    def _unless_it_shakes_more(self, found: Look, first: Look) -> Look:
        """What to go on from: the first trial, with all of its feedback, where less leaves more that never repeats."""
        if any(larger(found.rest_um[axis], first.rest_um[axis]) for axis in found.gains):
            return self._with_all_feedback(first)
        return found

    def _with_all_feedback(self, first: Look) -> Look:
        self._gains = dict(first.gains)
        self._response = self._of_model(self._gains)
        return first

    def _about_feedback(self) -> str:
        """With how much of it the best trial was driven, where that is not all."""
        assert self._best is not None
        shares = {axis: share_of(own, self._given.gains[axis]) for axis, own in self._best.gains.items()}
        return "".join(
            f"; {axis} keeps {100 * share:.3g} % of its gains: what repeats is learned, and less shakes it less"
            for axis, share in shares.items()
            if share != 1
        )

    def _about_limits(self) -> str:
        """What no learning mends: an axis whose output was at its slew limit in any trial."""
        each = (
            f"{a} was at its slew limit of {self._known.axis(a).limits.slew_V_per_s:g} V/s"
            for a in sorted(self._limited)
        )
        return "".join(f"; the output of {one}: a smaller or slower path would not be" for one in each)

    def _waves(self, correction: Mapping[str, Amplitudes]) -> dict[str, Replaced]:
        return {
            axis: Replaced.of(
                wanted,
                self._base[axis] + values_of(np.arange(self._count[axis] + 1), correction[axis]),
                lag_s=self._lag_s[axis],
                trial_s=self._seconds,
            )
            for axis, wanted in self._wanted.items()
        }

    def _refuse_too_large(self, correction: Mapping[str, Amplitudes]) -> None:
        for axis, wanted in self._wanted.items():
            added = values_of(np.arange(self._count[axis] + 1), correction[axis])
            if np.abs(added).max() > LARGEST_CORRECTION * wanted.swing:
                raise _TooLarge(
                    f"{axis}: it would add {np.abs(added).max():.3g} um to a path of {wanted.swing:.4g} um; the model "
                    "is not of this stage: identify it again"
                )
        if not self._given.force:
            try:
                check_paths(self._waves(correction), self._given.mode, self._known)
            except BadInput as error:
                raise _TooLarge(str(error)) from None

    def _look(self, correction: dict[str, Amplitudes], steps: Mapping[str, Step]) -> Look:
        """Drives one trial and adds it to the list; the best so far is kept."""
        waves = self._waves(correction)
        if not self._given.force:
            try:
                rehearse(waves, self._given.mode, self._given.stage, self._gains, self._seconds)
            except BadInput as error:
                raise _RefusedOnModel(str(error)) from None
        run = self._driven(waves)
        look = self._judged(run, waves, correction)
        figures = dict(run.of_axes())
        true = {axis: one["true"]["max_um"] for axis, one in figures.items() if "true" in one}
        kept = self._best is None or look.worth < self._best.worth
        self._best = look if kept else self._best
        self._trials.append(
            Trial(
                number=len(self._trials),
                kept=kept,
                learned_lines={axis: int(steps[axis].learned.sum()) if steps else 0 for axis in waves},
                probed_lines={axis: int(steps[axis].probed.sum()) if steps else 0 for axis in waves},
                max_um={axis: one["max_um"] for axis, one in figures.items()},
                rms_um={axis: one["rms_um"] for axis, one in figures.items()},
                true_max_um=true or None,
                judged_pct=100 * math.sqrt(look.worth / len(waves)),
                source=self._given.kept.add(f"trial-{len(self._trials)}", run),
            )
        )
        return look

    def _driven(self, waves: Mapping[str, Waveform]) -> Run:
        given, stage = self._given, self._given.stage
        try:
            return track(
                given.device, waves, given.mode, stage=stage, gains=self._gains, duration_s=self._seconds, force=True
            )
        except DeviceFault as fault:
            recording = run_recording(fault.capture, given.mode, stage)
            tell_of(fault, recording, gains_given=given.gains_chosen)
            raise

    def _judged(self, run: Run, waves: Mapping[str, Replaced], correction: dict[str, Amplitudes]) -> Look:
        """From where it has settled on."""
        rows = slice(round(SETTLE_S * TICK_HZ), None)
        error, rest_um, worth = {}, {}, 0.0
        for axis, wave in waves.items():
            measured_um, u_V = run.recording.axes[axis].x_um, run.recording.axes[axis].u_V
            assert measured_um is not None
            assert u_V is not None
            fastest_V_per_s = float(np.abs(np.diff(u_V[rows])).max()) * TICK_HZ
            if fastest_V_per_s > AT_LIMIT * self._known.axis(axis).limits.slew_V_per_s:
                self._limited.add(axis)
            off_um = (wave.value(run.t_s) - measured_um)[rows]
            error[axis] = error_lines(run.t_s[rows], off_um, wave.f_Hz, self._count[axis], TICK_HZ)
            rest_um[axis] = rest_of(error[axis], run.t_s[rows], off_um, wave.f_Hz)
            worth += float(np.mean(off_um**2)) / self._wanted[axis].swing ** 2
        return Look(correction, error, rest_um, dict(self._gains), worth)

    def _repeats(self, look: Look) -> float:
        """Mean square of what repeats as a share of the swing, over all axes."""
        return sum(one.power / self._wanted[axis].swing ** 2 for axis, one in look.error.items())

    def _compare(self, before: Look, after: Look, forecast_of: Look | None = None) -> None:
        """What the responses are in the light of two trials. ``forecast_of``: the error before is that of this one as
        the model has it with other gains, which is as far from the truth as it is from this one at most."""
        for axis in self._wanted:
            change = after.correction[axis] - before.correction[axis]
            answer = before.error[axis].amplitude - after.error[axis].amplitude
            variance = before.error[axis].variance + after.error[axis].variance
            if forecast_of is not None:
                variance += np.abs(before.error[axis].amplitude - forecast_of.error[axis].amplitude) ** 2
            self._response[axis] = self._response[axis].measured(change, answer, variance)

    def _learned(self, reason: str) -> Learned:
        best = self._best
        assert best is not None
        waves = self._waves(best.correction)
        paths = {
            axis: LearnedPath(
                wanted.f_Hz,
                one_period(wanted),
                waves[axis].played,
                self._lag_s[axis],
                self._seconds,
                best.gains.get(axis),
            )
            for axis, wanted in self._wanted.items()
        }
        given = self._given
        return Learned(given.sha256, given.mode, given.follows, paths, tuple(self._trials), reason)
