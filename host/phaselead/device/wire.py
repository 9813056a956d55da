# generated from protocol/schema.toml by protocol/generate.py
"""Every message, record and enumeration of the wire; docs/wire.md says them in words.

Fields hold plain numbers even where an enumeration exists, so that a value unknown to this version survives.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Generic, Self, TypeVar

from phaselead.errors import LinkError

FINGERPRINT = 0xD1C20CFC
VERSION = 2
REVISION = 5
"""Of the version: what was added to it, which one that speaks an earlier revision does not know."""
MAX_PAYLOAD = 1152
REPLY_BIT = 0x80
HEADER = struct.Struct("<BHQ")
"""type, id, session"""
REPLY_HEAD = struct.Struct("<BQ")
"""status, tick"""
CHANNEL_DTYPES = {
    "reference": "<i4",
    "adc": "<u2",
    "dac": "<u2",
    "feedforward": "<i2",
    "feedback": "<i2",
    "trigger": "<u1",
}
"""Of one axis in one tick of a samples batch, in the order of Channel's bits."""


class WireError(LinkError):
    """A payload that is not the message it claims to be, or a value its field cannot hold."""


class Message:
    """What all messages and records share. ``SIZE`` is the fixed part's; ``TAIL``: bytes follow it."""

    __slots__ = ()
    NAME: ClassVar[str]
    NUMBER: ClassVar[int]
    SIZE: ClassVar[int]
    LEAST: ClassVar[int | None] = None
    """SIZE without the fields that revisions added, where there are such."""
    TAIL: ClassVar[bool] = False
    PLATFORM: ClassVar[frozenset[str]] = frozenset()
    """Fields that may differ between builds of the same source."""

    def pack(self) -> bytes:
        """Payload bytes. Raises WireError for a value its field cannot hold."""
        raise NotImplementedError

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """The message of these payload bytes. Raises WireError when their number is wrong."""
        raise NotImplementedError

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        """As long as this revision knows it: what is missing is zero, what is beyond is left out. Raises WireError."""
        size, least = len(payload), cls.SIZE if cls.LEAST is None else cls.LEAST
        if size < least or (cls.TAIL and size > MAX_PAYLOAD):
            at_least = "at least " if size < least else ""
            raise WireError(f"{cls.NAME}: {at_least}{least} bytes expected, got {size}")
        return payload if cls.TAIL else payload[: cls.SIZE].ljust(cls.SIZE, bytes(1))


class Record(Message):
    """A part of a message: always of its full size."""

    __slots__ = ()

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        if len(payload) != cls.SIZE:
            raise WireError(f"{cls.NAME}: {cls.SIZE} bytes expected, got {len(payload)}")
        return payload


class Reply(Message):
    """Begins with these two, whatever the command."""

    __slots__ = ()
    status: int
    tick: int


R = TypeVar("R", bound=Reply)


class Command(Message, Generic[R]):
    """A request; ``REPLY`` is the class of its answer, ``REFUSALS`` what a status means for this one alone."""

    __slots__ = ()
    REPLY: ClassVar[type[Any]]
    REFUSALS: ClassVar[dict[int, str]] = {}

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        """As of every message, but what is beyond must be zero: it would be obeyed in part."""
        if not cls.TAIL and any(payload[cls.SIZE :]):
            raise WireError(f"{cls.NAME}: {cls.SIZE} bytes expected, got {len(payload)}")
        return super().fitted(payload)


def _pack(name: str, layout: struct.Struct, *values: Any) -> bytes:
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise WireError(f"{name}: {error}") from None


def _exactly(name: str, value: bytes, size: int) -> bytes:
    if len(value) != size:  # struct would cut or pad in silence
        raise WireError(f"{name}: {size} bytes expected, got {len(value)}")
    return value


def _tail(cls: type[Message], value: bytes) -> bytes:
    if cls.SIZE + len(value) > MAX_PAYLOAD:
        raise WireError(f"{cls.NAME}: {len(value)} bytes do not fit, at most {MAX_PAYLOAD - cls.SIZE}")
    return value


class State(IntEnum):
    """Supervisor state."""

    PARKED = 0
    ARMED = 1
    RUNNING = 2
    STOPPING = 3
    FAULT = 4


class Mode(IntEnum):
    """What drives an axis."""

    IDLE = 0
    OPEN = 1
    PID = 2
    FF = 3
    FF_PID = 4
    INVERSE = 5
    INVERSE_PID = 6


class PathKind(IntEnum):
    """Reference path of an axis; in mode open its values are volts (q24), else micrometres (q16)."""

    HOLD = 0
    SINE = 1
    WAVE = 2
    MOVE = 3


class PathFlag(IntEnum):
    """Bits of a path's flags."""

    FROM_HERE = 1
    MORE = 2


class Status(IntEnum):
    """First byte of every reply."""

    OK = 0
    NO_SESSION = 1
    UNKNOWN_COMMAND = 2
    BAD_LENGTH = 3
    WRONG_STATE = 4
    BAD_VALUE = 5
    NO_MODEL = 6
    MODEL_INVALID = 7
    CRC_MISMATCH = 8
    OUTSIDE_RECTANGLE = 9
    OUTSIDE_LIMITS = 10
    BAUD_BUDGET = 11
    MUST_NAME_MODEL = 12
    FLASH_FAILED = 13
    FAULT_LATCHED = 14
    BUSY = 15
    MODE_UNSUPPORTED = 16
    LIMITS_LOST = 17
    LEARNED_FOR_OTHER = 18


class Fault(IntEnum):
    """Why the device stopped; each is described in docs/faults.md."""

    NONE = 0
    HOST_TIMEOUT = 1
    TICK_OVERRUN = 2
    ADC_RAIL = 3
    CONVERTER_SILENT = 4
    INTERLOCK = 5
    FLASH_ERROR = 6
    CORE_LOST = 7
    TRACKING_ERROR = 8
    TICK_LOST = 9
    SENSOR_FROZEN = 10
    SENSOR_JUMP = 11
    OUTPUT_LIMITED = 12
    POSITION_LIMIT = 13
    OSCILLATION = 14


class ResetCause(IntEnum):
    """Why the device last started."""

    POWER_ON = 0
    PIN = 1
    WATCHDOG = 2
    SOFTWARE = 3
    BROWN_OUT = 4


class CoreLoss(IntEnum):
    """Top four bits of a core_lost fault's detail: what ended the program; below them its address."""

    WATCHDOG = 0
    HARD_FAULT = 1
    MEMORY_FAULT = 2
    BUS_FAULT = 3
    USAGE_FAULT = 4
    STACK_OVERFLOW = 5
    CLOCK_STOPPED = 6
    NO_CRYSTAL = 7
    STRAY_INTERRUPT = 8
    SUPPLY_LOW = 9


class Channel(IntEnum):
    """Bits of the stream's channel mask; per tick and axis, in this order."""

    REFERENCE = 1
    ADC = 2
    DAC = 4
    FEEDFORWARD = 8
    FEEDBACK = 16
    TRIGGER = 32


class Region(IntEnum):
    """What SNAPSHOT_READ reads."""

    STATE = 0
    WAVE_X = 1
    WAVE_Y = 2
    WAVE_Z = 3
    FAULTS = 4


class EventKind(IntEnum):
    """What an unsolicited event reports."""

    STATE_CHANGE = 0
    FAULT = 1
    STREAM_OVERFLOW = 2
    PATH_DONE = 3
    TRIGGER = 4


class UpdateStanding(IntEnum):
    """What is known of the firmware image that runs."""

    CONFIRMED = 0
    TRIAL = 1
    ROLLED_BACK = 2


class Trigger(IntEnum):
    """What freezes the transient recorder; a fault always does."""

    FAULT = 0
    SET_POINT = 1
    THRESHOLD = 2
    INPUT = 3


class Mark(IntEnum):
    """Where on the path of an axis a trigger output pulses."""

    NONE = 0
    TURN = 1
    TIME = 2
    WAY = 3
    TARGET = 4


class TransientState(IntEnum):
    """What the transient recorder does."""

    WAITING = 0
    TRIGGERED = 1
    FROZEN = 2


@dataclass(frozen=True, slots=True)
class Biquad(Record):
    """One section y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''; stable, 1 + a1 + a2 = b0 + b1 + b2."""

    NAME: ClassVar[str] = "biquad"
    SIZE: ClassVar[int] = 20
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<iiiii")
    b0_q26: int
    b1_q26: int
    b2_q26: int
    a1_q26: int
    a2_q26: int

    def pack(self) -> bytes:
        return _pack(Biquad.NAME, Biquad.LAYOUT, self.b0_q26, self.b1_q26, self.b2_q26, self.a1_q26, self.a2_q26)

    @classmethod
    def unpack(cls, payload: bytes) -> Biquad:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4])


