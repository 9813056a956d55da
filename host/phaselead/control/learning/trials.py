"""Iterative learning of periodic paths on a device: drive, look at what repeats, correct the reference, again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from phaselead.control.gains import MODE_SHIFT
from phaselead.control.held import held_sha256, held_stage
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning.drift_loop import drift_loop
from phaselead.control.learning.drive import Drive, Given, RefusedOnModel, TooLarge
from phaselead.control.learning.law import next_step, reached
from phaselead.control.learning.learned import Learned
from phaselead.control.learning.look import SETTLE_S, End, Look, trial_seconds
from phaselead.control.learning.moved_modes import SURE
from phaselead.control.learning.quieter import HALVINGS, larger, louder, quieter, share_of
from phaselead.control.learning.response import (
    Response,
    in_other_loop,
    model_response,
    other_loop,
    same_voltage,
)
from phaselead.control.modes import INVERTS
from phaselead.control.motion_limits import first_mode_Hz
from phaselead.control.rehearsal import OnRehearsed
from phaselead.control.tracking import LONGEST_UNASKED_S, check_paths, loop_warnings
from phaselead.control.true_position import Follows
from phaselead.device import Device, DeviceFault, device_model
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage
from phaselead.waveforms import Waveform

SHRINKS = 0.98
"""An error that falls by less than 2 % a trial has settled."""
MOST_FAILURES = 3
"""Trials in a row that took less than 2 % off the best, before it is given up; after one that took nothing off the step
is halved."""
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
    on_rehearsed: OnRehearsed | None = None,
) -> Learned:
    """Drives the paths as they are, then up to ``trials`` times corrected by what was seen, and keeps the best.

    Each line of the period is corrected by what the error has of it that repeats, through the response of the model,
    itself corrected by what the trials show (``law``, ``response``). In mode ``inverse`` the reference becomes the
    voltage, so that it is the voltage that is learned. The error is against the path that was asked for. Every trial
    runs on the model first; ends early when what is left does not repeat, or no longer shrinks. ``turn_down``: from the
    first correction on with less of the gains, unless that leaves more of what does not repeat. ``kept`` takes every
    trial's run, ``on_rehearsed`` what the model says of the first. Without ``stage`` it learns with the model that
    the device holds, as far as that can be read back: its modes cannot, so that nothing runs on it first.

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
    given = Given(
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
        on_rehearsed=on_rehearsed,
    )
    less = turn_down and stage is not None
    found = _Course(given).run(trials, turn_down=less, on_progress=on_progress or (lambda share: None))
    if stage is not None and device.status().state == "parked":  # it holds that of the last trial
        device.upload_if_other(device_model(stage))
    return found


def _refuse(waveforms: Mapping[str, Waveform], mode: str, trials: int) -> None:
    if mode not in INVERTS:
        raise BadInput(f"mode {mode} is not learned in; use inverse+pid, or inverse for the voltage alone")
    if trials < 1 or trials != int(trials):
        raise BadInput(f"{trials} trials: give a whole number, one or more")
    for axis, waveform in waveforms.items():
        if not waveform.periodic:
            raise BadInput(f"{axis}: what is driven once does not repeat; {_again_and_again(waveform)} does")
    seconds = trial_seconds(waveforms)
    if seconds > LONGEST_UNASKED_S:
        raise BadInput(f"one trial of this takes {seconds / 3600:.3g} hours: learn another frequency")


def _again_and_again(waveform: Waveform) -> str:
    """How the same is written as a path that repeats."""
    if waveform.played_as == "points":
        return f"path:FILE@{waveform.f_Hz:.6g}Hz, the file over and over,"
    way = abs(waveform.offset + waveform.swing) or 10.0
    return f"staircase:{way:g}{waveform.unit}/1@1Hz, there and back with a rest at both ends,"


def _about(own: Gains, asked: Gains) -> str:
    """Which part of the gains they are."""
    share = f"{100 * share_of(own, asked):.3g} %"
    return f"{share} of its gains" if own.filters == asked.filters else f"{share} of its integral gain alone"


