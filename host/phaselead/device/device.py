"""One device, in the user's units: open, set up, run, capture, park."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import fields
from types import TracebackType
from typing import Any, Self
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.capture import Plan, Progress, QueuedPaths, Sink, Spool, capture
from phaselead.device.left_running import LeftRunning
from phaselead.device.parking import after_interrupt, fault_text, park_quietly, wait_parked
from phaselead.device.points import PointFeeder
from phaselead.device.quantities import (
    TICK_HZ,
    Converters,
    axis_request,
    converters,
    gains_request,
    path_request,
    wave_points,
)
from phaselead.device.regions import read_model, read_wave
from phaselead.device.session import FLASH_WAITS_S, PIECE_WAITS_S, Refused, Session, SessionLostError
from phaselead.device.status import DeviceStatus, fault_detail, name_of, target_of
from phaselead.device.stream import ALL_CHANNELS, AXES, Capture, axes_of, mask_of
from phaselead.errors import BadInput, DeviceRefused, LinkError
from phaselead.model import Gains, LoopFilter
from phaselead.serial_ports import BAUD, open_port

MODEL_IN_INFO_SINCE = 3
"""Revision of the wire. An older device tells it at the beginning of a session alone."""
LEARNED_SINCE = 5
"""Revision of the wire from which a device knows what a waveform was learned for."""
RETRY_S = 0.2
"""How often a port that has gone away is looked for."""


def axis_index(axis: str) -> int:
    """0, 1, 2 of "x", "y", "z". Raises BadInput for anything else."""
    if len(axis) != 1 or axis not in AXES:
        raise BadInput(f"axis {axis!r}: must be x, y or z")
    return AXES.index(axis)


class Device:
    """A session with one device. As a context manager it parks on the way out, Ctrl-C included, and closes.

    All methods raise DeviceRefused when the device says no and LinkError when it does not answer.
    """

    def __init__(self, session: Session, *, park_on_exit: bool = True, baud: int = BAUD) -> None:
        """Opens the session on a port that is open; ``Device.open`` is what most callers want."""
        self.session = session
        self.park_on_exit = park_on_exit
        self._baud = baud
        self.hello = session.hello()
        self._modes: dict[str, wire.Mode] = {}
        self.held_back = ""
        """Axes for which the device's hard limits are tighter than those of the model last uploaded."""
        self._waves: set[str] = set()
        """Axes whose path is a waveform, or may be."""
        self._converters: dict[str, Converters] | None = None
        """By the model in force, once they were asked for."""

    @classmethod
    def open(cls, url: str, *, baud: int = BAUD, park_on_exit: bool = True, left: LeftRunning | None = None) -> Self:
        """Opens the port exclusively and a session on it: a new one, or one that was ``left`` running."""
        port = open_port(url, baud=baud)
        try:
            session = Session(port, url) if left is None else Session(port, url, nonce=left.nonce, last_id=left.last_id)
            return cls(session, park_on_exit=park_on_exit, baud=baud)
        except BaseException:
            port.close()
            raise

    def reconnect(self, within_s: float = 10.0, *, pause: Callable[[float], None] = time.sleep) -> bool:
        """Goes on after the port went away or the device restarted: opens the port again, as soon as it is there.

        True: the device still knows this session, and modes and paths are as they were; but when it has heard nothing
        for longer than its timeout it has parked and latched host_timeout. False: it has restarted, or another host had
        it, and a new session has begun: no modes, no paths, no waveforms, of models the one in flash, and after a
        restart by the watchdog a latched core_lost.
        A recording never goes on: it ended where the link did.

        Raises:
            LinkError: no device answers within ``within_s`` seconds.
            DeviceRefused: another host drives it now.
        """
        tries = max(1, round(within_s / RETRY_S))
        for left in reversed(range(tries)):
            try:
                return self._find_again()
            except LinkError:
                if left == 0:
                    raise
            pause(RETRY_S)
            with contextlib.suppress(OSError):
                self.session.port.close()
            with contextlib.suppress(LinkError):
                self.session.reopen(open_port(self.session.name, baud=self._baud))
        return False

    def _find_again(self) -> bool:
        try:
            self._converters = None
            self.session.request(wire.StatusRequest(), PIECE_WAITS_S)
            return True
        except SessionLostError:
            self.hello = self.session.renew()
            self._modes.clear()
            self._waves.clear()
            return False

    @staticmethod
    def stop_now(url: str, *, baud: int = BAUD) -> wire.StopReply:
        """Ramps every axis to its safe value, whoever drives the device: STOP needs no session."""
        port = open_port(url, baud=baud)
        try:
            return Session(port, url).request(wire.StopRequest())
        finally:
            port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self.park_on_exit and kind is not None:
                park_quietly(self.session)
                if isinstance(error, KeyboardInterrupt) and not error.args:
                    error.args = (after_interrupt(self.session),)
            elif self.park_on_exit:
                self._park_unless_at_rest()
        finally:
            self.close()

    def _park_unless_at_rest(self) -> None:
        try:
            if self.status().state not in ("parked", "fault"):
                self.park()
        except KeyboardInterrupt:
            park_quietly(self.session)
            raise

    def close(self) -> None:
        """Closes the port and leaves the device as it is."""
        with contextlib.suppress(OSError):
            self.session.port.close()

    # ---------------------------------------------------------------- what it is and does

    def status(self) -> DeviceStatus:
        """What the device is doing; also feeds its host timeout."""
        return DeviceStatus.of(self.session.request(wire.StatusRequest()))

    def info(self) -> dict[str, Any]:
        """What the device is: build, wire, model, timing of its tick, last fault."""
        hello, r = self.hello, self.session.request(wire.InfoRequest())
        model = r if hello.wire_revision >= MODEL_IN_INFO_SINCE else hello  # that of before says how it began
        return {
            "port": self.session.name,
            "target": target_of(hello.target),
            "build_id": hello.build_id.hex(),
            "wire": f"{hello.wire_version}.{hello.wire_revision}",
            "wire_fingerprint": f"{hello.schema_fingerprint:08x}",
            "tick_rate_Hz": hello.tick_rate_Hz,
            "baud": hello.baud,
            "axes": hello.axis_count,
            "reset_cause": name_of(wire.ResetCause, hello.reset_cause),
            "model_loaded": bool(model.model_flags & 1),
            "model_is_fallback": bool(model.model_flags & 2),
            "model_persisted": bool(model.model_flags & 4),
            "model_crc": f"{model.model_crc:08x}",
            "cycles_last": r.cycles_last,
            "cycles_max": r.cycles_max,
            "cycles_histogram": list(r.histogram),
            "overruns": r.overruns,
            "latched_late": r.latched_late,
            "lost_ticks": r.lost_ticks,
            "brown_out_level": r.brown_out_level,
            "last_fault": name_of(wire.Fault, r.last_fault),
            "last_fault_detail": fault_detail(r.last_fault, r.last_fault_detail),
            "flash_record": r.flash_sequence,
        }

    # ---------------------------------------------------------------- states

    def arm(self, model_crc: int = 0) -> int:
        """parked -> armed; a fallback model must be named by ``model_crc``. Returns the tick."""
        return self.session.request(wire.ArmRequest(model_crc)).tick

    def start(self, axes: str = "x") -> int:
        """armed -> running: the paths of these axes begin together. Returns the tick in which they do."""
        for axis in axes:
            axis_index(axis)
        return self.session.request(wire.StartRequest(mask_of(axes))).first_tick

    def park(self, *, clear_fault: bool = True) -> None:
        """Ramps every axis to its safe value, waits until it is there, then clears a latched fault."""
        self.session.request(wire.ParkRequest())
        status = wait_parked(self.session)
        if status.state != wire.State.FAULT:
            return
        if not clear_fault:
            raise DeviceRefused(fault_text(status))
        while status.at_rest != mask_of(AXES):
            self.session.pump(64)
            status = self.session.request(wire.StatusRequest())
        self.session.request(wire.ClearFaultRequest())

    def stop(self) -> int:
        """Begins the ramp to the safe value at once and does not wait for it."""
        return self.session.request(wire.StopRequest()).tick

    def set_timeout(self, ticks: int) -> None:
        """Ticks without a command after which a device that is not parked ramps to park; 0: never."""
        self.session.request(wire.SetTimeoutRequest(ticks))

    def wait(self, seconds: float) -> DeviceStatus:
        """Lets the device run for so much of its own time, feeding its host timeout; the last status."""
        status = self.status()
        end = status.tick + round(seconds * TICK_HZ)
        while status.tick < end:
            self.session.pump(64)
            status = self.status()
        return status

    # ---------------------------------------------------------------- what an axis does

    def mode(self, axis: str) -> wire.Mode | None:
        """Of an axis, as this session has set it; None before."""
        return self._modes.get(axis)

    def take_over(self, axes: str, mode: wire.Mode | str) -> None:
        """Axes that a program before this one has set to ``mode``, in this session."""
        self._modes |= dict.fromkeys(axes, mode_of(mode))
        self._waves |= set(axes)

    def set_axis(
        self,
        axis: str,
        mode: wire.Mode | str,
        *,
        kp_V_per_um: float = 0.0,
        ki_V_per_um_s: float = 0.0,
        kd_V_s_per_um: float = 0.0,
        derivative_filter_Hz: float | None = None,
        filters: Sequence[LoopFilter] | None = None,
    ) -> None:
        """Mode, gains and filters of one axis; while parked or armed. ``mode`` by value or by name ("ff+pid" too).

        Raises:
            BadInput: a gain or a filter its format cannot hold, with the figure; an unknown mode.
        """
        chosen = mode_of(mode)
        index = axis_index(axis)
        self.session.request(
            axis_request(index, chosen, kp_V_per_um, ki_V_per_um_s, kd_V_s_per_um, derivative_filter_Hz, filters or ())
        )
        self._modes[axis] = chosen
        self._waves.discard(axis)  # the device has dropped the path with the mode

    def set_gains(self, axis: str, gains: Gains) -> None:
        """Gains and filters of one axis, also while it runs: its output goes on from where it is. Raises as
        ``set_axis``."""
        given = gains.sent()
        given["filters"] = given["filters"] or ()
        self.session.request(gains_request(axis_index(axis), **given))

    def set_path(
        self,
        axis: str,
        kind: wire.PathKind | str,
        *,
        swing: float = 0.0,
        offset: float = 0.0,
        f_Hz: float = 0.0,
        ticks: int = 0,
    ) -> wire.SetPathReply:
        """Reference of one axis; while parked or armed, after ``set_axis``. V in mode open, else um.

        ``swing`` is peak-to-peak, rising from ``offset``; a move goes by ``swing`` from ``offset`` in
        ``ticks``. ``ticks`` 0 is for ever. Returns the gain and lead the device looked up.
        """
        asked = self._path_asked(axis, kind, swing, offset, f_Hz, ticks)
        reply = self.session.request(asked)
        (self._waves.add if asked.path == wire.PathKind.WAVE else self._waves.discard)(axis)
        return reply

    def _path_asked(
        self, axis: str, kind: wire.PathKind | str, swing: float, offset: float, f_Hz: float, ticks: int
    ) -> wire.SetPathRequest:
        """In the unit of the mode that this session has set."""
        volts = self._modes.get(axis, wire.Mode.IDLE) == wire.Mode.OPEN
        return path_request(axis_index(axis), path_kind(kind), swing, offset, f_Hz, ticks, volts)

    def path_segment(
        self,
        axis: str,
        kind: wire.PathKind | str,
        *,
        swing: float = 0.0,
        offset: float = 0.0,
        f_Hz: float = 0.0,
        ticks: int = 0,
        enter_ticks: int = 0,
        leave_ticks: int = 0,
    ) -> wire.Segment:
        """A path as ``set_path`` has it, for the queue of an axis in the mode that this session has set: it is entered
        and left in so many ticks, a move at once from where the axis is then. Raises BadInput."""
        asked = self._path_asked(axis, kind, swing, offset, f_Hz, ticks)
        if asked.path == wire.PathKind.WAVE:
            self._waves.add(axis)
        timing = asked.step_turn64, asked.ticks
        if asked.path == wire.PathKind.MOVE:
            return wire.Segment(asked.path, wire.PathFlag.FROM_HERE, asked.swing + asked.offset, 0, *timing, 0, 0)
        return wire.Segment(asked.path, 0, asked.swing, asked.offset, *timing, enter_ticks, leave_ticks)

    def upload_wave(self, axis: str, points: NDArray[np.float64]) -> None:
        """One period of a waveform, 1024 points of 0 .. 1 of the swing; while the axis neither plays its waveform nor
        has it in its queue, else Refused. It is read back."""
        self._send_wave(axis, points, 0, 0)

    def upload_learned(
        self, axis: str, points: NDArray[np.float64], *, swing: float, offset: float, f_Hz: float
    ) -> None:
        """The same of points that were learned for this path, um, in the mode that is set, with the model that the
        device holds: it refuses them for every other path, mode or model, whoever asks; one that holds no model for
        every other path or mode. One whose firmware is of before revision 5 of the wire leaves that to its host."""
        if self.hello.wire_revision < LEARNED_SINCE:
            return self.upload_wave(axis, points)
        index, now = axis_index(axis), self.session.request(wire.StatusRequest())
        path = path_request(index, wire.PathKind.WAVE, swing, offset, f_Hz, 0, volts=False)
        own = struct.pack("<BiiQ", now.modes[index], path.swing, path.offset, path.step_turn64)
        return self._send_wave(axis, points, now.model_crc, crc32(own))

    def _send_wave(self, axis: str, points: NDArray[np.float64], model_crc: int, path_crc: int) -> None:
        index, data = axis_index(axis), wave_points(points)

        def send(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
            self.session.request(wire.WaveChunkRequest(index, at // 4, data[at : at + length]), waits_s)
            return at + length, len(data)

        self.session.transfer(send)
        self.session.request(wire.WaveCommitRequest(index, crc32(data), model_crc, path_crc))
        if read_wave(self.session, axis) != data:
            raise LinkError(f"the waveform read back from axis {axis} differs from the one sent; try again")

    # ---------------------------------------------------------------- the model

    def upload(self, model: bytes) -> int:
        """Uploads a model blob as one transaction and reads it back; while parked. Returns its CRC-32.

        Raises:
            Refused: a field failed the device's checks; the message names it. The old model stays.
            LinkError: what was read back differs.
        """
        request, self._converters = self.session.request, None
        request(wire.ModelBeginRequest(len(model), crc32(model)))

        def send(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
            request(wire.ModelChunkRequest(at, model[at : at + length]), waits_s)
            return at + length, len(model)

        self.session.transfer(send)
        try:
            self.held_back = axes_of(request(wire.ModelCommitRequest()).held_back)
        except Refused as refusal:
            if refusal.status != wire.Status.MODEL_INVALID or not isinstance(refusal.reply, wire.ModelCommitReply):
                raise
            field = model_field(refusal.reply.invalid_field)
            detail = f"{field} failed its checks; the old model stays"
            if "dac_" in field:
                detail = (
                    f"{field} contradicts the DAC: the present output would jump to another code at once; correct "
                    "u_min_V and u_max_V of [actuator] (they are the volts at codes 0 and 65536); the old model stays"
                )
            if field.endswith("flags"):
                detail += ": the firmware is older than a part of this model; flash today's (`phaselead flash`)"
            raise Refused(refusal.command, refusal.status, refusal.reply, detail) from None
        self._modes.clear()  # the device has reset its axes
        self._waves.clear()
        if self.read_model() != model:
            raise LinkError("the model read back differs from the one sent; upload it again before arming")
        return crc32(model)

    def upload_if_other(self, model: bytes) -> None:
        """Uploads a model to RAM unless the device holds this very one."""
        if not self.holds(model):
            self.upload(model)

    def holds(self, model: bytes) -> bool:
        """Whether this very model is the active one."""
        return int(self.status().model_crc, 16) == crc32(model)

    def read_model(self) -> bytes | None:
        """The active model blob, None when there is none."""
        return read_model(self.session)

    def persist(self) -> int:
        """Writes the active model to flash; while parked; takes seconds. Returns the record's number."""
        return self.session.request(wire.ModelPersistRequest(), FLASH_WAITS_S).sequence

    def converters(self) -> dict[str, Converters]:
        """What the converter codes of each axis mean, by the active model."""
        if self._converters is None:
            self._converters = converters(self.read_model())
        return self._converters

    # ---------------------------------------------------------------- recording

    def capture(
        self,
        ticks: int,
        *,
        axes: str = "x",
        start_axes: str = "",
        channels: int = ALL_CHANNELS,
        decimation: int = 1,
        start: bool = True,
        park: bool = True,
        model_crc: int = 0,
        lead_ticks: int = 0,
        tail_ticks: int = 0,
        progress: Progress | None = None,
        sink: Sink | None = None,
        spool: Spool | None = None,
        feeder: PointFeeder | None = None,
        queued: QueuedPaths | None = None,
    ) -> Capture:
        """Streams the chosen axes while their paths run for ``ticks`` ticks.

        The stream begins first; then, if ``start``, the device is armed and the paths of ``start_axes`` (empty: of all
        ``axes``) begin together; in the end, if ``park``, it is parked before the stream ends. The record begins
        ``lead_ticks`` before the paths, and ``tail_ticks`` pass after it before parking. ``progress`` gets the ticks
        done now and then, ``sink`` every received chunk as it is (for a journal). A ``spool`` takes chunks and commands
        in its place, and the capture then holds neither: for one that is larger than the memory. ``feeder`` sends
        points of the paths meanwhile. ``queued``: the paths that begin, where they are not those that were set. On
        Ctrl-C and on errors the device is parked before the exception goes on; axes that were held before stay so where
        their paths are refused, or hold where no edge came, after which none begins the paths any more.

        Raises:
            DeviceFault: a fault latched; its ``capture`` holds what was recorded. RanDry, one of them, when points
                came too late.
            NoEdge: none came at the trigger input.
        """
        if ticks < 1 or not axes or len(set(axes)) != len(axes):
            raise BadInput(f"a capture of {ticks} ticks of axes {axes!r}: at least one tick, each axis once")
        for axis in axes + start_axes:
            axis_index(axis)
        waves = "".join(sorted(self._waves))
        plan = Plan(
            ticks,
            axes,
            channels,
            decimation,
            start,
            park,
            model_crc,
            waves,
            spool,
            start_axes,
            lead_ticks,
            tail_ticks,
            feeder,
            queued,
        )
        return capture(self.session, self.hello, plan, progress, sink)


def mode_of(mode: wire.Mode | str) -> wire.Mode:
    """A mode by value or name; "ff+pid" is ff_pid."""
    if isinstance(mode, wire.Mode):
        return mode
    name = mode.replace("+", "_").upper()
    if name not in wire.Mode.__members__:
        raise BadInput(
            f"mode {mode!r}: must be one of {', '.join(m.name.lower().replace('_', '+') for m in wire.Mode)}"
        )
    return wire.Mode[name]


def path_kind(kind: wire.PathKind | str) -> wire.PathKind:
    """A kind of path by value or name. Raises BadInput."""
    if isinstance(kind, wire.PathKind):
        return kind
    if kind.upper() not in wire.PathKind.__members__:
        raise BadInput(f"path {kind!r}: must be one of {', '.join(k.name.lower() for k in wire.PathKind)}")
    return wire.PathKind[kind.upper()]


def model_field(number: int) -> str:
    """The field that ``invalid_field`` means: 100 x axis + the field's number, counted from 1."""
    names = [field.name for field in fields(wire.AxisModel)]
    axis, at = divmod(number, 100)
    return (
        f"axis {AXES[axis]}, {names[at - 1]}" if axis < 3 and 1 <= at <= len(names) else f"the model's head ({number})"
    )