@dataclass(frozen=True, slots=True)
class AxisModel(Record):
    """One axis of the model: converters, limits, the paper's table view, and the chain that mode inverse undoes."""

    NAME: ClassVar[str] = "axis_model"
    SIZE: ClassVar[int] = 900
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<Iiiiiiiiiiiiii3q6q6qI120s20s8i8qiii32i32i24i24i3iiIi")
    flags: int
    """bit 0: table view present; bit 1: the fields from preview_ticks_q16 on are; bits 24 to 31: what the ADC code
    of 0 um is above adc_zero_code, in 256ths.
    """
    u_min_q24: int
    """lower clamp, V."""
    u_max_q24: int
    """upper clamp, V."""
    u_park_q24: int
    """safe value, V."""
    slew_q24: int
    """largest step of the output, V per tick."""
    ramp_q24: int
    """step when parking or ramping after a fault, V per tick; at most slew_q24."""
    dac_zero_code: int
    """DAC code of 0 V."""
    dac_codes_per_V_q16: int
    """DAC scale."""
    adc_zero_code: int
    """ADC code of 0 um, rounded down; the rest stands in flags."""
    adc_um_per_code_q32: int
    """ADC scale."""
    swing_min_q24: int
    """identified rectangle: peak-to-peak voltage."""
    swing_max_q24: int
    f_min_q16: int
    """identified rectangle: Hz."""
    f_max_q16: int
    a_q32: tuple[int, ...]
    """K(um) in um/V, um/V^2, um/V^3."""
    b_q40: tuple[int, ...]
    """theta(um, f) in turns (not degrees), regressors 1 um f um*f um^2 f^2."""
    c_q32: tuple[int, ...]
    """x0(um, f) in um, same regressors; kept for read-back, not used by the law."""
    preview_ticks_q16: int
    """how far ahead the feed-forward looks; at most 1024 ticks."""
    shape: tuple[Biquad, ...]
    """sections on the position that is asked for; those not in use: b0 = 1."""
    drive: tuple[Biquad, ...]
    """section on the voltage."""
    creep_k_q30: tuple[int, ...]
    """creep x = d + sum k lag[d]; sum |k| at most 1/2."""
    creep_alpha_q48: tuple[int, ...]
    """1 - exp(-T/tau)."""
    gain_q20: int
    """x = offset + gain v + sum w play_r[v] + sum s max(v - d, 0); um/V."""
    offset_q16: int
    """um."""
    rest_fraction_q30: int
    """where plays stand at rest, of their thresholds."""
    play_r_q24: tuple[int, ...]
    """V, rising; those not in use: 0x7fffffff."""
    play_w_q20: tuple[int, ...]
    """um/V."""
    knot_d_q24: tuple[int, ...]
    """V, rising; those not in use: 0x7fffffff."""
    knot_s_q20: tuple[int, ...]
    """um/V."""
    coupling_q28: tuple[int, ...]
    """what this axis sees of x, y, z; its own share is 1."""
    error_limit_q16: int
    """under feedback, um: so far off for error_ticks in a row is a fault; 0: a quarter of the sensor's range for 500
    ticks.
    """
    error_ticks: int
    oscillation_limit_q16: int
    """under feedback, um rms above the loop's band: growing to more is a fault; 0: a 256th of the sensor's range."""

    def pack(self) -> bytes:
        if len(self.shape) != 6:
            raise WireError(f"axis_model: 6 shape expected, got {len(self.shape)}")
        if len(self.drive) != 1:
            raise WireError(f"axis_model: 1 drive expected, got {len(self.drive)}")
        return _pack(
            AxisModel.NAME,
            AxisModel.LAYOUT,
            self.flags,
            self.u_min_q24,
            self.u_max_q24,
            self.u_park_q24,
            self.slew_q24,
            self.ramp_q24,
            self.dac_zero_code,
            self.dac_codes_per_V_q16,
            self.adc_zero_code,
            self.adc_um_per_code_q32,
            self.swing_min_q24,
            self.swing_max_q24,
            self.f_min_q16,
            self.f_max_q16,
            *self.a_q32,
            *self.b_q40,
            *self.c_q32,
            self.preview_ticks_q16,
            b"".join(item.pack() for item in self.shape),
            b"".join(item.pack() for item in self.drive),
            *self.creep_k_q30,
            *self.creep_alpha_q48,
            self.gain_q20,
            self.offset_q16,
            self.rest_fraction_q30,
            *self.play_r_q24,
            *self.play_w_q20,
            *self.knot_d_q24,
            *self.knot_s_q20,
            *self.coupling_q28,
            self.error_limit_q16,
            self.error_ticks,
            self.oscillation_limit_q16,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> AxisModel:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(
            v[0],
            v[1],
            v[2],
            v[3],
            v[4],
            v[5],
            v[6],
            v[7],
            v[8],
            v[9],
            v[10],
            v[11],
            v[12],
            v[13],
            v[14:17],
            v[17:23],
            v[23:29],
            v[29],
            tuple(Biquad.unpack(v[30][i : i + 20]) for i in range(0, 120, 20)),
            tuple(Biquad.unpack(v[31][i : i + 20]) for i in range(0, 20, 20)),
            v[32:40],
            v[40:48],
            v[48],
            v[49],
            v[50],
            v[51:83],
            v[83:115],
            v[115:139],
            v[139:163],
            v[163:166],
            v[166],
            v[167],
            v[168],
        )


@dataclass(frozen=True, slots=True)
class Segment(Record):
    """A path for the queue: fields as in SET_PATH, unless said."""

    NAME: ClassVar[str] = "segment"
    SIZE: ClassVar[int] = 30
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBiiQQHH")
    path: int
    flags: int
    """from_here: a hold or a move begins where the path before ends or, joined, is half a join later; the swing of a
    move is then its target. more: another one is to follow.
    """
    swing: int
    offset: int
    step_turn64: int
    ticks: int
    enter_ticks: int
    """of the join with the path before; 0: none, it begins where that one comes to rest."""
    leave_ticks: int

    def pack(self) -> bytes:
        return _pack(
            Segment.NAME,
            Segment.LAYOUT,
            self.path,
            self.flags,
            self.swing,
            self.offset,
            self.step_turn64,
            self.ticks,
            self.enter_ticks,
            self.leave_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Segment:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7])


@dataclass(frozen=True, slots=True)
class Model(Record):
    """The model blob that is uploaded, checked, persisted and read back."""

    NAME: ClassVar[str] = "model"
    SIZE: ClassVar[int] = 2736
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I32s2700s")
    magic: int
    """0x314C4850, 'PHL1'."""
    stage_hash: bytes
    """SHA-256 of the stage file it was made from."""
    axes: tuple[AxisModel, ...]

    def pack(self) -> bytes:
        if len(self.axes) != 3:
            raise WireError(f"model: 3 axes expected, got {len(self.axes)}")
        return _pack(
            Model.NAME,
            Model.LAYOUT,
            self.magic,
            _exactly("model.stage_hash", self.stage_hash, 32),
            b"".join(item.pack() for item in self.axes),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Model:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], tuple(AxisModel.unpack(v[2][i : i + 900]) for i in range(0, 2700, 900)))


@dataclass(frozen=True, slots=True)
class AxisLimits(Record):
    """Hard limits of one axis, in converter codes, so that no model's calibration moves them; 0, 65535 and
    0xffffffff limit nothing.
    """

    NAME: ClassVar[str] = "axis_limits"
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHIHH")
    dac_min: int
    """lowest output code."""
    dac_max: int
    slew_codes_q16: int
    """largest step of the output, codes per tick."""
    adc_min: int
    """lowest sensor code of a set-point and of an axis that follows a path."""
    adc_max: int

    def pack(self) -> bytes:
        return _pack(
            AxisLimits.NAME,
            AxisLimits.LAYOUT,
            self.dac_min,
            self.dac_max,
            self.slew_codes_q16,
            self.adc_min,
            self.adc_max,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> AxisLimits:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4])


@dataclass(frozen=True, slots=True)
class LoggedFault(Record):
    """One fault of the log."""

    NAME: ClassVar[str] = "logged_fault"
    SIZE: ClassVar[int] = 19
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"detail"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IQIBBB")
    power_cycle: int
    """starts of the device up to then, resets included; 1 is the first."""
    tick: int
    """since that start."""
    detail: int
    fault: int
    """none: no fault."""
    axis: int
    """255: no axis."""
    state: int
    """in which it was met."""

    def pack(self) -> bytes:
        return _pack(
            LoggedFault.NAME,
            LoggedFault.LAYOUT,
            self.power_cycle,
            self.tick,
            self.detail,
            self.fault,
            self.axis,
            self.state,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> LoggedFault:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5])


@dataclass(frozen=True, slots=True)
class DeviceRecord(Record):
    """One record of the journal, never sent: its limits and power cycle hold from then on, a fault is added to the
    log; a CRC-32 follows.
    """

    NAME: ClassVar[str] = "device_record"
    SIZE: ClassVar[int] = 68
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IIIB36s19s")
    magic: int
    """0x314A4850, 'PHJ1'."""
    sequence: int
    """never 0; the newest whole record wins."""
    power_cycle: int
    limits_lost: int
    """the limits that were set could not be read, and none have been set since."""
    limits: tuple[AxisLimits, ...]
    fault: tuple[LoggedFault, ...]

    def pack(self) -> bytes:
        if len(self.limits) != 3:
            raise WireError(f"device_record: 3 limits expected, got {len(self.limits)}")
        if len(self.fault) != 1:
            raise WireError(f"device_record: 1 fault expected, got {len(self.fault)}")
        return _pack(
            DeviceRecord.NAME,
            DeviceRecord.LAYOUT,
            self.magic,
            self.sequence,
            self.power_cycle,
            self.limits_lost,
            b"".join(item.pack() for item in self.limits),
            b"".join(item.pack() for item in self.fault),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> DeviceRecord:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(
            v[0],
            v[1],
            v[2],
            v[3],
            tuple(AxisLimits.unpack(v[4][i : i + 12]) for i in range(0, 36, 12)),
            tuple(LoggedFault.unpack(v[5][i : i + 19]) for i in range(0, 19, 19)),
        )


@dataclass(frozen=True, slots=True)
class HelloReply(Reply):
    """The answer to hello."""

    NAME: ClassVar[str] = "hello reply"
    NUMBER: ClassVar[int] = 0x81
    SIZE: ClassVar[int] = 79
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"wire_revision", "build_id", "target", "baud", "reset_cause"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQIHH20s24sIIBBBBIH")
    status: int
    tick: int
    """the tick before which the command took effect."""
    schema_fingerprint: int
    wire_version: int
    """these three stand here in every version from 2 on."""
    wire_revision: int
    """what has been added to the version."""
    build_id: bytes
    """hash of the firmware source."""
    target: bytes
    """ASCII, zero padded: host, nucleo_f446re, ..."""
    tick_rate_Hz: int
    baud: int
    axis_count: int
    state: int
    reset_cause: int
    model_flags: int
    """bit 0: a model is loaded; bit 1: it is a fallback and must be named to arm; bit 2: it is persisted."""
    model_crc: int
    max_payload: int

    def pack(self) -> bytes:
        return _pack(
            HelloReply.NAME,
            HelloReply.LAYOUT,
            self.status,
            self.tick,
            self.schema_fingerprint,
            self.wire_version,
            self.wire_revision,
            _exactly("hello reply.build_id", self.build_id, 20),
            _exactly("hello reply.target", self.target, 24),
            self.tick_rate_Hz,
            self.baud,
            self.axis_count,
            self.state,
            self.reset_cause,
            self.model_flags,
            self.model_crc,
            self.max_payload,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> HelloReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13], v[14])


