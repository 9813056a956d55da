"""A device from Python: every command of the command line that needs one, as a method; parked on the way out."""

from __future__ import annotations

import atexit
import contextlib
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Self

from phaselead import interrupt
from phaselead.control.doctor import Diagnosis, diagnose
from phaselead.control.gains import GainsLike, gains_of, own_loop_warnings, with_gains
from phaselead.control.held import held_sha256, held_stage, held_warning
from phaselead.control.journal import record_open_loop, track_to_file
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning import Learned, learn, load_learned
from phaselead.control.playing import Plays
from phaselead.control.run import Run
from phaselead.control.supervision import Supervision
from phaselead.control.tracking import assumed_limits, loop_warnings, path_warnings
from phaselead.control.true_position import Follows
from phaselead.control.tuning import Tunes
from phaselead.control.uploaded import Upload
from phaselead.control.wave_arguments import WaveLike, WavesLike, given_waves, wave_text
from phaselead.device import (
    BAUD,
    IDS_RESERVED,
    TICK_HZ,
    Device,
    SelfTest,
    StatusInUnits,
    device_model,
    held_back,
    park_quietly,
    recall,
    remember,
    selftest,
    status_in_units,
)
from phaselead.errors import BadInput, LinkError, PhaseleadError
from phaselead.model import StageLike, as_stage
from phaselead.record import RUN_SUFFIXES, Recording, check_output, file_sha256, parse_axes
from phaselead.result import Facts
from phaselead.serial_ports import default_port

if TYPE_CHECKING:
    from phaselead.identify import FitResult

Progress = Callable[[float], None]
"""Is given the fraction done, now and then."""


def connect(url: str | None = None, *, baud: int = BAUD, park_on_exit: bool = True, resume: bool = False) -> Controller:
    """Opens a port and a session on the device there; use it with ``with``, so that it is parked whatever happens.

    ``url`` is a serial port ("/dev/ttyACM0"), "sim://xyz250", "sim://STAGE.toml" or "qemu://BOARD"; without one it is
    ``$PHASELEAD_PORT``, else "sim://xyz250". Each opening of a virtual stage is a fresh one at rest.
    ``park_on_exit=False`` leaves the device as it is, as ``phaselead arm`` does. ``resume`` goes on with a session that
    ``leave_running`` left on this port, if there is one.

    Raises LinkError (the port is missing, busy or silent), DeviceRefused (another host drives the device) or BadInput
    (the URL makes no sense).

    >>> import phaselead as pl
    >>> with pl.connect("sim://xyz250") as dev:
    ...     print(dev.status().state)
    parked
    """
    name = url or default_port()
    left = recall(name) if resume else None
    if left is None:
        return Controller(Device.open(name, baud=baud, park_on_exit=park_on_exit))
    remember(name, replace(left, last_id=(left.last_id + IDS_RESERVED) % 0x10000))
    controller = Controller(Device.open(name, baud=baud, park_on_exit=park_on_exit, left=left))
    controller.take_up(left)
    return controller


