"""A device from Python: every command of the command line that needs one, as a method; parked on the way out."""

from __future__ import annotations

import atexit
import contextlib
import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Self

from phaselead import interrupt
from phaselead.control.doctor import Diagnosis, diagnose
from phaselead.control.gains import own_loop_warnings, with_gains
from phaselead.control.running import Runs
from phaselead.control.supervision import Supervision
from phaselead.control.tracking import assumed_limits
from phaselead.control.tuning import Tunes
from phaselead.control.uploaded import Upload, without_inverse
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
from phaselead.quantity import HERTZ, IN_SECONDS, VOLTS, Quantities, Quantity, quantities, quantity, required
from phaselead.record import parse_axes
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


class Controller(Runs, Tunes, Supervision):
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

    def arm(self, model_crc: int | str = 0, *, timeout: Quantity = 0.0) -> StatusInUnits:
        """Output live at the safe value, until another command. A fallback model must be named by its CRC, as ``info``
        gives it. ``timeout``: seconds without a command after which the device parks by itself; 0: never."""
        try:
            crc = int(model_crc, 16) if isinstance(model_crc, str) else model_crc
        except ValueError:
            raise BadInput(f"{model_crc!r} is no CRC; info()['model_crc'] gives the model's") from None
        seconds = required("timeout", timeout, IN_SECONDS)
        try:
            self.device.set_timeout(round(seconds * TICK_HZ))
            self.device.arm(crc)
            return status_in_units(self.device)
        except (KeyboardInterrupt, LinkError):
            park_quietly(self.device.session)
            raise

    def park(self) -> StatusInUnits:
        """Ramps every axis to its safe value, waits until it is there, and clears a latched fault."""
        self.device.park()
        self.let_go()
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
        the model asks for more than the device's hard limits: the tighter of both hold. It
        warns as well of axes that the device holds no inverse of, and says why.
        """
        stage = as_stage(model)
        for line in own_loop_warnings(stage, force=force):
            warnings.warn(line, stacklevel=2)
        blob = device_model(stage)
        crc = self.device.upload(blob)
        self.model = stage
        for line in [*held_back(self.device, stage), *without_inverse(stage)]:
            warnings.warn(line, stacklevel=2)
        return Upload(stage, len(blob), f"{crc:08x}", self.device.persist() if persist else None)

    def identify(
        self,
        axes: str = "x",
        *,
        model: StageLike | None = None,
        levels: Quantities | None = None,
        frequencies: Quantities | None = None,
        u_max: Quantity | None = None,
        duration: Quantity | None = None,
        creep: bool | None = None,
        save: str | os.PathLike[str] | None = None,
        resume: bool = False,
        overwrite: bool = False,
        on_progress: Progress | None = None,
    ) -> FitResult:
        """Runs the identification experiment, fits both views, designs gains, and verifies on held-out inputs.

        ``axes`` are letters, with or without commas ("xyz", "x,y"). Limits and calibration are those of ``model``,
        which is uploaded first, else of the model the device holds.

        The sines: ``levels`` in V, peak-to-peak (or "1V,500mV"), and ``frequencies`` in Hz, by default the paper's 8 of
        each; ``u_max`` (V) scales these levels so that the largest is this. In the end each axis rests for 40 s and
        holds 5 V, or the largest level if that is less, for 12 s, which shows its creep; not with ``creep=False``.
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
            letters,
            creep=creep,
            duration_s=quantity("duration", duration, IN_SECONDS),
            levels_V=quantities("levels", levels, VOLTS),
            f_Hz=quantities("frequencies", frequencies, HERTZ),
            u_max_V=quantity("u_max", u_max, VOLTS),
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