@dataclass(frozen=True, slots=True)
class HelloRequest(Command[HelloReply]):
    """Opens a session: the header's session becomes the device's. Needs no session."""

    NAME: ClassVar[str] = "hello"
    NUMBER: ClassVar[int] = 0x01
    REPLY: ClassVar[type[Any]] = HelloReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> HelloRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class StopReply(Reply):
    """The answer to stop."""

    NAME: ClassVar[str] = "stop reply"
    NUMBER: ClassVar[int] = 0x82
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(StopReply.NAME, StopReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> StopReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class StopRequest(Command[StopReply]):
    """Ramps every axis to its safe value at once. Needs no session."""

    NAME: ClassVar[str] = "stop"
    NUMBER: ClassVar[int] = 0x02
    REPLY: ClassVar[type[Any]] = StopReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> StopRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class StatusReply(Reply):
    """The answer to status."""

    NAME: ClassVar[str] = "status reply"
    NUMBER: ClassVar[int] = 0x83
    SIZE: ClassVar[int] = 73
    LEAST: ClassVar[int | None] = 65
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"overruns", "rx_errors"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQBBBBQ3BB3H3H3IIIIIQ")
    status: int
    tick: int
    """the tick before which the command took effect."""
    state: int
    fault: int
    fault_axis: int
    """255: no axis."""
    running_axes: int
    """mask of axes whose path is still under way."""
    fault_tick: int
    modes: tuple[int, ...]
    at_rest: int
    """mask of axes whose output is at the safe value."""
    adc_codes: tuple[int, ...]
    dac_codes: tuple[int, ...]
    saturations: tuple[int, ...]
    """ticks with at least one saturated block, per axis."""
    overruns: int
    stream_dropped: int
    """ticks dropped since the stream was started."""
    rx_errors: int
    """frames thrown away: bad COBS, CRC or length."""
    model_crc: int
    first_tick: int = 0
    """in which the paths begin that an edge at the trigger input has begun; 0: those queued last still wait for one."""

    def pack(self) -> bytes:
        return _pack(
            StatusReply.NAME,
            StatusReply.LAYOUT,
            self.status,
            self.tick,
            self.state,
            self.fault,
            self.fault_axis,
            self.running_axes,
            self.fault_tick,
            *self.modes,
            self.at_rest,
            *self.adc_codes,
            *self.dac_codes,
            *self.saturations,
            self.overruns,
            self.stream_dropped,
            self.rx_errors,
            self.model_crc,
            self.first_tick,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> StatusReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(
            v[0],
            v[1],
            v[2],
            v[3],
            v[4],
            v[5],
            v[6],
            v[7:10],
            v[10],
            v[11:14],
            v[14:17],
            v[17:20],
            v[20],
            v[21],
            v[22],
            v[23],
            v[24],
        )


@dataclass(frozen=True, slots=True)
class StatusRequest(Command[StatusReply]):
    """What the device is doing; also feeds the host timeout."""

    NAME: ClassVar[str] = "status"
    NUMBER: ClassVar[int] = 0x03
    REPLY: ClassVar[type[Any]] = StatusReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> StatusRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class ArmReply(Reply):
    """The answer to arm."""

    NAME: ClassVar[str] = "arm reply"
    NUMBER: ClassVar[int] = 0x84
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(ArmReply.NAME, ArmReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> ArmReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ArmRequest(Command[ArmReply]):
    """parked -> armed. model_crc 0 arms whatever is loaded unless it is a fallback, which must be named."""

    NAME: ClassVar[str] = "arm"
    NUMBER: ClassVar[int] = 0x04
    REPLY: ClassVar[type[Any]] = ArmReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "its firmware is on trial; `phaselead flash --wire` again confirms it",
    }
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I")
    model_crc: int

    def pack(self) -> bytes:
        return _pack(ArmRequest.NAME, ArmRequest.LAYOUT, self.model_crc)

    @classmethod
    def unpack(cls, payload: bytes) -> ArmRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0])


@dataclass(frozen=True, slots=True)
class StartReply(Reply):
    """The answer to start."""

    NAME: ClassVar[str] = "start reply"
    NUMBER: ClassVar[int] = 0x85
    SIZE: ClassVar[int] = 17
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQQ")
    status: int
    tick: int
    """the tick before which the command took effect."""
    first_tick: int
    """in which they begin: the one after the reply's, which works out what they begin with."""

    def pack(self) -> bytes:
        return _pack(StartReply.NAME, StartReply.LAYOUT, self.status, self.tick, self.first_tick)

    @classmethod
    def unpack(cls, payload: bytes) -> StartReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


@dataclass(frozen=True, slots=True)
class StartRequest(Command[StartReply]):
    """armed -> running: the paths of these axes begin together."""

    NAME: ClassVar[str] = "start"
    NUMBER: ClassVar[int] = 0x05
    REPLY: ClassVar[type[Any]] = StartReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "an axis that is to start has no mode or no path yet; set both",
    }
    SIZE: ClassVar[int] = 1
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")
    axis_mask: int

    def pack(self) -> bytes:
        return _pack(StartRequest.NAME, StartRequest.LAYOUT, self.axis_mask)

    @classmethod
    def unpack(cls, payload: bytes) -> StartRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0])


@dataclass(frozen=True, slots=True)
class ParkReply(Reply):
    """The answer to park."""

    NAME: ClassVar[str] = "park reply"
    NUMBER: ClassVar[int] = 0x86
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(ParkReply.NAME, ParkReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> ParkReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ParkRequest(Command[ParkReply]):
    """Ramps to the safe value, then parked."""

    NAME: ClassVar[str] = "park"
    NUMBER: ClassVar[int] = 0x06
    REPLY: ClassVar[type[Any]] = ParkReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> ParkRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class ClearFaultReply(Reply):
    """The answer to clear_fault."""

    NAME: ClassVar[str] = "clear_fault reply"
    NUMBER: ClassVar[int] = 0x87
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(ClearFaultReply.NAME, ClearFaultReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> ClearFaultReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ClearFaultRequest(Command[ClearFaultReply]):
    """fault -> parked once the output is at its safe value."""

    NAME: ClassVar[str] = "clear_fault"
    NUMBER: ClassVar[int] = 0x07
    REPLY: ClassVar[type[Any]] = ClearFaultReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> ClearFaultRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class SetAxisReply(Reply):
    """The answer to set_axis."""

    NAME: ClassVar[str] = "set_axis reply"
    NUMBER: ClassVar[int] = 0x88
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(SetAxisReply.NAME, SetAxisReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> SetAxisReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class SetAxisRequest(Command[SetAxisReply]):
    """Mode, gains and filters of one axis; while parked or armed."""

    NAME: ClassVar[str] = "set_axis"
    NUMBER: ClassVar[int] = 0x08
    REPLY: ClassVar[type[Any]] = SetAxisReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "a gain below zero, no derivative filter, or a filter that is unstable or not 1 at rest",
    }
    SIZE: ClassVar[int] = 58
    LEAST: ClassVar[int | None] = 18
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBiiii40s")
    axis: int
    mode: int
    kp_q24: int
    """V/um."""
    ki_ts_q32: int
    """V/um per tick."""
    kd_over_ts_q24: int
    """V/um."""
    d_alpha_q31: int
    """derivative filter y += alpha (x - y); 0x7fffffff: no filter."""
    filters: tuple[Biquad, ...] = (Biquad.unpack(bytes(Biquad.SIZE)),) * 2
    """behind the PID, one after the other; all of it 0: none."""

    def pack(self) -> bytes:
        if len(self.filters) != 2:
            raise WireError(f"set_axis: 2 filters expected, got {len(self.filters)}")
        return _pack(
            SetAxisRequest.NAME,
            SetAxisRequest.LAYOUT,
            self.axis,
            self.mode,
            self.kp_q24,
            self.ki_ts_q32,
            self.kd_over_ts_q24,
            self.d_alpha_q31,
            b"".join(item.pack() for item in self.filters),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> SetAxisRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], tuple(Biquad.unpack(v[6][i : i + 20]) for i in range(0, 40, 20)))


@dataclass(frozen=True, slots=True)
class SetPathReply(Reply):
    """The answer to set_path."""

    NAME: ClassVar[str] = "set_path reply"
    NUMBER: ClassVar[int] = 0x89
    SIZE: ClassVar[int] = 17
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQii")
    status: int
    tick: int
    """the tick before which the command took effect."""
    inverse_gain_q28: int
    """V/um, looked up."""
    lead_turn32: int
    """phase lead, looked up; under inverse: the preview."""

    def pack(self) -> bytes:
        return _pack(
            SetPathReply.NAME,
            SetPathReply.LAYOUT,
            self.status,
            self.tick,
            self.inverse_gain_q28,
            self.lead_turn32,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> SetPathReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class SetPathRequest(Command[SetPathReply]):
    """Reference of one axis; while parked or armed. Looks the feed-forward tables up and refuses what they do not
    cover.
    """

    NAME: ClassVar[str] = "set_path"
    NUMBER: ClassVar[int] = 0x09
    REPLY: ClassVar[type[Any]] = SetPathReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "a swing below zero, a frequency beyond half the tick rate, or no waveform",
        Status.MODE_UNSUPPORTED: "the axis is idle; set its mode first",
    }
    SIZE: ClassVar[int] = 26
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBiiQQ")
    axis: int
    path: int
    swing: int
    """peak-to-peak, um q16 (V q24 in mode open); for a move: the way to go, signed."""
    offset: int
    """lowest value of the path; for a hold or a move: where it starts."""
    step_turn64: int
    """sine, wave: turns per tick; move: 2^64 / duration in ticks."""
    ticks: int
    """length of the path; the last value is then held; 0: for ever."""

    def pack(self) -> bytes:
        return _pack(
            SetPathRequest.NAME,
            SetPathRequest.LAYOUT,
            self.axis,
            self.path,
            self.swing,
            self.offset,
            self.step_turn64,
            self.ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> SetPathRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5])


