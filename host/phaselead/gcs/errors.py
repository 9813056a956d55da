"""Error codes of PI's General Command Set, as its manuals list them, and which of them an error of ours is."""

from __future__ import annotations

from enum import IntEnum

from phaselead.device import Refused, wire
from phaselead.errors import DeviceRefused, LinkError, PhaseleadError


class Code(IntEnum):
    """What ERR? answers; the names are PI's, without PI_CNTR."""

    NO_ERROR = 0
    PARAM_SYNTAX = 1
    UNKNOWN_COMMAND = 2
    COMMAND_TOO_LONG = 3
    MOVE_WITHOUT_REF_OR_NO_SERVO = 5
    POS_OUT_OF_LIMITS = 7
    VEL_OUT_OF_LIMITS = 8
    STOP = 10
    INVALID_AXIS_IDENTIFIER = 15
    PARAM_OUT_OF_RANGE = 17
    DOUBLE_AXIS = 22
    PARAM_NR = 24
    MISSING_PARAM = 26
    NO_JOYSTICK_CONNECTED = 40
    COMMUNICATION_ERROR = 52
    UNKNOWN_PARAMETER = 54
    INVALID_RECORDER_CHAN = 57
    INVALID_RECORDER_SRC_OPT = 58
    INVALID_RECORDER_SRC_CHAN = 59
    READ_ONLY_PARAMETER = 64
    WAVE_TOO_LARGE = 67
    DIFFERENT_ARRAY_LENGTH = 70
    WAVE_GENERATOR_ACTIVE = 73
    NO_WAVE_SELECTED = 75
    NOT_ENOUGH_RECORDED_DATA = 77
    WAV_INDEX_ERROR = 400
    WAV_NOT_DEFINED = 401
    WAV_TYPE_NOT_SUPPORTED = 402
    WAV_LENGTH_EXCEEDS_LIMIT = 403
    WAV_PARAMETER_NR = 404
    WAV_PARAMETER_OUT_OF_LIMIT = 405
    WGO_BIT_NOT_SUPPORTED = 406
    UNKNOWN_ERROR = 555
    CONTROLLER_BUSY = 1005
    MOTION_ERROR = 1024


class GcsError(PhaseleadError):
    """A command that was refused. ``code`` is what ERR? will answer."""

    def __init__(self, code: Code, words: str = "") -> None:
        self.code = code
        super().__init__(f"GCS error {code.value} ({code.name}){': ' if words else ''}{words}")


def code_of(error: PhaseleadError) -> Code:
    """The code of any error of the library."""
    if isinstance(error, GcsError):
        return error.code
    if isinstance(error, LinkError):
        return Code.COMMUNICATION_ERROR
    if isinstance(error, Refused) and error.status == wire.Status.OUTSIDE_LIMITS:
        return Code.POS_OUT_OF_LIMITS
    if isinstance(error, DeviceRefused) and "fault" in str(error):
        return Code.MOTION_ERROR
    return Code.UNKNOWN_ERROR
