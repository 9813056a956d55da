"""Paths that go on until told otherwise: what ``Controller.play`` does."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import nullcontext

from phaselead.control.feeding import refuse_endless
from phaselead.control.gains import GainsLike, gains_of
from phaselead.control.going_on import go_on
from phaselead.control.held import held_stage, low_gains_warning, unknown_warning
from phaselead.control.hold_and_move import HoldsAndMoves
from phaselead.control.modes import NEEDS_MODEL
from phaselead.control.motion_limits import WINDOW_S
from phaselead.control.moving import Mover
from phaselead.control.rehearsal import rehearse
from phaselead.control.tracking import check_paths, loop_warnings, path_warnings, set_up
from phaselead.control.true_position import Follows, followed
from phaselead.control.wave_arguments import WaveLike, WavesLike, given_waves
from phaselead.device import Live, motion
from phaselead.errors import DeviceRefused
from phaselead.model import Gains, Stage, StageLike, as_stage
from phaselead.quantity import IN_SECONDS, Quantity, quantity
from phaselead.waveforms import Waveform


class Plays(HoldsAndMoves):
    """The part of a controller that leaves paths running, and shows what happens meanwhile."""

    def play(
        self,
        wave: WavesLike | None = None,
        *,
        mode: str | None = None,
        axis: str | None = None,
        x: WaveLike | None = None,
        y: WaveLike | None = None,
        z: WaveLike | None = None,
        model: StageLike | None = None,
        gains: GainsLike | Mapping[str, GainsLike] | None = None,
        duration: Quantity | None = None,
        follows: Follows = "true",
        force: bool = False,
    ) -> None:
        """Drives along a path until told otherwise, or for ``duration`` seconds, after which it holds where the path
        ends; returns at once. ``hold`` stops it where it is, ``move`` goes on
        from there, and so does another path; ``park`` and ``stop`` end it. Without a feedback mode (open) only the last
        two do.

        Arguments are those of ``track``; a path of its own length is held at its end. The path runs on the model first.
        ``live`` shows what happens meanwhile. Axes that are held, or follow paths, go on from there, without parking
        and without a kick, in their mode, which ``mode`` may be left out for; they are first brought to a hold where a
        waveform of points gives way to another, or anything to a move. Raises as ``track`` does.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     dev.play("sine:20um@5Hz", mode="pid")
        ...     dev.play("triangle:30um@2Hz")
        ...     playing = dev.where()
        ...     held = dev.hold()
        >>> playing.x.moving, held.x.moving
        (True, False)
        """
        waveforms = given_waves(wave, axis, {"x": x, "y": y, "z": z})
        mode, seconds = mode or self._mode_now(), quantity("duration", duration, IN_SECONDS)
        stage = self._own_model(waveforms, mode) if model is None else as_stage(model)
        said = play_on(
            self._mover, waveforms, mode, stage=stage, gains=gains, duration_s=seconds, follows=follows, force=force
        )
        self.watch_over()
        self.model = stage or self.model
        for line in said:
            warnings.warn(line, stacklevel=2)

    def live(self, axes: str = "xyz") -> Live:
        """A stream of every tick of these axes, as it comes; ``with dev.live() as live: live.read()``.

        Commands may be given meanwhile. Raises DeviceRefused when the line is too slow for so many axes.

        >>> import phaselead as pl
        >>> with pl.connect() as dev, dev.live("xy") as live:
        ...     first = live.read(0.02)[0]
        >>> sorted(first.axes), first.ticks > 0
        (['x', 'y'], True)
        """
        return Live(self.device, axes)

    def _mode_now(self) -> str:
        """That the axes are held in, else the usual one."""
        return self._mover.mode if self._mover.holds() else "ff+pid"

    def _own_model(self, waveforms: Mapping[str, Waveform], mode: str) -> Stage | None:
        """The model last uploaded, but for axes that it lacks in modes that do without one."""
        lacks = self.model is not None and not set(waveforms) <= set(self.model.axes)
        return None if lacks and mode in ("open", "pid") else self.model


def play_on(
    mover: Mover,
    waveforms: Mapping[str, Waveform],
    mode: str,
    *,
    stage: Stage | None,
    gains: GainsLike | Mapping[str, GainsLike] | None,
    duration_s: float | None,
    follows: Follows,
    force: bool,
) -> list[str]:
    """Begins the paths and leaves them running for so long (None: until told otherwise), held by ``mover`` from then
    on; axes that it holds already go on from there. Returns what the model warns of.

    Raises BadInput before anything moves, as ``track``; DeviceRefused for axes that are driven and not held.
    """
    device, going_on = mover.device, go_on(mover, waveforms, mode, stage, gains, force=force)
    state = mover.where().state
    if going_on is None and state not in ("parked", "armed"):
        raise DeviceRefused(f"the device is {state}, and holds no axis; `phaselead park` ends that")
    held = held_stage(device, "" if mode in NEEDS_MODEL else "".join(waveforms)) if stage is None else None
    known = stage or held
    if going_on is not None:
        chosen, warnings = {axis: going_on.gains[axis] for axis in waveforms}, going_on.said
    else:
        chosen = {axis: gains_of(gains, known, axis) for axis in waveforms} if mode != "open" else {}
        warnings = unknown_warning(device, known, mode, gains_given=gains is not None)
        warnings += [*low_gains_warning(stage, held, mode, chosen), *loop_warnings(stage, mode, chosen, force=force)]
    check_paths(waveforms, mode, known)
    endless = duration_s is None
    if endless:
        refuse_endless(waveforms)
    paths = followed(waveforms, stage, follows, mode)
    if not force:
        rehearse(paths, mode, stage, chosen, duration_s)
    with nullcontext() if going_on is None else going_on.way_for(paths) as spans_um:
        ready = set_up(
            device,
            paths,
            mode,
            stage=stage,
            gains=chosen,
            duration_s=duration_s,
            endless=endless,
            force=force,
            spans_um=spans_um,
        )
        if going_on is None:
            hold_on(mover, stage, known, mode, chosen)
        mover.entered_tick = max(mover.entered_tick, ready.begin(device))
    if endless:
        mover.playing |= {axis: one for axis, one in ready.waveforms.items() if one.periodic}
    return [*warnings, *path_warnings(paths)]


def hold_on(mover: Mover, stage: Stage | None, known: Stage | None, mode: str, gains: Mapping[str, Gains]) -> None:
    """The axes with ``gains`` are held by ``mover`` from now on, under the model ``known`` of them."""
    mover.stage, mover.known, mover.mode, mover.gains = stage, known, mode, dict(gains)
    mover.forget_paths()
    for axis in gains:
        motion.set_motion(mover.device, axis, mover.limits(axis), mover.window(axis), WINDOW_S)