@dataclass(frozen=True, slots=True)
class WaveChunkReply(Reply):
    """The answer to wave_chunk."""

    NAME: ClassVar[str] = "wave_chunk reply"
    NUMBER: ClassVar[int] = 0x8A
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(WaveChunkReply.NAME, WaveChunkReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> WaveChunkReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class WaveChunkRequest(Command[WaveChunkReply]):
    """Writes points of an axis' periodic waveform; also while another one of its paths goes on. One period is 1024
    points in q30 of the swing (0 .. 2^30).
    """

    NAME: ClassVar[str] = "wave_chunk"
    NUMBER: ClassVar[int] = 0x0A
    REPLY: ClassVar[type[Any]] = WaveChunkReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "the axis still plays its waveform, or has it in its queue; wait until it holds",
    }
    SIZE: ClassVar[int] = 3
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BH")
    axis: int
    offset: int
    """first point."""
    data: bytes
    """i32 points."""

    def pack(self) -> bytes:
        return _pack(
            WaveChunkRequest.NAME,
            WaveChunkRequest.LAYOUT,
            self.axis,
            self.offset,
        ) + _tail(WaveChunkRequest, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> WaveChunkRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class WaveCommitReply(Reply):
    """The answer to wave_commit."""

    NAME: ClassVar[str] = "wave_commit reply"
    NUMBER: ClassVar[int] = 0x8B
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(WaveCommitReply.NAME, WaveCommitReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> WaveCommitReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class WaveCommitRequest(Command[WaveCommitReply]):
    """Checks the CRC-32 over all 1024 points and makes them the axis' waveform."""

    NAME: ClassVar[str] = "wave_commit"
    NUMBER: ClassVar[int] = 0x0B
    REPLY: ClassVar[type[Any]] = WaveCommitReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "the axis still plays its waveform, or has it in its queue; wait until it holds",
    }
    SIZE: ClassVar[int] = 13
    LEAST: ClassVar[int | None] = 5
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BIII")
    axis: int
    crc: int
    model_crc: int = 0
    """of the model that these points were learned with; 0: they are for any."""
    path_crc: int = 0
    """of the path they were learned for: CRC-32 over the axis' mode (u8) and swing, offset and step_turn64 as
    SET_PATH and QUEUE have them; 0: they are for any.
    """

    def pack(self) -> bytes:
        return _pack(
            WaveCommitRequest.NAME,
            WaveCommitRequest.LAYOUT,
            self.axis,
            self.crc,
            self.model_crc,
            self.path_crc,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> WaveCommitRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class ModelBeginReply(Reply):
    """The answer to model_begin."""

    NAME: ClassVar[str] = "model_begin reply"
    NUMBER: ClassVar[int] = 0x8C
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(ModelBeginReply.NAME, ModelBeginReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelBeginReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ModelBeginRequest(Command[ModelBeginReply]):
    """Opens a model transaction; an earlier unfinished one is dropped."""

    NAME: ClassVar[str] = "model_begin"
    NUMBER: ClassVar[int] = 0x0C
    REPLY: ClassVar[type[Any]] = ModelBeginReply
    SIZE: ClassVar[int] = 8
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<II")
    size: int
    crc: int

    def pack(self) -> bytes:
        return _pack(ModelBeginRequest.NAME, ModelBeginRequest.LAYOUT, self.size, self.crc)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelBeginRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ModelChunkReply(Reply):
    """The answer to model_chunk."""

    NAME: ClassVar[str] = "model_chunk reply"
    NUMBER: ClassVar[int] = 0x8D
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(ModelChunkReply.NAME, ModelChunkReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelChunkReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ModelChunkRequest(Command[ModelChunkReply]):
    """Part of the model blob."""

    NAME: ClassVar[str] = "model_chunk"
    NUMBER: ClassVar[int] = 0x0D
    REPLY: ClassVar[type[Any]] = ModelChunkReply
    SIZE: ClassVar[int] = 4
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I")
    offset: int
    data: bytes

    def pack(self) -> bytes:
        return _pack(
            ModelChunkRequest.NAME,
            ModelChunkRequest.LAYOUT,
            self.offset,
        ) + _tail(ModelChunkRequest, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelChunkRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class ModelCommitReply(Reply):
    """The answer to model_commit."""

    NAME: ClassVar[str] = "model_commit reply"
    NUMBER: ClassVar[int] = 0x8E
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQHB")
    status: int
    tick: int
    """the tick before which the command took effect."""
    invalid_field: int
    """with model_invalid: 100 * axis + number of the offending field."""
    held_back: int
    """mask of axes for which the device's hard limits are tighter than the model's."""

    def pack(self) -> bytes:
        return _pack(
            ModelCommitReply.NAME,
            ModelCommitReply.LAYOUT,
            self.status,
            self.tick,
            self.invalid_field,
            self.held_back,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> ModelCommitReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class ModelCommitRequest(Command[ModelCommitReply]):
    """Checks the CRC, validates every field, expands the tables and swaps the model in between two ticks; while
    parked and no output moves.
    """

    NAME: ClassVar[str] = "model_commit"
    NUMBER: ClassVar[int] = 0x0E
    REPLY: ClassVar[type[Any]] = ModelCommitReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.OUTSIDE_LIMITS: "its limits or the device's (`phaselead limits`) leave out its safe value or the output",
        Status.BUSY: "its outputs are still moving to the safe value; try again",
    }
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> ModelCommitRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class ModelReadReply(Reply):
    """The answer to model_read."""

    NAME: ClassVar[str] = "model_read reply"
    NUMBER: ClassVar[int] = 0x8F
    SIZE: ClassVar[int] = 17
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQII")
    status: int
    tick: int
    """the tick before which the command took effect."""
    size: int
    crc: int
    data: bytes

    def pack(self) -> bytes:
        return _pack(
            ModelReadReply.NAME,
            ModelReadReply.LAYOUT,
            self.status,
            self.tick,
            self.size,
            self.crc,
        ) + _tail(ModelReadReply, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelReadReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class ModelReadRequest(Command[ModelReadReply]):
    """Reads the active model back."""

    NAME: ClassVar[str] = "model_read"
    NUMBER: ClassVar[int] = 0x0F
    REPLY: ClassVar[type[Any]] = ModelReadReply
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IH")
    offset: int
    length: int

    def pack(self) -> bytes:
        return _pack(ModelReadRequest.NAME, ModelReadRequest.LAYOUT, self.offset, self.length)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelReadRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class ModelPersistReply(Reply):
    """The answer to model_persist."""

    NAME: ClassVar[str] = "model_persist reply"
    NUMBER: ClassVar[int] = 0x90
    SIZE: ClassVar[int] = 13
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQI")
    status: int
    tick: int
    """the tick before which the command took effect."""
    sequence: int
    """number of the record written."""

    def pack(self) -> bytes:
        return _pack(ModelPersistReply.NAME, ModelPersistReply.LAYOUT, self.status, self.tick, self.sequence)

    @classmethod
    def unpack(cls, payload: bytes) -> ModelPersistReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


@dataclass(frozen=True, slots=True)
class ModelPersistRequest(Command[ModelPersistReply]):
    """Writes the active model to the older of two flash slots; while parked and no output moves."""

    NAME: ClassVar[str] = "model_persist"
    NUMBER: ClassVar[int] = 0x10
    REPLY: ClassVar[type[Any]] = ModelPersistReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "its outputs are still moving to the safe value; try again",
    }
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> ModelPersistRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class StreamStartReply(Reply):
    """The answer to stream_start."""

    NAME: ClassVar[str] = "stream_start reply"
    NUMBER: ClassVar[int] = 0x91
    SIZE: ClassVar[int] = 21
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"budget_bytes_per_s"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQIII")
    status: int
    tick: int
    """the tick before which the command took effect."""
    bytes_per_s: int
    """what it takes on the line."""
    budget_bytes_per_s: int
    """what the line carries."""
    state_size: int
    """bytes of the latched control state."""

    def pack(self) -> bytes:
        return _pack(
            StreamStartReply.NAME,
            StreamStartReply.LAYOUT,
            self.status,
            self.tick,
            self.bytes_per_s,
            self.budget_bytes_per_s,
            self.state_size,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> StreamStartReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4])


@dataclass(frozen=True, slots=True)
class StreamStartRequest(Command[StreamStartReply]):
    """Streams the chosen channels of the chosen axes from the reply's tick on, and latches the control state of that
    moment for SNAPSHOT_READ.
    """

    NAME: ClassVar[str] = "stream_start"
    NUMBER: ClassVar[int] = 0x11
    REPLY: ClassVar[type[Any]] = StreamStartReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "a tick came into each copy of its state; try again",
    }
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBH")
    channels: int
    axis_mask: int
    decimation: int
    """1: every tick."""

    def pack(self) -> bytes:
        return _pack(StreamStartRequest.NAME, StreamStartRequest.LAYOUT, self.channels, self.axis_mask, self.decimation)

    @classmethod
    def unpack(cls, payload: bytes) -> StreamStartRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


@dataclass(frozen=True, slots=True)
class StreamStopReply(Reply):
    """The answer to stream_stop."""

    NAME: ClassVar[str] = "stream_stop reply"
    NUMBER: ClassVar[int] = 0x92
    SIZE: ClassVar[int] = 25
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQQQ")
    status: int
    tick: int
    """the tick before which the command took effect."""
    sent_ticks: int
    dropped_ticks: int

    def pack(self) -> bytes:
        return _pack(
            StreamStopReply.NAME,
            StreamStopReply.LAYOUT,
            self.status,
            self.tick,
            self.sent_ticks,
            self.dropped_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> StreamStopReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class StreamStopRequest(Command[StreamStopReply]):
    """Ends the stream; what is buffered is still sent."""

    NAME: ClassVar[str] = "stream_stop"
    NUMBER: ClassVar[int] = 0x12
    REPLY: ClassVar[type[Any]] = StreamStopReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> StreamStopRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class SnapshotReadReply(Reply):
    """The answer to snapshot_read."""

    NAME: ClassVar[str] = "snapshot_read reply"
    NUMBER: ClassVar[int] = 0x93
    SIZE: ClassVar[int] = 13
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQI")
    status: int
    tick: int
    """the tick before which the command took effect."""
    size: int
    data: bytes

    def pack(self) -> bytes:
        return _pack(
            SnapshotReadReply.NAME,
            SnapshotReadReply.LAYOUT,
            self.status,
            self.tick,
            self.size,
        ) + _tail(SnapshotReadReply, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> SnapshotReadReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class SnapshotReadRequest(Command[SnapshotReadReply]):
    """Reads the control state latched by STREAM_START, a waveform, or FAULT_LOG in pieces: power_cycle, then each of
    its faults, newest first.
    """

    NAME: ClassVar[str] = "snapshot_read"
    NUMBER: ClassVar[int] = 0x13
    REPLY: ClassVar[type[Any]] = SnapshotReadReply
    SIZE: ClassVar[int] = 7
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BIH")
    region: int
    offset: int
    length: int

    def pack(self) -> bytes:
        return _pack(SnapshotReadRequest.NAME, SnapshotReadRequest.LAYOUT, self.region, self.offset, self.length)

    @classmethod
    def unpack(cls, payload: bytes) -> SnapshotReadRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


@dataclass(frozen=True, slots=True)
class SetTimeoutReply(Reply):
    """The answer to set_timeout."""

    NAME: ClassVar[str] = "set_timeout reply"
    NUMBER: ClassVar[int] = 0x94
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(SetTimeoutReply.NAME, SetTimeoutReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> SetTimeoutReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class SetTimeoutRequest(Command[SetTimeoutReply]):
    """Ticks without a valid command of the session after which an armed or running device ramps to park and latches
    host_timeout; 0: never.
    """

    NAME: ClassVar[str] = "set_timeout"
    NUMBER: ClassVar[int] = 0x14
    REPLY: ClassVar[type[Any]] = SetTimeoutReply
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I")
    ticks: int

    def pack(self) -> bytes:
        return _pack(SetTimeoutRequest.NAME, SetTimeoutRequest.LAYOUT, self.ticks)

    @classmethod
    def unpack(cls, payload: bytes) -> SetTimeoutRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0])


@dataclass(frozen=True, slots=True)
class InfoReply(Reply):
    """The answer to info."""

    NAME: ClassVar[str] = "info reply"
    NUMBER: ClassVar[int] = 0x95
    SIZE: ClassVar[int] = 108
    LEAST: ClassVar[int | None] = 103
    PLATFORM: ClassVar[frozenset[str]] = frozenset(
        {
            "cycles_last",
            "cycles_max",
            "histogram",
            "overruns",
            "latched_late",
            "lost_ticks",
            "brown_out_level",
            "last_fault_detail",
        }
    )
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQII16IIIIBBIIBI")
    status: int
    tick: int
    """the tick before which the command took effect."""
    cycles_last: int
    cycles_max: int
    histogram: tuple[int, ...]
    """ticks by log2 of cycles."""
    overruns: int
    latched_late: int
    """ticks whose output was written too late for 30 us after the sample."""
    lost_ticks: int
    """ticks that did not come at all."""
    brown_out_level: int
    """of the chip's option bytes; 0: its brown-out reset is off."""
    last_fault: int
    last_fault_detail: int
    flash_sequence: int
    model_flags: int = 0
    """as in HELLO, at present."""
    model_crc: int = 0

    def pack(self) -> bytes:
        return _pack(
            InfoReply.NAME,
            InfoReply.LAYOUT,
            self.status,
            self.tick,
            self.cycles_last,
            self.cycles_max,
            *self.histogram,
            self.overruns,
            self.latched_late,
            self.lost_ticks,
            self.brown_out_level,
            self.last_fault,
            self.last_fault_detail,
            self.flash_sequence,
            self.model_flags,
            self.model_crc,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> InfoReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4:20], v[20], v[21], v[22], v[23], v[24], v[25], v[26], v[27], v[28])


@dataclass(frozen=True, slots=True)
class InfoRequest(Command[InfoReply]):
    """Timing of the tick and the fault log."""

    NAME: ClassVar[str] = "info"
    NUMBER: ClassVar[int] = 0x15
    REPLY: ClassVar[type[Any]] = InfoReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> InfoRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class MotionReply(Reply):
    """The answer to motion."""

    NAME: ClassVar[str] = "motion reply"
    NUMBER: ClassVar[int] = 0xC0
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(MotionReply.NAME, MotionReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> MotionReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class MotionRequest(Command[MotionReply]):
    """Limits of what is queued from now on, and the window of `where` and of the mark `target`; no output of an axis
    depends on them.
    """

    NAME: ClassVar[str] = "motion"
    NUMBER: ClassVar[int] = 0x40
    REPLY: ClassVar[type[Any]] = MotionReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "no such axis, or a window below zero",
    }
    SIZE: ClassVar[int] = 33
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQQQiI")
    axis: int
    velocity: int
    """um q40 (V q48 in mode open) per tick; 0: no limit."""
    acceleration: int
    """the same per tick^2."""
    jerk: int
    """the same per tick^3."""
    window_q16: int
    """um: on target is no further from the reference than this."""
    window_ticks: int
    """for so long in a row."""

    def pack(self) -> bytes:
        return _pack(
            MotionRequest.NAME,
            MotionRequest.LAYOUT,
            self.axis,
            self.velocity,
            self.acceleration,
            self.jerk,
            self.window_q16,
            self.window_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> MotionRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5])


@dataclass(frozen=True, slots=True)
class QueueReply(Reply):
    """The answer to queue."""

    NAME: ClassVar[str] = "queue reply"
    NUMBER: ClassVar[int] = 0xC1
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ3B")
    status: int
    tick: int
    """the tick before which the command took effect."""
    queued: tuple[int, ...]
    """how many wait now."""

    def pack(self) -> bytes:
        return _pack(QueueReply.NAME, QueueReply.LAYOUT, self.status, self.tick, *self.queued)

    @classmethod
    def unpack(cls, payload: bytes) -> QueueReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2:5])