class Controller(Plays, Tunes, Supervision):
    """A device and the model it was given. ``connect`` makes one.

    In a ``with`` block the outputs ramp to their safe value on the way out: at its end, on an exception, on Ctrl-C, and
    when the program is asked to end (SIGTERM, SIGHUP). One that is open when the interpreter ends is parked too. When
    the program is killed outright during a run, the device parks by itself after one second without a command.

    ``device`` is the ``Device`` below, for what has no method here. All methods raise DeviceRefused when the device
    says no, LinkError when it does not answer, and BadInput, before anything moves, for what makes no sense.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     fitted = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    ...     uploaded = dev.upload(fitted)
    ...     run = dev.track("sine:40um@5Hz", mode="inverse", duration=0.8)
    >>> run.mode, uploaded.bytes > 0
    ('inverse', True)
    """

    def __init__(self, device: Device) -> None:
        """Takes over an open device."""
        super().__init__(device)
        self._signals = contextlib.ExitStack()
        self._open = True
        atexit.register(self._at_exit)

    def __enter__(self) -> Self:
        self._signals.enter_context(interrupt.exit_on_signals())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._signals:
            self._leave(kind, error, trace)

    def close(self) -> None:
        """Parks the device and closes the port; a second time does nothing."""
        self._leave(None, None, None)

    def _leave(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self._open = False
            atexit.unregister(self._at_exit)
            self._alive.end()
            self._note_left()
            self.device.__exit__(kind, error, trace)
            if self.device.park_on_exit and kind is None:  # after an error it may stand where it stood
                remember(self.device.session.name, None)

    def _at_exit(self) -> None:
        with contextlib.suppress(PhaseleadError, OSError):
            self.close()

    def __repr__(self) -> str:
        return f"<Controller of {self.device.session.name}{'' if self._open else ', closed'}>"

    # ---------------------------------------------------------------- what it is and does

    def status(self) -> StatusInUnits:
        """What the device is doing, and where its axes stand in um and V; prints as a table."""
        return status_in_units(self.device)

    def info(self) -> Facts:
        """What the device is: build, wire, model, timing of its tick, last fault."""
        return Facts(self.device.info())

    def doctor(self) -> Diagnosis:
        """What is wrong, in words: link, timing, faults, model, limits, sensors. Nothing moves; takes half a second."""
        return diagnose(self.device)

    def arm(self, model_crc: int | str = 0, *, timeout: float = 0.0) -> StatusInUnits:
        """Output live at the safe value, until another command. A fallback model must be named by its CRC, as ``info``
        gives it. ``timeout``: seconds without a command after which the device parks by itself; 0: never."""
        try:
            crc = int(model_crc, 16) if isinstance(model_crc, str) else model_crc
        except ValueError:
            raise BadInput(f"{model_crc!r} is no CRC; info()['model_crc'] gives the model's") from None
        try:
            self.device.set_timeout(round(timeout * TICK_HZ))
            self.device.arm(crc)
            return status_in_units(self.device)
        except (KeyboardInterrupt, LinkError):
            park_quietly(self.device.session)
            raise

    def park(self) -> StatusInUnits:
        """Ramps every axis to its safe value, waits until it is there, and clears a latched fault."""
        self.device.park()
        self._alive.end()
        self._left = None
        remember(self.device.session.name, None)
        return status_in_units(self.device)

    def stop(self) -> int:
        """Begins the ramp to the safe value at once and does not wait for it. Returns the device's tick."""
        return self.device.stop()

    def reconnect(self, within_s: float = 10.0) -> bool:
        """Goes on after the cable was pulled or the device restarted, without another ``connect``.

        True: the device knows the session still; after a second of silence it has parked and latched host_timeout,
        which ``park`` clears. False: it has restarted and what it was given is gone (``track`` uploads its model
        again); one restarted by its watchdog has latched core_lost, which ``park`` clears too. The run that was broken
        off stays so. Raises LinkError when no device answers within ``within_s`` seconds.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     print(dev.reconnect())
        True
        """
        return self.device.reconnect(within_s)

    def selftest(self, axes: str = "xyz") -> SelfTest:
        """Tests a board whose DAC outputs are wired to its ADC inputs, the amplifier NOT connected: drives 0 to 9.5 V.

        Raises BadInput for axes that make no sense, PhaseleadError when the device holds a model.
        """
        return selftest(self.device, axes)

    # ---------------------------------------------------------------- the model

    def upload(self, model: StageLike, *, persist: bool = False, force: bool = False) -> Upload:
        """Uploads a model as one transaction, reads it back and compares; ``track`` uses it from then on.

        ``model`` is a stage, the result of a fit or a stage file's name. ``persist`` also writes it to flash, so that
        it survives a power cycle. Raises BadInput for a coefficient the device's formats cannot hold, and for gains of
        the model's own whose loop has a peak sensitivity above 6, unless ``force``; above 3 it warns, as it does where
        the model asks for more than the device's hard limits: the tighter of both hold.
        """
        stage = as_stage(model)
        for line in own_loop_warnings(stage, force=force):
            warnings.warn(line, stacklevel=2)
        blob = device_model(stage)
        crc = self.device.upload(blob)
        self.model = stage
        for line in held_back(self.device, stage):
            warnings.warn(line, stacklevel=2)
        return Upload(stage, len(blob), f"{crc:08x}", self.device.persist() if persist else None)

    def identify(
        self,
        axes: str = "x",
        *,
        model: StageLike | None = None,
        levels: Sequence[float] | None = None,
        frequencies: Sequence[float] | None = None,
        u_max: float | None = None,
        duration: float | None = None,
        creep: bool | None = None,
        save: str | os.PathLike[str] | None = None,
        resume: bool = False,
        overwrite: bool = False,
        on_progress: Progress | None = None,
    ) -> FitResult:
        """Runs the identification experiment, fits both views, designs gains, and verifies on held-out inputs.

        ``axes`` are letters, with or without commas ("xyz", "x,y"). Limits and calibration are those of ``model``,
        which is uploaded first, else of the model the device holds.

        The sines: ``levels`` in V, peak-to-peak, and ``frequencies`` in Hz, by default the paper's 8 of each;
        ``u_max`` (V) scales these levels so that the largest is this. In the end each axis rests for 40 s and holds
        5 V, or the largest level if that is less, for 12 s, which shows its creep; not with ``creep=False``.
        ``duration`` (s, of the device's time) thins the sines evenly until they take no longer; where they leave no
        time for the holds these are left out with a warning, or with ``creep=True`` the sines are thinned for them.
        ``save`` is a folder that keeps every recording as soon as it is there; ``resume`` goes on with those that it
        has, ``overwrite`` measures them again.
        Raises BadInput when the limits leave the experiment out or a record cannot be used.
        """
        from phaselead.identify import identify_device, keeping, plan_as_time_allows  # slow to load, needed here only

        letters = parse_axes(axes)
        stage = None if model is None else as_stage(model)
        if stage is None and (warning := assumed_limits(self.device)) is not None:
            warnings.warn(warning, stacklevel=2)
        plan, creeping, said = plan_as_time_allows(
            letters, creep=creep, duration_s=duration, levels_V=levels, f_Hz=frequencies, u_max_V=u_max
        )
        if said is not None:
            warnings.warn(said, stacklevel=2)
        with contextlib.ExitStack() as stack:
            kept = None
            if save is not None:
                holds = letters if creeping else ()
                kept = stack.enter_context(keeping(save, plan, holds, resume=resume, overwrite=overwrite))
            done = identify_device(self.device, letters, on_progress, plan=plan, kept=kept, stage=stage, creep=creeping)
            found = done.as_fit()
        return replace(found, model=with_gains(found.model))

    # ---------------------------------------------------------------- running

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
        duration: float | None = None,
        follows: Follows | None = None,
        learned: Learned | str | os.PathLike[str] | None = None,
        force: bool = False,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        trigger_out: str | None = None,
        trigger_in: float | None = None,
        on_progress: Progress | None = None,
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
        ``duration`` in s; default ten periods, or a move and a second.
        ``follows``: "true" (the default), where the model says by how much the sensor is late, makes the stage itself
        follow a periodic path, "measured" what the sensor shows. ``learned`` is what ``learn`` gave, or its file:
        played with its mode, gains and ``follows``, and refused for others, or another model or path.
        ``output`` (.h5) keeps the run on disk from the first tick on; one that exists is written over only with
        ``overwrite``. ``trigger_out`` says where the three trigger outputs pulse, the first one first: "start",
        "frame", "line", "pixel=256" (a line), "pixel=2ms", "pixel=0.5um" ("+0.5um": on the way up alone), "target" (a
        step has settled), joined by commas; "y:line" of another axis. ``run.triggers`` has the pulses. ``trigger_in``:
        the path begins at a rising edge of the trigger input, which is waited for so many seconds.

        The path runs on the model first, in the simulator. Raises BadInput for a path that mode, limits or model do not
        allow or that ends in a fault there, DeviceFault (its ``capture`` holds what was
        recorded) when the device latches a fault.
        """
        waveforms = given_waves(wave, axis, {"x": x, "y": y, "z": z})
        known = load_learned(learned) if isinstance(learned, str | os.PathLike) else learned
        mode = mode or ("ff+pid" if known is None else known.mode)
        stage = self._own_model(waveforms, mode) if model is None else as_stage(model)
        path = _output(output, overwrite)
        held = held_stage(self.device) if stage is None else None
        chosen = {name: gains_of(gains, stage or held, name) for name in waveforms}
        if known is not None:
            chosen = chosen if gains is not None else known.gains()
            sha256 = held_sha256(self.device) if stage is None else stage.sha256
            waveforms = known.waveforms(waveforms, sha256, mode, chosen, follows)
        for line in [
            *held_warning(held, mode, chosen),
            *loop_warnings(stage, mode, chosen, force=force),
            *path_warnings(waveforms),
        ]:
            warnings.warn(line, stacklevel=2)
        run = track_to_file(
            self.device,
            waveforms,
            mode,
            output=path,
            stage=stage,
            gains=chosen,
            duration_s=duration,
            force=force,
            follows=follows or "true",
            on_progress=on_progress,
            trigger_out=trigger_out,
            edge_within_s=trigger_in,
        )
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
    ) -> Learned:
        """Drives along a periodic path up to ``trials`` times, each time corrected by the error that repeats; keeps the
        best. Give the result to ``track(learned=...)``, or ``save`` it.

        Paths, ``mode`` (inverse+pid, or inverse for the voltage alone), ``model``, ``gains``, ``follows`` and ``force``
        as for ``track``. The error is against the path that was asked for; every trial runs on the model first, but for
        one that only the device holds, whose modes cannot be read back.
        ``save`` is a folder that keeps the run of every trial; one that holds recordings is written over only with
        ``overwrite``. Raises BadInput as ``track`` does, and for a move.
        """
        waveforms = given_waves(wave, axis, {"x": x, "y": y, "z": z})
        stage = self._own_model(waveforms, mode) if model is None else as_stage(model)
        held = held_stage(self.device) if stage is None else None
        chosen = {name: gains_of(gains, stage or held, name) for name in waveforms}
        for line in [
            *held_warning(held, mode, chosen),
            *loop_warnings(stage, mode, chosen, force=force),
            *path_warnings(waveforms),
        ]:
            warnings.warn(line, stacklevel=2)
        found = learn(
            self.device,
            waveforms,
            mode,
            stage=stage,
            gains=chosen,
            trials=trials,
            follows=follows,
            force=force,
            kept=KeptRuns(save, overwrite=overwrite),
            on_progress=on_progress,
        )
        return replace(found, wave=wave_text(wave, x, y, z))

    def record(
        self,
        drive: WavesLike | None = None,
        *,
        axis: str | None = None,
        duration: float | None = None,
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
        recording = record_open_loop(
            self.device,
            waveforms,
            letters,
            output=path,
            stage=None if waveforms is None else self._own_model(waveforms, "open"),
            duration_s=duration,
            on_progress=on_progress,
        )
        return _named(recording, path or wave_text(drive) or f"{letters} at rest")


def _named(recording: Recording, name: str) -> Recording:
    return replace(recording, source=name)


def _output(output: str | os.PathLike[str] | None, overwrite: bool) -> str | None:
    path = None if output is None else os.fspath(output)
    check_output(path, suffixes=RUN_SUFFIXES, overwrite=overwrite)
    return path
