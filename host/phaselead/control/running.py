"""Runs from Python: along a path, again and again along it, or listening; each is recorded and judged."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from phaselead.control.gains import GainsLike, gains_in_mode, gains_of
from phaselead.control.going_on import go_on
from phaselead.control.held import held_sha256, held_stage, low_gains_warning, unknown_warning
from phaselead.control.journal import record_open_loop, track_to_file
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning import Learned, learn, load_learned
from phaselead.control.playing import Plays, hold_on
from phaselead.control.rehearsal import OnRehearsed, Predicted
from phaselead.control.run import Run
from phaselead.control.tracking import check_paths, loop_warnings, path_warnings
from phaselead.control.true_position import Follows, followed
from phaselead.control.wave_arguments import WaveLike, WavesLike, given_waves, wave_text
from phaselead.device import device_model
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage, StageLike, as_stage
from phaselead.quantity import IN_SECONDS, Quantity, quantity
from phaselead.record import RUN_SUFFIXES, Recording, check_output, file_sha256, parse_axes
from phaselead.waveforms import Waveform, of_table

Progress = Callable[[float], None]


class Runs(Plays):
    """The part of a controller that drives along paths, records, parks and judges."""

    def track(
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
        follows: Follows | None = None,
        learned: Learned | str | os.PathLike[str] | None = None,
        force: bool = False,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        trigger_out: str | None = None,
        trigger_in: Quantity | None = None,
        hold: bool = False,
        on_progress: Progress | None = None,
        on_rehearsed: OnRehearsed | None = None,
    ) -> Run:
        """Drives along a path, records every tick, parks, and judges: error = reference - measured position.

        ``wave`` is "sine:60um@5Hz", "triangle:100um@20Hz", "file:path.csv@10Hz", "path:scan.csv" (of any length, sent
        while it is played), "goto:120um", or in volts for mode open; amplitudes are peak-to-peak. It is for ``axis``, x
        or several ("x,y"), by default x; several paths run together as ``track(x="...", y="...")`` or
        ``track({"x": "...", "y": "..."})``.

        ``mode``: open, pid, ff, ff+pid (the default), inverse, inverse+pid. ``model``: default is the one last
        uploaded, else what the device holds; one that it does not hold is uploaded. ``gains``: "paper", (KP, KI, KD)
        in V/um, V/(um s), V s/um, or these by axis; default the model's own, else those designed for it or for what the
        device tells of the one it holds; the paper's where nobody has a model.
        Where the model's loop has a peak sensitivity above 3 it warns, above 6 it refuses unless ``force``.
        ``duration`` in s, or with a unit ("500ms"); default ten periods, or a move and a second.
        ``follows``: "true" (the default), where the model says by how much the sensor is late, makes the stage itself
        follow a periodic path, "measured" what the sensor shows. ``learned`` is what ``learn`` gave, or its file:
        played with its mode, gains and ``follows``, and refused for others, or another model or path.
        ``output`` (.h5) keeps the run on disk from the first tick on; one that exists is written over only with
        ``overwrite``. ``trigger_out`` says where the three trigger outputs pulse, the first one first: "start",
        "frame", "line", "pixel=256" (a line), "pixel=2ms", "pixel=0.5um" ("+0.5um": on the way up alone), "target" (a
        step has settled), joined by commas; "y:line" of another axis. ``run.triggers`` has the pulses. ``trigger_in``:
        the path begins at a rising edge of the trigger input, which is waited for so many seconds. ``hold`` holds the
        axes where the path ends, for moves to go on from there, instead of parking; not in mode open.

        Axes that are held, or follow a path (``move``, ``hold``, ``play``, ``hold=True``), go on from there without
        parking and without a kick, in their mode and with their gains, unless others are given; those beside the path
        stay as they are, and ``capture`` has them too. They are first brought to a hold where a waveform of points
        gives way to another, or anything to a move, which does not begin in the same tick as another path.

        The path runs on the model first, in the simulator; ``on_rehearsed`` is given, before anything moves, the error
        of each axis there, which is ``predicted`` among the figures. Raises BadInput for a path that mode, limits or
        model do not allow or that ends in a fault there, DeviceFault (its ``capture`` holds what was recorded) when the
        device latches a fault.
        """
        waveforms = given_waves(wave, axis, {"x": x, "y": y, "z": z})
        known = load_learned(learned) if isinstance(learned, str | os.PathLike) else learned
        mode = mode or (self._mode_now() if known is None else known.mode)
        stage = self._own_model(waveforms, mode) if model is None else as_stage(model)
        path = _output(output, overwrite)
        held = held_stage(self.device) if stage is None else None
        chosen = {name: gains_in_mode(mode, gains, stage or held, name) for name in waveforms}
        if known is not None:
            chosen = chosen if gains is not None else known.gains()
            sha256 = held_sha256(self.device) if stage is None else stage.sha256
            waveforms = known.waveforms(_as_tables(waveforms), sha256, mode, chosen, follows)
        given, stage = stage, stage if known is None else known.model_played(stage)
        if hold:
            _refuse_to_hold(mode, own_modes=stage is not given)
        new_gains = chosen if known is not None and mode.endswith("pid") else gains
        going_on = go_on(self._mover, waveforms, mode, stage, new_gains, force=force)
        if going_on is None:
            said = unknown_warning(self.device, stage or held, mode, gains_given=gains is not None)
            said += _said_against(waveforms, mode, chosen, stage, held, force=force)
        else:
            self.watch_over()
            chosen = {name: going_on.gains[name] for name in waveforms}
            said = going_on.said + _said_of_paths(waveforms, mode, stage, stage or held)

        def rehearsed(predicted: Mapping[str, Predicted]) -> None:
            _warn(said, above=5)
            if on_rehearsed is not None:
                on_rehearsed(predicted)

        run = track_to_file(
            self.device,
            waveforms,
            mode,
            output=path,
            stage=stage,
            gains=chosen,
            duration_s=quantity("duration", duration, IN_SECONDS),
            force=force,
            follows=follows or "true",
            on_progress=on_progress,
            trigger_out=trigger_out,
            gains_given=gains is not None,
            on_rehearsed=rehearsed,
            edge_within_s=quantity("trigger_in", trigger_in, IN_SECONDS),
            park=not hold,
            going_on=going_on,
        )
        if hold:
            if going_on is None:
                hold_on(self._mover, stage, stage or held, mode, chosen)
            self._alive.begin()
            self.model = stage or self.model
        elif going_on is not None:
            self.let_go()
        if given is not None and stage is not given:
            self.device.upload_if_other(device_model(given))
        recording = _named(run.recording, path or wave_text(wave, x, y, z))
        return replace(run, recording=recording if path is None else replace(recording, sha256=file_sha256(path)))

    def learn(
        self,
        wave: WavesLike | None = None,
        *,
        mode: str = "inverse+pid",
        axis: str | None = None,
        x: WaveLike | None = None,
        y: WaveLike | None = None,
        z: WaveLike | None = None,
        model: StageLike | None = None,
        gains: GainsLike | Mapping[str, GainsLike] | None = None,
        trials: int = 10,
        follows: Follows = "true",
        force: bool = False,
        save: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        on_progress: Progress | None = None,
        on_rehearsed: OnRehearsed | None = None,
    ) -> Learned:
        """Drives along a periodic path up to ``trials`` times, each time corrected by the error that repeats; keeps the
        best. Give the result to ``track(learned=...)``, or ``save`` it.

        Paths, ``mode`` (inverse+pid, or inverse for the voltage alone), ``model``, ``gains``, ``follows`` and ``force``
        as for ``track``; the model's own gains are turned down where that does not leave more of what changes from
        period to period, in the end to a loop against drift alone, and the result keeps them. Where the first trial
        shows that the modes have moved, the result comes with the inverse of where they are. The error is against the
        path that was asked for; every trial runs on the model first, but for one that only the device holds, whose
        modes cannot be read back. ``on_rehearsed`` as for ``track``, of the path before anything is learned. ``save``
        is a folder that keeps the run of every trial; one that holds recordings is written over only with
        ``overwrite``. Raises BadInput as ``track`` does, and for a move.
        """
        waveforms = _as_tables(given_waves(wave, axis, {"x": x, "y": y, "z": z}))
        stage = self._own_model(waveforms, mode) if model is None else as_stage(model)
        held = held_stage(self.device) if stage is None else None
        chosen = {name: gains_of(gains, stage or held, name) for name in waveforms}
        _warn(_said_against(waveforms, mode, chosen, stage, held, force=force), above=3)
        found = learn(
            self.device,
            waveforms,
            mode,
            stage=stage,
            gains=chosen,
            trials=trials,
            follows=follows,
            force=force,
            turn_down=gains is None,
            kept=KeptRuns(save, overwrite=overwrite),
            on_progress=on_progress,
            on_rehearsed=on_rehearsed,
        )
        return replace(found, wave=wave_text(wave, x, y, z))

    def record(
        self,
        drive: WavesLike | None = None,
        *,
        axis: str | None = None,
        duration: Quantity | None = None,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        on_progress: Progress | None = None,
    ) -> Recording:
        """Records what the device does, open loop; needs no model.

        ``drive`` is played in volts meanwhile ("sine:5V@5Hz"); without one it only listens on ``axis``. ``duration`` in
        s; default ten periods, or 1 s when only listening. ``output`` (.h5) keeps the record on disk, with the raw
        codes that a replay needs; one that exists is written over only with ``overwrite``. Raises as ``track`` does.
        """
        path, letters = _output(output, overwrite), "".join(parse_axes(axis or "x", "axis"))
        waveforms = None if drive is None else given_waves(drive, axis, {})
        _warn(path_warnings(waveforms or {}), above=3)
        recording = record_open_loop(
            self.device,
            waveforms,
            letters,
            output=path,
            stage=None if waveforms is None else self._own_model(waveforms, "open"),
            duration_s=quantity("duration", duration, IN_SECONDS),
            on_progress=on_progress,
        )
        return _named(recording, path or wave_text(drive) or f"{letters} at rest")


def _refuse_to_hold(mode: str, *, own_modes: bool) -> None:
    """Where a path has no end to be held at. ``own_modes``: it is played by another model than the given one, which
    comes back when it is parked."""
    if mode == "open":
        raise BadInput("mode open holds no position: leave out hold, or choose another mode")
    if own_modes:
        raise BadInput("this learned table comes with modes of its own and ends parked: leave out hold")


def _said_against(
    waveforms: Mapping[str, Waveform],
    mode: str,
    gains: dict[str, Gains],
    stage: Stage | None,
    held: Stage | None,
    *,
    force: bool,
) -> list[str]:
    """What there is to say of loop and path before anything moves. Raises BadInput for what is refused."""
    of_paths = _said_of_paths(waveforms, mode, stage, stage or held)
    return [*low_gains_warning(stage, held, mode, gains), *loop_warnings(stage, mode, gains, force=force), *of_paths]


def _said_of_paths(waveforms: Mapping[str, Waveform], mode: str, stage: Stage | None, known: Stage | None) -> list[str]:
    if known is None or set(waveforms) <= set(known.axes):
        check_paths(waveforms, mode, known)
    return path_warnings(followed(waveforms, stage, "measured", mode))


def _warn(said: Sequence[str], *, above: int) -> None:
    """To who called the method, so many calls above."""
    for line in said:
        warnings.warn(line, stacklevel=above)


def _as_tables(waveforms: Mapping[str, Waveform]) -> dict[str, Waveform]:
    """What is learned is a table."""
    return {axis: of_table(waveform) for axis, waveform in waveforms.items()}


def _named(recording: Recording, name: str) -> Recording:
    return replace(recording, source=name)


def _output(output: str | os.PathLike[str] | None, overwrite: bool) -> str | None:
    path = None if output is None else os.fspath(output)
    check_output(path, suffixes=RUN_SUFFIXES, overwrite=overwrite)
    return path