@dataclass(frozen=True, slots=True)
class QueueRequest(Command[QueueReply]):
    """Puts a path behind those that are under way: one for each axis of the mask, all of them or none. They begin in
    the same tick.
    """

    NAME: ClassVar[str] = "queue"
    NUMBER: ClassVar[int] = 0x41
    REPLY: ClassVar[type[Any]] = QueueReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "an axis not driven, begin_tick has passed, or a path begins elsewhere: give it a join",
        Status.OUTSIDE_LIMITS: "outside the range of the axis, or faster than its limits; use a longer move or join",
        Status.BUSY: "the queue is full; wait until a path of it has begun",
        Status.WRONG_STATE: "nothing runs, or points of the path before are still to come",
    }
    SIZE: ClassVar[int] = 101
    LEAST: ClassVar[int | None] = 100
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBQ90sB")
    axis_mask: int
    at_once: int
    """1: what is queued for these axes is dropped, and the paths under way are left."""
    begin_tick: int
    """0: when the paths before have ended; those without an end are left at once."""
    segments: tuple[Segment, ...]
    """of axes x, y, z."""
    at_trigger: int = 0
    """1: nor before an edge of the trigger input: the next one from then on; an EVENT and STATUS say when."""

    def pack(self) -> bytes:
        if len(self.segments) != 3:
            raise WireError(f"queue: 3 segments expected, got {len(self.segments)}")
        return _pack(
            QueueRequest.NAME,
            QueueRequest.LAYOUT,
            self.axis_mask,
            self.at_once,
            self.begin_tick,
            b"".join(item.pack() for item in self.segments),
            self.at_trigger,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> QueueRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], tuple(Segment.unpack(v[3][i : i + 30]) for i in range(0, 90, 30)), v[4])