class _Course:
    """The trials of one learning."""

    def __init__(self, given: Given) -> None:
        self._given, self._wanted, self._drive = given, given.wanted, Drive(given)
        self._gains = dict(given.gains)
        self._f_Hz = {axis: one.f_Hz * np.arange(self._drive.count[axis] + 1.0) for axis, one in self._wanted.items()}
        self._mode_shift = dict.fromkeys(self._wanted, MODE_SHIFT)
        self._response = self._of_model(self._gains)

    def _of_model(self, gains: Mapping[str, Gains]) -> dict[str, Response]:
        return {
            axis: model_response(
                self._drive.known.axis(axis), gains.get(axis), f_Hz, self._drive.turns[axis], self._mode_shift[axis]
            )
            for axis, f_Hz in self._f_Hz.items()
        }

    def run(self, trials: int, *, turn_down: bool, on_progress: Progress) -> Learned:
        first = self._drive.look(self._drive.no_correction(), {}, self._gains)
        try:
            first = self._with_moved_modes(first)
        except DeviceFault as error:
            return self._drive.learned(f"stopped: {error}", in_fault=True)
        base = self._with_gains(first, self._quieter(first)) if turn_down else first
        end = self._learn(base, first, trials, on_progress)
        while self._wants_more_feedback(end, first) and len(self._drive.trials) <= trials:
            end = self._with_more(end, first, trials, on_progress)
        if turn_down:
            end = self._quieted(end, first, trials, on_progress)
        return self._drive.learned(
            end.reason + self._about_modes() + self._about_feedback() + self._drive.about_limits(),
            in_fault=end.look is None,
        )

    def _with_moved_modes(self, first: Look) -> Look:
        """One more trial without a correction, by the inverse of the modes where the first one had them; the first one
        where they have not surely moved, or that is no better. Where the modes are is then less in doubt."""
        drive, given = self._drive, self._given
        moved = drive.moved() if given.stage is not None else {}
        sure = {axis: one.factor if one.surely else 1.0 for axis, one in moved.items()}
        found = first
        if any(factor != 1 for factor in sure.values()):
            drive.put_modes_at(sure)
            try:
                check_paths(self._wanted, given.mode, drive.stage)
                loop_warnings(drive.stage, given.mode, self._gains, force=given.force)
            except BadInput:
                pass
            else:
                found = self._if_better(first)
            drive.put_modes_at(found.modes)
        for axis, one in moved.items():
            off = abs(one.factor / found.modes[axis] - 1) + SURE * one.deviation
            self._mode_shift[axis] = min(MODE_SHIFT, off)
        self._response = self._of_model(self._gains)
        return found

    def _if_better(self, first: Look) -> Look:
        """The same again; the first one where that is no better, or ends badly on the model."""
        try:
            again = self._drive.look(self._drive.no_correction(), {}, self._gains)
        except RefusedOnModel:
            return first
        return again if again.worth < first.worth else first

    def _learn(self, base: Look, first: Look, trials: int, on_progress: Progress) -> End:
        share, failures = 1.0, 0
        while (number := len(self._drive.trials)) <= trials:
            on_progress(number / (trials + 1))
            steps = {axis: next_step(base.error[axis], self._response[axis], share) for axis in self._wanted}
            if not any(step.change.any() for step in steps.values()):
                return End(
                    f"nothing more to learn after trial {number - 1}: what is left does not repeat, or cannot be "
                    "corrected",
                    base,
                )
            correction = {axis: base.correction[axis] + step.change for axis, step in steps.items()}
            try:
                found = self._drive.corrected(correction, steps, self._gains)
            except TooLarge as error:
                return End(f"stopped before trial {number}: {error}", base, refused=True)
            except RefusedOnModel as error:  # less of it may not end badly there
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
        seen_s = self._drive.seconds - SETTLE_S
        return {axis: quieter(self._drive.known.axis(axis), own, seen_s, halvings) for axis, own in first.gains.items()}

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
        """Goes on with as little feedback as drift allows, where noise is most of what is left: of the loop that is
        made for that and of the gains halved, the one that leaves less of what does not repeat."""
        if end.look is None or end.look.mostly_repeats:
            return end
        before = self._gains, self._response
        least, kept = end.look, before
        for tried in (self._against_drift(first), self._halved(first)):
            for less in tried:
                if len(self._drive.trials) > trials - (least is not end.look):  # one is left to learn in
                    break
                self._gains, self._response = before
                try:
                    found = self._with_same_voltage(end.look, less)
                except DeviceFault as error:
                    return End(f"stopped: {error}", None)
                if found is not None:
                    if found.rests_less_than(least):
                        least, kept = found, (self._gains, self._response)
                    break
        self._gains, self._response = kept
        return end if least is end.look else self._learn(least, first, trials, on_progress)

    def _against_drift(self, first: Look) -> list[dict[str, Gains]]:
        """The loop that is made for a learned path, where an axis has one."""
        seen_s, less = self._drive.seconds - SETTLE_S, self._quieter(first, None)
        made = {axis: drift_loop(self._drive.known.axis(axis), own, seen_s) for axis, own in self._gains.items()}
        return [{axis: own or less[axis] for axis, own in made.items()}] if any(made.values()) else []

    def _halved(self, first: Look) -> list[dict[str, Gains]]:
        """The gains halved as often as drift allows, and these doubled again and again, up to what they are: with more
        of them the reference may make up for what less leaves."""
        now, less, found = self._gains, self._quieter(first, None), []
        while less != now:
            found.append(less)
            less = {axis: own if own == now[axis] else louder(own, first.gains[axis]) for axis, own in less.items()}
        return found

    def _with_same_voltage(self, look: Look, gains: dict[str, Gains]) -> Look | None:
        """One more trial, with other gains and the reference that makes them ask for the voltage of ``look``; None,
        and nothing has changed, where it is refused."""
        correction, response = dict(look.correction), self._of_model(gains)
        for axis, f_Hz in self._f_Hz.items():
            model, loops = self._drive.known.axis(axis), (look.gains[axis], gains[axis])
            apart_um = look.correction[axis] + look.error[axis].heard
            correction[axis] = correction[axis] + same_voltage(model, loops, f_Hz, response[axis].voltage, apart_um)
            response[axis] = in_other_loop(model, loops, f_Hz, self._response[axis], response[axis])
        before = self._gains, self._response
        self._gains, self._response = gains, response
        try:
            return self._drive.corrected(correction, {}, self._gains)
        except (TooLarge, RefusedOnModel):
            self._gains, self._response = before
            return None

    def _with_gains(self, first: Look, gains: dict[str, Gains]) -> Look:
        """Goes on with other gains; gives the first trial's error as the model has it with them."""
        error = dict(first.error)
        for axis, own in first.gains.items():
            model = self._drive.known.axis(axis)
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

    def _about_modes(self) -> str:
        """Where they are, and the model does not have them."""
        assert self._drive.best is not None
        first_Hz = {axis: first_mode_Hz(self._given.known.axis(axis)) for axis in self._wanted}
        each = ((axis, first_Hz[axis] or 0.0, factor) for axis, factor in self._drive.best.modes.items() if factor != 1)
        return "".join(
            f"; the mode of {axis} is at {factor * f_Hz:.4g} instead of {f_Hz:.4g} Hz, as its inverse has it for this "
            "path: `phaselead tune` writes it into the model"
            for axis, f_Hz, factor in each
        )

    def _about_feedback(self) -> str:
        """With how much of it the best trial was driven, where that is not all."""
        assert self._drive.best is not None
        return "".join(
            f"; {axis} keeps {_about(own, self._given.gains[axis])}: what repeats is learned, and less feedback adds "
            "less noise"
            for axis, own in self._drive.best.gains.items()
            if own != self._given.gains[axis]
        )

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