@dataclass(frozen=True, slots=True)
class SetJoinsReply(Reply):
    """The answer to set_joins."""

    NAME: ClassVar[str] = "set_joins reply"
    NUMBER: ClassVar[int] = 0xC4
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(SetJoinsReply.NAME, SetJoinsReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> SetJoinsReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class SetJoinsRequest(Command[SetJoinsReply]):
    """How the path of one axis is entered and left when it is started; after SET_PATH, which sets none."""

    NAME: ClassVar[str] = "set_joins"
    NUMBER: ClassVar[int] = 0x44
    REPLY: ClassVar[type[Any]] = SetJoinsReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "no path yet, or a periodic one that is to begin where the axis stands",
    }
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBHH")
    axis: int
    flags: int
    enter_ticks: int
    """of the join from where the axis stands, before the path begins; 0: none, the output jumps there at the slew
    limit.
    """
    leave_ticks: int
    """of the join to a hold where a periodic path ends; 0: none, it stops in one tick."""

    def pack(self) -> bytes:
        return _pack(
            SetJoinsRequest.NAME,
            SetJoinsRequest.LAYOUT,
            self.axis,
            self.flags,
            self.enter_ticks,
            self.leave_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> SetJoinsRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class PointsBeginReply(Reply):
    """The answer to points_begin."""

    NAME: ClassVar[str] = "points_begin reply"
    NUMBER: ClassVar[int] = 0xC5
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(PointsBeginReply.NAME, PointsBeginReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> PointsBeginReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class PointsBeginRequest(Command[PointsBeginReply]):
    """The waveforms of these axes are from now on paths whose points come while they are played: a ring of 1024,
    filled by POINTS. Set such a path, or queue it, once points are there: kind wave, step 2^(54 - ticks_log2),
    without an end.
    """

    NAME: ClassVar[str] = "points_begin"
    NUMBER: ClassVar[int] = 0x45
    REPLY: ClassVar[type[Any]] = PointsBeginReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "no axis, a point every 2^8 ticks at most, or a first one that is above 0 or before -1024",
        Status.BUSY: "an axis still plays its waveform, or has one in its queue; wait until it holds",
    }
    SIZE: ClassVar[int] = 18
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBi3I")
    axis_mask: int
    ticks_log2: int
    """a point every 2^n ticks."""
    first: int
    """number of the first point; the path begins at point 0, those before are for the join into it."""
    steepest_q30: tuple[int, ...]
    """no two neighbours of an axis are further apart."""

    def pack(self) -> bytes:
        return _pack(
            PointsBeginRequest.NAME,
            PointsBeginRequest.LAYOUT,
            self.axis_mask,
            self.ticks_log2,
            self.first,
            *self.steepest_q30,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> PointsBeginRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3:6])


@dataclass(frozen=True, slots=True)
class PointsReply(Reply):
    """The answer to points."""

    NAME: ClassVar[str] = "points reply"
    NUMBER: ClassVar[int] = 0xC6
    SIZE: ClassVar[int] = 15
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQHI")
    status: int
    tick: int
    """the tick before which the command took effect."""
    room: int
    """for so many more of each axis."""
    left_ticks: int
    """until the path that is played ends or runs dry; 0: none is."""

    def pack(self) -> bytes:
        return _pack(PointsReply.NAME, PointsReply.LAYOUT, self.status, self.tick, self.room, self.left_ticks)

    @classmethod
    def unpack(cls, payload: bytes) -> PointsReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3])


@dataclass(frozen=True, slots=True)
class PointsRequest(Command[PointsReply]):
    """More points of these axes, the same number for each. As long as points are missing a path ends so early that
    those that are there suffice for its join to a hold, and is then `dry`.
    """

    NAME: ClassVar[str] = "points"
    NUMBER: ClassVar[int] = 0x46
    REPLY: ClassVar[type[Any]] = PointsReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "not the points that come next, a value outside 0 .. 2^30, or a step above the steepest",
        Status.BUSY: "no room for so many yet; the reply says for how many there is",
        Status.WRONG_STATE: "the path ran dry, was left, or has ended, and holds; begin another one",
    }
    SIZE: ClassVar[int] = 13
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BiQ")
    axis_mask: int
    first: int
    """number of the first of these points."""
    length_ticks: int
    """of the path; 0: not known yet."""
    data: bytes
    """i32 points in q30 of the swing, those of the first axis before those of the next."""

    def pack(self) -> bytes:
        return _pack(
            PointsRequest.NAME,
            PointsRequest.LAYOUT,
            self.axis_mask,
            self.first,
            self.length_ticks,
        ) + _tail(PointsRequest, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> PointsRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class TriggerSetReply(Reply):
    """The answer to trigger_set."""

    NAME: ClassVar[str] = "trigger_set reply"
    NUMBER: ClassVar[int] = 0xC7
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(TriggerSetReply.NAME, TriggerSetReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> TriggerSetReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class TriggerSetRequest(Command[TriggerSetReply]):
    """Where one of the three trigger outputs pulses, on the path of one axis; until another is set, or the session,
    the model or the hard limits change.
    """

    NAME: ClassVar[str] = "trigger_set"
    NUMBER: ClassVar[int] = 0x47
    REPLY: ClassVar[type[Any]] = TriggerSetReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "no such output, axis or mark, or marks closer than a tick or 2 nm",
    }
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBBIi")
    output: int
    """0 to 2."""
    mark: int
    """turn: where a periodic path begins, and so often a turn; time: where a path begins, and every so many ticks;
    way: where the reference passes one of the places; target: once after each change of the reference, when it
    rests and the axis has been within its window for as long as MOTION says.
    """
    axis: int
    rising: int
    """way: 1: on the way up alone."""
    every: int
    """turn: so many a turn; time: ticks; way: um q16 (V q24 in mode open) from place to place."""
    origin: int
    """way: one of the places."""

    def pack(self) -> bytes:
        return _pack(
            TriggerSetRequest.NAME,
            TriggerSetRequest.LAYOUT,
            self.output,
            self.mark,
            self.axis,
            self.rising,
            self.every,
            self.origin,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> TriggerSetRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5])


@dataclass(frozen=True, slots=True)
class SetGainsReply(Reply):
    """The answer to set_gains."""

    NAME: ClassVar[str] = "set_gains reply"
    NUMBER: ClassVar[int] = 0xC2
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(SetGainsReply.NAME, SetGainsReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> SetGainsReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class SetGainsRequest(Command[SetGainsReply]):
    """Gains and filters of one axis, also while it runs: the output goes on from where it is."""

    NAME: ClassVar[str] = "set_gains"
    NUMBER: ClassVar[int] = 0x42
    REPLY: ClassVar[type[Any]] = SetGainsReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "a gain below zero, no derivative filter, or a filter that is unstable or not 1 at rest",
    }
    SIZE: ClassVar[int] = 57
    LEAST: ClassVar[int | None] = 17
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<Biiii40s")
    axis: int
    kp_q24: int
    """V/um."""
    ki_ts_q32: int
    """V/um per tick."""
    kd_over_ts_q24: int
    """V/um."""
    d_alpha_q31: int
    filters: tuple[Biquad, ...] = (Biquad.unpack(bytes(Biquad.SIZE)),) * 2
    """as in SET_AXIS."""

    def pack(self) -> bytes:
        if len(self.filters) != 2:
            raise WireError(f"set_gains: 2 filters expected, got {len(self.filters)}")
        return _pack(
            SetGainsRequest.NAME,
            SetGainsRequest.LAYOUT,
            self.axis,
            self.kp_q24,
            self.ki_ts_q32,
            self.kd_over_ts_q24,
            self.d_alpha_q31,
            b"".join(item.pack() for item in self.filters),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> SetGainsRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], tuple(Biquad.unpack(v[5][i : i + 20]) for i in range(0, 40, 20)))


@dataclass(frozen=True, slots=True)
class WhereReply(Reply):
    """The answer to where."""

    NAME: ClassVar[str] = "where reply"
    NUMBER: ClassVar[int] = 0xC3
    SIZE: ClassVar[int] = 96
    LEAST: ClassVar[int | None] = 72
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQBBBBBB3B3H3i3i3i3I3Q")
    status: int
    tick: int
    """the tick before which the command took effect."""
    state: int
    fault: int
    driven: int
    """mask of axes that follow a path, or hold its end."""
    moving: int
    """mask of axes whose path, join or queue is not at its end."""
    on_target: int
    """mask of axes within their window for long enough."""
    dry: int
    """mask of axes whose last path ended with `more` and had none after it: they hold."""
    queued: tuple[int, ...]
    adc_codes: tuple[int, ...]
    u_q24: tuple[int, ...]
    """V."""
    reference: tuple[int, ...]
    """um q16 (V q24 in mode open)."""
    end: tuple[int, ...]
    """where the last path of the queue ends: a move's target; of others, their offset; of a hold from_here that
    waits, the reference.
    """
    near_ticks: tuple[int, ...]
    """ticks in a row within the window."""
    dry_ticks: tuple[int, ...] = (0,) * 3
    """of axes that are dry: the tick in which the path ended."""

    def pack(self) -> bytes:
        return _pack(
            WhereReply.NAME,
            WhereReply.LAYOUT,
            self.status,
            self.tick,
            self.state,
            self.fault,
            self.driven,
            self.moving,
            self.on_target,
            self.dry,
            *self.queued,
            *self.adc_codes,
            *self.u_q24,
            *self.reference,
            *self.end,
            *self.near_ticks,
            *self.dry_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> WhereReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(
            v[0],
            v[1],
            v[2],
            v[3],
            v[4],
            v[5],
            v[6],
            v[7],
            v[8:11],
            v[11:14],
            v[14:17],
            v[17:20],
            v[20:23],
            v[23:26],
            v[26:29],
        )


@dataclass(frozen=True, slots=True)
class WhereRequest(Command[WhereReply]):
    """Where the axes are, and where they go; also feeds the host timeout."""

    NAME: ClassVar[str] = "where"
    NUMBER: ClassVar[int] = 0x43
    REPLY: ClassVar[type[Any]] = WhereReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> WhereRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class UpdateInfoReply(Reply):
    """The answer to update_info."""

    NAME: ClassVar[str] = "update_info reply"
    NUMBER: ClassVar[int] = 0xB0
    SIZE: ClassVar[int] = 28
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"slot", "standing", "slot_size", "free_address", "version"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQBBBIIII")
    status: int
    tick: int
    """the tick before which the command took effect."""
    slot: int
    """that runs."""
    standing: int
    """rolled_back: an image in the other slot was given up."""
    attempts: int
    """starts that an image on trial has."""
    slot_size: int
    free_address: int
    """of the slot that does not run."""
    version: int
    """major << 16, minor << 8, patch; 0: unknown."""
    trial_ticks: int
    """after which an image that was not confirmed restarts."""

    def pack(self) -> bytes:
        return _pack(
            UpdateInfoReply.NAME,
            UpdateInfoReply.LAYOUT,
            self.status,
            self.tick,
            self.slot,
            self.standing,
            self.attempts,
            self.slot_size,
            self.free_address,
            self.version,
            self.trial_ticks,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateInfoReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8])


@dataclass(frozen=True, slots=True)
class UpdateInfoRequest(Command[UpdateInfoReply]):
    """Which firmware image runs, and what one must be linked for to replace it."""

    NAME: ClassVar[str] = "update_info"
    NUMBER: ClassVar[int] = 0x30
    REPLY: ClassVar[type[Any]] = UpdateInfoReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateInfoRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class UpdateBeginReply(Reply):
    """The answer to update_begin."""

    NAME: ClassVar[str] = "update_begin reply"
    NUMBER: ClassVar[int] = 0xB1
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(UpdateBeginReply.NAME, UpdateBeginReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateBeginReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class UpdateBeginRequest(Command[UpdateBeginReply]):
    """Checks an image's header and erases the slot that does not run; while parked or in fault, at 0 V."""

    NAME: ClassVar[str] = "update_begin"
    NUMBER: ClassVar[int] = 0x31
    REPLY: ClassVar[type[Any]] = UpdateBeginReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "its outputs are on their way to 0 V; try again",
        Status.BAD_VALUE: "the image is for another board or another slot",
        Status.WRONG_STATE: "not while armed, on trial, or in fault away from 0 V; `phaselead park` it first",
    }
    SIZE: ClassVar[int] = 64
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<64s")
    header: bytes
    """the image's first 64 bytes: magic, CRC, length, address, version, target, build id."""

    def pack(self) -> bytes:
        return _pack(
            UpdateBeginRequest.NAME,
            UpdateBeginRequest.LAYOUT,
            _exactly("update_begin.header", self.header, 64),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateBeginRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0])


@dataclass(frozen=True, slots=True)
class UpdateChunkReply(Reply):
    """The answer to update_chunk."""

    NAME: ClassVar[str] = "update_chunk reply"
    NUMBER: ClassVar[int] = 0xB2
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(UpdateChunkReply.NAME, UpdateChunkReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateChunkReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class UpdateChunkRequest(Command[UpdateChunkReply]):
    """Part of the image behind its header; programmed and read back."""

    NAME: ClassVar[str] = "update_chunk"
    NUMBER: ClassVar[int] = 0x32
    REPLY: ClassVar[type[Any]] = UpdateChunkReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.WRONG_STATE: "no image is being received; run the command again",
    }
    SIZE: ClassVar[int] = 4
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I")
    offset: int
    """from the image's beginning."""
    data: bytes

    def pack(self) -> bytes:
        return _pack(
            UpdateChunkRequest.NAME,
            UpdateChunkRequest.LAYOUT,
            self.offset,
        ) + _tail(UpdateChunkRequest, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateChunkRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class UpdateCommitReply(Reply):
    """The answer to update_commit."""

    NAME: ClassVar[str] = "update_commit reply"
    NUMBER: ClassVar[int] = 0xB3
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(UpdateCommitReply.NAME, UpdateCommitReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateCommitReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class UpdateCommitRequest(Command[UpdateCommitReply]):
    """Checks the CRC over what is in flash, programs the header, and puts the image on trial at the next start."""

    NAME: ClassVar[str] = "update_commit"
    NUMBER: ClassVar[int] = 0x33
    REPLY: ClassVar[type[Any]] = UpdateCommitReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.WRONG_STATE: "no image is being received; run the command again",
    }
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateCommitRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class UpdateRestartReply(Reply):
    """The answer to update_restart."""

    NAME: ClassVar[str] = "update_restart reply"
    NUMBER: ClassVar[int] = 0xB4
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(UpdateRestartReply.NAME, UpdateRestartReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateRestartReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class UpdateRestartRequest(Command[UpdateRestartReply]):
    """Restarts the device, 20 ms after the reply; while parked or in fault, at 0 V."""

    NAME: ClassVar[str] = "update_restart"
    NUMBER: ClassVar[int] = 0x34
    REPLY: ClassVar[type[Any]] = UpdateRestartReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BUSY: "its outputs are on their way to 0 V; try again",
    }
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateRestartRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class UpdateConfirmReply(Reply):
    """The answer to update_confirm."""

    NAME: ClassVar[str] = "update_confirm reply"
    NUMBER: ClassVar[int] = 0xB5
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(UpdateConfirmReply.NAME, UpdateConfirmReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateConfirmReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class UpdateConfirmRequest(Command[UpdateConfirmReply]):
    """The image on trial is to stay: the host has spoken with it and read its build id."""

    NAME: ClassVar[str] = "update_confirm"
    NUMBER: ClassVar[int] = 0x35
    REPLY: ClassVar[type[Any]] = UpdateConfirmReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "it runs another build",
    }
    SIZE: ClassVar[int] = 20
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<20s")
    build_id: bytes

    def pack(self) -> bytes:
        return _pack(
            UpdateConfirmRequest.NAME,
            UpdateConfirmRequest.LAYOUT,
            _exactly("update_confirm.build_id", self.build_id, 20),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> UpdateConfirmRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0])


@dataclass(frozen=True, slots=True)
class LimitsSetReply(Reply):
    """The answer to limits_set."""

    NAME: ClassVar[str] = "limits_set reply"
    NUMBER: ClassVar[int] = 0xA0
    SIZE: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQ")
    status: int
    tick: int
    """the tick before which the command took effect."""

    def pack(self) -> bytes:
        return _pack(LimitsSetReply.NAME, LimitsSetReply.LAYOUT, self.status, self.tick)

    @classmethod
    def unpack(cls, payload: bytes) -> LimitsSetReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class LimitsSetRequest(Command[LimitsSetReply]):
    """Sets the hard limits of all axes and keeps them in flash; while parked and no output moves. Modes and paths
    have to be set again.
    """

    NAME: ClassVar[str] = "limits_set"
    NUMBER: ClassVar[int] = 0x20
    REPLY: ClassVar[type[Any]] = LimitsSetReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "a lower limit that is not below its upper one, or a slew limit of nothing",
        Status.OUTSIDE_LIMITS: "they leave out the present output, 0 V or the safe value of the model",
        Status.BUSY: "its outputs are still moving to the safe value; try again",
        Status.FLASH_FAILED: "they could not be kept in flash; those before still hold",
    }
    SIZE: ClassVar[int] = 36
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<36s")
    limits: tuple[AxisLimits, ...]

    def pack(self) -> bytes:
        if len(self.limits) != 3:
            raise WireError(f"limits_set: 3 limits expected, got {len(self.limits)}")
        return _pack(LimitsSetRequest.NAME, LimitsSetRequest.LAYOUT, b"".join(item.pack() for item in self.limits))

    @classmethod
    def unpack(cls, payload: bytes) -> LimitsSetRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(tuple(AxisLimits.unpack(v[0][i : i + 12]) for i in range(0, 36, 12)))


@dataclass(frozen=True, slots=True)
class LimitsReadReply(Reply):
    """The answer to limits_read."""

    NAME: ClassVar[str] = "limits_read reply"
    NUMBER: ClassVar[int] = 0xA1
    SIZE: ClassVar[int] = 46
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQB36s")
    status: int
    tick: int
    """the tick before which the command took effect."""
    limits_lost: int
    """1: what was set could not be read; arming is refused until limits are set."""
    limits: tuple[AxisLimits, ...]

    def pack(self) -> bytes:
        if len(self.limits) != 3:
            raise WireError(f"limits_read reply: 3 limits expected, got {len(self.limits)}")
        return _pack(
            LimitsReadReply.NAME,
            LimitsReadReply.LAYOUT,
            self.status,
            self.tick,
            self.limits_lost,
            b"".join(item.pack() for item in self.limits),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> LimitsReadReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], tuple(AxisLimits.unpack(v[3][i : i + 12]) for i in range(0, 36, 12)))


@dataclass(frozen=True, slots=True)
class LimitsReadRequest(Command[LimitsReadReply]):
    """The hard limits in force."""

    NAME: ClassVar[str] = "limits_read"
    NUMBER: ClassVar[int] = 0x21
    REPLY: ClassVar[type[Any]] = LimitsReadReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> LimitsReadRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class FaultLogReply(Reply):
    """The answer to fault_log."""

    NAME: ClassVar[str] = "fault_log reply"
    NUMBER: ClassVar[int] = 0xA2
    SIZE: ClassVar[int] = 318
    PLATFORM: ClassVar[frozenset[str]] = frozenset({"power_cycle", "faults"})
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQIB304s")
    status: int
    tick: int
    """the tick before which the command took effect."""
    power_cycle: int
    """starts of the device, resets included."""
    count: int
    faults: tuple[LoggedFault, ...]
    """oldest first."""

    def pack(self) -> bytes:
        if len(self.faults) != 16:
            raise WireError(f"fault_log reply: 16 faults expected, got {len(self.faults)}")
        return _pack(
            FaultLogReply.NAME,
            FaultLogReply.LAYOUT,
            self.status,
            self.tick,
            self.power_cycle,
            self.count,
            b"".join(item.pack() for item in self.faults),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> FaultLogReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], tuple(LoggedFault.unpack(v[4][i : i + 19]) for i in range(0, 304, 19)))


@dataclass(frozen=True, slots=True)
class FaultLogRequest(Command[FaultLogReply]):
    """The last 16 faults, those before the last resets included."""

    NAME: ClassVar[str] = "fault_log"
    NUMBER: ClassVar[int] = 0x22
    REPLY: ClassVar[type[Any]] = FaultLogReply
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> FaultLogRequest:
        payload = cls.fitted(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class TransientArmReply(Reply):
    """The answer to transient_arm."""

    NAME: ClassVar[str] = "transient_arm reply"
    NUMBER: ClassVar[int] = 0xA3
    SIZE: ClassVar[int] = 11
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQH")
    status: int
    tick: int
    """the tick before which the command took effect."""
    entries: int
    """so many it holds."""

    def pack(self) -> bytes:
        return _pack(TransientArmReply.NAME, TransientArmReply.LAYOUT, self.status, self.tick, self.entries)

    @classmethod
    def unpack(cls, payload: bytes) -> TransientArmReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


@dataclass(frozen=True, slots=True)
class TransientArmRequest(Command[TransientArmReply]):
    """Chooses the transient recorder's trigger beside a fault, empties it and lets it wait."""

    NAME: ClassVar[str] = "transient_arm"
    NUMBER: ClassVar[int] = 0x23
    REPLY: ClassVar[type[Any]] = TransientArmReply
    REFUSALS: ClassVar[dict[int, str]] = {
        Status.BAD_VALUE: "no such trigger, axis or channel, decimation 0, or more after the trigger than it holds",
    }
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBBiHH")
    trigger: int
    axis: int
    """threshold: whose channel."""
    channel: int
    """threshold: reference, adc or dac."""
    falling: int
    """threshold: 0: from below, 1: from above."""
    level: int
    """threshold: in the unit of the channel."""
    decimation: int
    """1: every tick."""
    after: int
    """entries after the one of the trigger."""

    def pack(self) -> bytes:
        return _pack(
            TransientArmRequest.NAME,
            TransientArmRequest.LAYOUT,
            self.trigger,
            self.axis,
            self.channel,
            self.falling,
            self.level,
            self.decimation,
            self.after,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> TransientArmRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], v[6])


@dataclass(frozen=True, slots=True)
class TransientReadReply(Reply):
    """The answer to transient_read."""

    NAME: ClassVar[str] = "transient_read reply"
    NUMBER: ClassVar[int] = 0xA4
    SIZE: ClassVar[int] = 28
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BQBBQH3BI")
    status: int
    tick: int
    """the tick before which the command took effect."""
    state: int
    cause: int
    trigger_tick: int
    decimation: int
    modes: tuple[int, ...]
    """at the trigger."""
    size: int
    """bytes that it holds; 0 as long as it is not frozen."""
    data: bytes
    """may be less than was asked for."""

    def pack(self) -> bytes:
        return _pack(
            TransientReadReply.NAME,
            TransientReadReply.LAYOUT,
            self.status,
            self.tick,
            self.state,
            self.cause,
            self.trigger_tick,
            self.decimation,
            *self.modes,
            self.size,
        ) + _tail(TransientReadReply, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> TransientReadReply:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], v[6:9], v[9], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class TransientReadRequest(Command[TransientReadReply]):
    """What the transient recorder does, and once it is frozen what it holds, oldest first: per entry the tick (u32,
    its low half) and for each axis the first five fields of [tick].
    """

    NAME: ClassVar[str] = "transient_read"
    NUMBER: ClassVar[int] = 0x24
    REPLY: ClassVar[type[Any]] = TransientReadReply
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IH")
    offset: int
    length: int

    def pack(self) -> bytes:
        return _pack(TransientReadRequest.NAME, TransientReadRequest.LAYOUT, self.offset, self.length)

    @classmethod
    def unpack(cls, payload: bytes) -> TransientReadRequest:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1])


@dataclass(frozen=True, slots=True)
class Samples(Message):
    """A batch of ticks, never retransmitted. `data` holds, per tick and for each axis of the mask, the fields of
    [tick] that `channels` asks for, in their order.
    """

    NAME: ClassVar[str] = "samples"
    NUMBER: ClassVar[int] = 0x70
    SIZE: ClassVar[int] = 20
    TAIL: ClassVar[bool] = True
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IQIBBH")
    sequence: int
    first_tick: int
    dropped: int
    """ticks dropped since the stream was started, before this batch."""
    channels: int
    axis_mask: int
    decimation: int
    data: bytes

    def pack(self) -> bytes:
        return _pack(
            Samples.NAME,
            Samples.LAYOUT,
            self.sequence,
            self.first_tick,
            self.dropped,
            self.channels,
            self.axis_mask,
            self.decimation,
        ) + _tail(Samples, self.data)

    @classmethod
    def unpack(cls, payload: bytes) -> Samples:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2], v[3], v[4], v[5], payload[cls.SIZE :])


@dataclass(frozen=True, slots=True)
class Event(Message):
    """A change of state, a fault, the end of a path, an edge at the trigger input that was waited for."""

    NAME: ClassVar[str] = "event"
    NUMBER: ClassVar[int] = 0x71
    SIZE: ClassVar[int] = 13
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<QBI")
    tick: int
    kind: int
    value: int
    """state_change: the state; fault: the fault; path_done: the axis; stream_overflow: ticks dropped so far;
    trigger: mask of the axes whose paths it begins.
    """

    def pack(self) -> bytes:
        return _pack(Event.NAME, Event.LAYOUT, self.tick, self.kind, self.value)

    @classmethod
    def unpack(cls, payload: bytes) -> Event:
        payload = cls.fitted(payload)
        v = cls.LAYOUT.unpack_from(payload)
        return cls(v[0], v[1], v[2])


MESSAGES: dict[int, type[Message]] = {
    0x01: HelloRequest,
    0x81: HelloReply,
    0x02: StopRequest,
    0x82: StopReply,
    0x03: StatusRequest,
    0x83: StatusReply,
    0x04: ArmRequest,
    0x84: ArmReply,
    0x05: StartRequest,
    0x85: StartReply,
    0x06: ParkRequest,
    0x86: ParkReply,
    0x07: ClearFaultRequest,
    0x87: ClearFaultReply,
    0x08: SetAxisRequest,
    0x88: SetAxisReply,
    0x09: SetPathRequest,
    0x89: SetPathReply,
    0x0A: WaveChunkRequest,
    0x8A: WaveChunkReply,
    0x0B: WaveCommitRequest,
    0x8B: WaveCommitReply,
    0x0C: ModelBeginRequest,
    0x8C: ModelBeginReply,
    0x0D: ModelChunkRequest,
    0x8D: ModelChunkReply,
    0x0E: ModelCommitRequest,
    0x8E: ModelCommitReply,
    0x0F: ModelReadRequest,
    0x8F: ModelReadReply,
    0x10: ModelPersistRequest,
    0x90: ModelPersistReply,
    0x11: StreamStartRequest,
    0x91: StreamStartReply,
    0x12: StreamStopRequest,
    0x92: StreamStopReply,
    0x13: SnapshotReadRequest,
    0x93: SnapshotReadReply,
    0x14: SetTimeoutRequest,
    0x94: SetTimeoutReply,
    0x15: InfoRequest,
    0x95: InfoReply,
    0x40: MotionRequest,
    0xC0: MotionReply,
    0x41: QueueRequest,
    0xC1: QueueReply,
    0x44: SetJoinsRequest,
    0xC4: SetJoinsReply,
    0x45: PointsBeginRequest,
    0xC5: PointsBeginReply,
    0x46: PointsRequest,
    0xC6: PointsReply,
    0x47: TriggerSetRequest,
    0xC7: TriggerSetReply,
    0x42: SetGainsRequest,
    0xC2: SetGainsReply,
    0x43: WhereRequest,
    0xC3: WhereReply,
    0x30: UpdateInfoRequest,
    0xB0: UpdateInfoReply,
    0x31: UpdateBeginRequest,
    0xB1: UpdateBeginReply,
    0x32: UpdateChunkRequest,
    0xB2: UpdateChunkReply,
    0x33: UpdateCommitRequest,
    0xB3: UpdateCommitReply,
    0x34: UpdateRestartRequest,
    0xB4: UpdateRestartReply,
    0x35: UpdateConfirmRequest,
    0xB5: UpdateConfirmReply,
    0x20: LimitsSetRequest,
    0xA0: LimitsSetReply,
    0x21: LimitsReadRequest,
    0xA1: LimitsReadReply,
    0x22: FaultLogRequest,
    0xA2: FaultLogReply,
    0x23: TransientArmRequest,
    0xA3: TransientArmReply,
    0x24: TransientReadRequest,
    0xA4: TransientReadReply,
    0x70: Samples,
    0x71: Event,
}
"""By number; a reply's is its command's with REPLY_BIT set."""
