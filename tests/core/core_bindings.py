"""The control core through ctypes: structs as in firmware/core/*.h, and how the tests build it."""

import ctypes as ct
import random
import re
import subprocess
from enum import IntEnum
from pathlib import Path

from hypothesis import strategies as st

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "firmware"
CORE = FIRMWARE / "core"
HARNESS = Path(__file__).with_name("harness.c")
STRAIGHT = ["axis", "axis_mode", "axis_path", "biquad", "converter", "feedforward", "output", "path", "pid", "segment"]
STRAIGHT += ["sine", "trigger", "watch"]
COUNTED = ["compensation", "creep", "decouple", "fixed", "inverse", "loop_filter", "oscillation"]
"""With loops, each of a constant number of rounds."""
IN_TICK = [*STRAIGHT, *COUNTED]
"""Sources whose every function may run in a tick."""
AT_COMMIT = ["decoupling", "feedforward_tables", "inverse_make", "inverse_memory", "motion_bounds"]
"""What runs when a model is committed or a path is set."""

BENDS_A_TICK = int(re.search(r"BENDS_A_TICK (\d+)", (CORE / "inverse.h").read_text())[1])

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1
INT64_MIN, INT64_MAX = -(2**63), 2**63 - 1


def whole(low: int, high: int) -> st.SearchStrategy[int]:
    """Integers of a range: evenly over it, at its edges, and as hypothesis likes them, which is small. Its own integers
    alone hardly ever reach the upper half of 64 bits."""
    even = st.integers(0, 2**32).map(lambda seed: random.Random(seed).randint(low, high))
    edges = [v for v in (low, low + 1, -1, 0, 1, high - 1, high) if low <= v <= high]
    return st.one_of(even, st.integers(low, high), even, st.sampled_from(edges))


def real(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats of a range, evenly and as hypothesis likes them."""
    even = st.integers(0, 2**32).map(lambda seed: random.Random(seed).uniform(low, high))
    return st.one_of(even, st.floats(low, high))


any_i32, any_u32 = whole(INT32_MIN, INT32_MAX), whole(0, 2**32 - 1)
any_i64, any_u64 = whole(INT64_MIN, INT64_MAX), whole(0, 2**64 - 1)


class Mode(IntEnum):
    IDLE, OPEN, PID, FF, FF_PID, INVERSE, INVERSE_PID = range(7)


class Kind(IntEnum):
    HOLD, SINE, WAVE, MOVE = range(4)


class Command(IntEnum):
    """What a tick of a scenario begins with: an axis_drive to set, a start, or nothing."""

    HOLD, PATH, RAMP, START, NOTHING = range(5)


class Verdict(IntEnum):
    OK, NOT_MONOTONE, GAIN_OUT_OF_RANGE, RECTANGLE_EMPTY, LEAD_OUT_OF_RANGE = range(5)


class PidConfig(ct.Structure):
    _fields_ = [(name, ct.c_int32) for name in ("kp_q24", "ki_ts_q32", "kd_over_ts_q24", "d_alpha_q31")]


class PidState(ct.Structure):
    _fields_ = [
        ("integral_q48", ct.c_int64),
        ("integral_step_q48", ct.c_int64),
        ("derivative_q40", ct.c_int64),
        ("error_q16", ct.c_int32),
        ("primed", ct.c_uint32),
    ]


class PathConfig(ct.Structure):
    _fields_ = [
        ("kind", ct.c_uint32),
        ("swing", ct.c_int32),
        ("offset", ct.c_int32),
        ("flags", ct.c_uint32),
        ("step_turn64", ct.c_uint64),
        ("ticks", ct.c_uint64),
    ]


class PathState(ct.Structure):
    _fields_ = [
        ("phase_turn64", ct.c_uint64),
        ("elapsed", ct.c_uint64),
        ("running", ct.c_uint32),
        ("wait_ticks", ct.c_uint32),
    ]


class Point(ct.Structure):
    _fields_ = [("inverse_gain_q28", ct.c_int32), ("lead_turn32", ct.c_int32)]


class OutputConfig(ct.Structure):
    _fields_ = [("u_min_q24", ct.c_int32), ("u_max_q24", ct.c_int32), ("slew_q24", ct.c_int32)]


class ConverterConfig(ct.Structure):
    _fields_ = [
        ("dac_zero_code", ct.c_int32),
        ("dac_codes_per_V_q16", ct.c_int32),
        ("adc_zero_q8", ct.c_int32),
        ("adc_um_per_code_q32", ct.c_int32),
    ]


class Biquad(ct.Structure):
    """Given and asked for its a1 and a2, of which the core holds the negatives."""

    _fields_ = [(f"{name}_q26", ct.c_int32) for name in ("b0", "b1", "b2", "minus_a1", "minus_a2")]

    def __init__(self, b0=0, b1=0, b2=0, a1=0, a2=0):
        super().__init__(b0, b1, b2, -a1, -a2)

    @property
    def a1_q26(self):
        return -self.minus_a1_q26

    @property
    def a2_q26(self):
        return -self.minus_a2_q26


class BiquadValue(ct.Structure):
    """high x 2^28 + low, q40."""

    _fields_ = [("high_q12", ct.c_int32), ("low_q40", ct.c_int32)]

    @property
    def q40(self):
        return (self.high_q12 << 28) + self.low_q40


class BiquadState(ct.Structure):
    _fields_ = [(name, BiquadValue) for name in ("x1", "x2", "y1", "y2")]


class LoopFilterConfig(ct.Structure):
    _fields_ = [("in_use", ct.c_uint32), ("section", Biquad * 2)]


class LoopSectionState(ct.Structure):
    _fields_ = [*((name, ct.c_int32) for name in ("x1_q24", "x2_q24", "y1_q24", "y2_q24")), ("rest_q50", ct.c_uint32)]


class LoopFilterState(ct.Structure):
    _fields_ = [("primed", ct.c_uint32), ("reserved", ct.c_uint32), ("section", LoopSectionState * 2)]


class AxisConfig(ct.Structure):
    _fields_ = [
        ("mode", ct.c_uint32),
        ("u_park_q24", ct.c_int32),
        ("ramp_q24", ct.c_int32),
        ("error_limit_q16", ct.c_int32),
        ("pid", PidConfig),
        ("path", PathConfig),
        ("point", Point),
        ("output", OutputConfig),
        ("converter", ConverterConfig),
        ("error_ticks", ct.c_uint32),
        ("code_min", ct.c_uint32),
        ("code_max", ct.c_uint32),
        ("oscillation_limit_q16", ct.c_int32),
        ("filter", LoopFilterConfig),
        ("enter_turn64", ct.c_uint64),
        ("leave_turn64", ct.c_uint64),
        ("enter_ticks", ct.c_uint32),
        ("leave_ticks", ct.c_uint32),
        ("window_q16", ct.c_int32),
        ("window_ticks", ct.c_uint32),
    ]


class Segment(ct.Structure):
    _fields_ = [
        ("path", PathConfig),
        ("point", Point),
        ("enter_turn64", ct.c_uint64),
        ("leave_turn64", ct.c_uint64),
        ("begin_tick", ct.c_uint64),
        *((name, ct.c_uint32) for name in ("enter_ticks", "leave_ticks", "number", "together")),
    ]


class SegmentQueue(ct.Structure):
    _fields_ = [
        ("ring", Segment * 8),
        ("dry_tick", ct.c_uint64),
        *((name, ct.c_uint32) for name in ("first", "count", "dry", "reserved")),
    ]


class JoinState(ct.Structure):
    _fields_ = [
        ("path", PathConfig),
        ("point", Point),
        ("state", PathState),
        ("phase_turn64", ct.c_uint64),
        ("step_turn64", ct.c_uint64),
        ("ahead_q16", ct.c_int32),
        ("u_q24", ct.c_int32),
        ("standing", ct.c_uint32),
        ("wait_ticks", ct.c_uint32),
    ]


class MotionBounds(ct.Structure):
    _fields_ = [(name, ct.c_uint64) for name in ("velocity", "acceleration", "jerk")]


class Creep(ct.Structure):
    _fields_ = [
        ("alpha_q64", ct.c_int64 * 8),
        ("k_q30", ct.c_int32 * 8),
        ("in_use", ct.c_uint32),
        ("reserved", ct.c_uint32),
    ]


class CreepState(ct.Structure):
    _fields_ = [("lag_q40", ct.c_int64 * 8)]


class Play(ct.Structure):
    _fields_ = [(name, ct.c_int32) for name in ("r_q24", "sum_q20", "rest_q24")]


class Inverse(ct.Structure):
    _fields_ = [
        ("rest_x_q44", ct.c_int64),
        ("rest_slope_q20", ct.c_int32),
        ("rest_knots", ct.c_uint32),
        ("u_min_q24", ct.c_int32),
        ("u_max_q24", ct.c_int32),
        ("gain_q20", ct.c_int32),
        ("offset_q16", ct.c_int32),
        ("rest_fraction_q30", ct.c_int32),
        ("plays", ct.c_uint32),
        ("knots", ct.c_uint32),
        ("play", Play * 33),
        ("knot_d_q24", ct.c_int32 * 24),
        ("knot_s_q20", ct.c_int32 * 24),
    ]


class InverseState(ct.Structure):
    _fields_ = [
        ("x_q44", ct.c_int64),
        ("v_q24", ct.c_int32),
        ("slope_q20", ct.c_int32),
        *((name, ct.c_uint32) for name in ("knots", "rises", "moving", "turns", "risen")),
        ("turn_q24", ct.c_int32 * 32),
        ("reserved", ct.c_uint32),
    ]


class Extremes(ct.Structure):
    _fields_ = [("low_q24", ct.c_int32), ("high_q24", ct.c_int32), ("rose_last", ct.c_uint32)]


class Decoupling(ct.Structure):
    _fields_ = [("share_q28", ((ct.c_int32 * 3) * 3) * 8)]


class Compensation(ct.Structure):
    _fields_ = [
        ("preview_ticks_q16", ct.c_uint32),
        ("rest_q16", ct.c_int32),
        ("rest_q40", ct.c_int64),
        ("sections_in_use", ct.c_uint32),
        ("per_um_q28", ct.c_int32),
        ("shape", Biquad * 6),
        ("drive", Biquad),
        ("creep", Creep),
        ("inverse", Inverse),
    ]


class CompensationState(ct.Structure):
    _fields_ = [
        ("shape", BiquadState * 6),
        ("drive", BiquadState),
        ("creep", CreepState),
        ("inverse", InverseState),
        ("primed", ct.c_uint32),
        ("reserved", ct.c_uint32),
    ]


class AxisTarget(ct.Structure):
    _fields_ = [
        ("reference", ct.c_int32),
        ("ahead_q16", ct.c_int32),
        ("feedforward_q24", ct.c_int32),
        ("flags", ct.c_uint32),
    ]


class WatchState(ct.Structure):
    _fields_ = [
        ("rail_ticks", ct.c_uint32),
        ("error_ticks", ct.c_uint32),
        ("limited_ticks", ct.c_uint32),
        ("jumps", ct.c_uint32),
        ("calm_ticks", ct.c_uint32),
        ("same_ticks", ct.c_uint32),
        ("same_u_q24", ct.c_int32),
        ("code", ct.c_uint32),
        ("primed", ct.c_uint32),
        ("range_ticks", ct.c_uint32),
        ("padding", ct.c_uint32),
    ]


class OscillationBlock(ct.Structure):
    _fields_ = [
        ("energy", ct.c_uint32),
        ("reference_energy", ct.c_uint32),
        ("before", ct.c_uint32),
        ("parts", ct.c_uint8),
        ("sign_changed", ct.c_uint8),
        ("grown", ct.c_uint8),
        ("weight", ct.c_uint8),
    ]


class OscillationState(ct.Structure):
    _fields_ = [
        ("error_low", ct.c_int32 * 3),
        ("reference_low", ct.c_int32 * 3),
        ("blocks", OscillationBlock * 6),
        ("last_q16", ct.c_int32),
        ("loudest", ct.c_uint32),
        ("loud", ct.c_uint8),
        ("primed", ct.c_uint8),
        ("over", ct.c_uint16),
    ]


class WatchConfig(ct.Structure):
    _fields_ = [("error_limit_q16", ct.c_int32), ("error_ticks", ct.c_uint32), ("u_range_q24", ct.c_uint32)]


class WatchTick(ct.Structure):
    _fields_ = [
        ("adc_code", ct.c_uint16),
        ("limited", ct.c_bool),
        ("u_q24", ct.c_int32),
        ("error_q16", ct.c_int32),
    ]


class AxisState(ct.Structure):
    _fields_ = [
        ("path", PathState),
        ("target", AxisTarget),
        ("pid", PidState),
        ("compensation", CompensationState),
        ("u_q24", ct.c_int32),
        ("drive", ct.c_uint32),
        ("saturations", ct.c_uint32),
        ("watch", WatchState),
        ("join", JoinState),
        ("near_ticks", ct.c_uint32),
        ("oscillation", OscillationState),
        ("filter", LoopFilterState),
    ]


class AxisModel(ct.Structure):
    _fields_ = [
        ("tables", ct.c_void_p),
        ("compensation", ct.POINTER(Compensation)),
        ("wave_q30", ct.c_void_p),
    ]


class AxisTrace(ct.Structure):
    _fields_ = [
        ("reference", ct.c_int32),
        ("feedforward_q24", ct.c_int32),
        ("feedback_q24", ct.c_int32),
        ("dac_code", ct.c_uint16),
        ("path_done", ct.c_bool),
        ("inverted", ct.c_bool),
        ("limited", ct.c_bool),
    ]


class Tick(ct.Structure):
    _fields_ = [("adc_code", ct.c_uint16), ("command", ct.c_uint16)]


class FeedforwardModel(ct.Structure):
    _fields_ = [
        ("a_q32", ct.c_int64 * 3),
        ("b_q40", ct.c_int64 * 6),
        ("swing_min_q24", ct.c_int32),
        ("swing_max_q24", ct.c_int32),
        ("f_min_q16", ct.c_int32),
        ("f_max_q16", ct.c_int32),
    ]


class FeedforwardTables(ct.Structure):
    _fields_ = [
        ("range_min_q16", ct.c_int32),
        ("range_max_q16", ct.c_int32),
        ("f_min_q16", ct.c_int32),
        ("f_max_q16", ct.c_int32),
        ("range_inverse_q63", ct.c_uint64),
        ("f_inverse_q63", ct.c_uint64),
        ("swing_q24", ct.c_int32 * 65),
        ("inverse_gain_q28", ct.c_int32 * 65),
        ("lead_turn32", (ct.c_int32 * 65) * 17),
    ]


I32, I64, U16, U32, U64 = ct.c_int32, ct.c_int64, ct.c_uint16, ct.c_uint32, ct.c_uint64
FLAG = ct.POINTER(ct.c_bool)
PROTOTYPES = {
    "h_floor_shift_i64": (I64, [I64, ct.c_uint]),
    "h_round_shift_i64": (I64, [I64, ct.c_uint]),
    "h_sat_i32": (I32, [I64, FLAG]),
    "h_sat_add_i64": (I64, [I64, I64, FLAG]),
    "h_sat_between_i64": (I64, [I64, I64, I64, FLAG]),
    "h_sat_power_i64": (I64, [I64, ct.c_uint, FLAG]),
    "h_sat_below_power_i64": (I64, [I64, ct.c_uint, FLAG]),
    "h_sat_add_i32": (I32, [I32, I32, FLAG]),
    "h_sat_sub_i32": (I32, [I32, I32, FLAG]),
    "h_sat_i16": (I32, [I32]),
    "h_leading_zeros_u32": (ct.c_uint, [ct.c_uint32]),
    "h_leading_zeros_portable_u32": (ct.c_uint, [ct.c_uint32]),
    "h_trailing_zeros_u32": (ct.c_uint, [ct.c_uint32]),
    "h_mul_high_i32": (I32, [I32, I32]),
    "h_mul_high_round_i32": (I32, [I32, I32]),
    "h_mul_shift_i32": (I32, [I32, I32, ct.c_uint, FLAG]),
    "h_mul_shift_i64": (I64, [I64, I64, ct.c_uint, FLAG]),
    "h_mul_wide_u64": (U64, [U64, U64, ct.POINTER(U64)]),
    "h_lerp_i32": (I32, [I32, I32, U32]),
    "h_clamp_i32": (I32, [I32, I32, I32]),
    "h_sine_many": (None, [ct.c_void_p, ct.c_void_p, ct.c_size_t]),
    "h_sizeof": (ct.c_size_t, [ct.c_int]),
    "h_add_mul_shift64_i64": (I64, [I64, I64, I64]),
    "h_ratio_u32": (U32, [U64, U32]),
    "h_add_i32": (I32, [I32, I32]),
    "h_sub_i32": (I32, [I32, I32]),
    "h_round_shift_i32": (I32, [I32, ct.c_uint]),
    "h_run": (None, [ct.c_void_p] * 5 + [ct.c_size_t]),
    "h_biquad_many": (None, [ct.POINTER(Biquad), ct.c_size_t, ct.c_void_p, ct.c_size_t]),
    "h_inverse_many": (None, [ct.POINTER(Inverse), ct.POINTER(InverseState), ct.c_void_p, ct.c_void_p, ct.c_size_t]),
    "h_creep_many": (None, [ct.POINTER(Creep), ct.POINTER(CreepState), ct.c_void_p, ct.c_size_t]),
    "biquad_is_usable": (ct.c_bool, [ct.POINTER(Biquad)]),
    "biquad_step_q40": (I64, [ct.POINTER(Biquad), ct.POINTER(BiquadState), I64, FLAG]),
    "biquad_admit": (None, [ct.POINTER(BiquadState)]),
    "creep_admit": (None, [ct.POINTER(CreepState)]),
    "creep_make": (ct.c_bool, [ct.POINTER(Creep)]),
    "inverse_make": (ct.c_int, [ct.POINTER(Inverse), I32 * 32]),
    "inverse_admit": (None, [ct.POINTER(Inverse), ct.POINTER(InverseState)]),
    "inverse_play_q24": (I64, [ct.POINTER(Inverse), ct.POINTER(InverseState), ct.c_uint]),
    "inverse_rest": (None, [ct.POINTER(Inverse), ct.POINTER(InverseState), I32]),
    "inverse_begin_after": (None, [ct.POINTER(Inverse), ct.POINTER(InverseState), ct.POINTER(Extremes), I32]),
    "h_extremes_follow": (None, [ct.POINTER(Extremes), I32]),
    "inverse_recall": (None, [*[ct.POINTER(Inverse), ct.POINTER(InverseState)] * 2, I32]),
    "inverse_follow": (None, [ct.POINTER(Inverse), ct.POINTER(InverseState), I32]),
    "inverse_step_q24": (I32, [ct.POINTER(Inverse), ct.POINTER(InverseState), I64, I32, FLAG]),
    "inverse_reach_q16": (None, [ct.POINTER(Inverse), ct.POINTER(I32), ct.POINTER(I32)]),
    "inverse_per_um_q28": (I32, [ct.POINTER(Inverse), I32]),
    "decoupling_takes": (ct.c_bool, [I32 * 3, ct.c_uint]),
    "couple": (None, [(I32 * 3) * 3, U32, I32 * 3]),
    "decoupling_make": (ct.c_bool, [ct.POINTER((I32 * 3) * 3), ct.POINTER(Decoupling)]),
    "decouple": (None, [ct.POINTER(Decoupling), U32, I32 * 3, FLAG]),
    "segment_put": (None, [ct.POINTER(SegmentQueue), ct.POINTER(Segment), U32]),
    "segment_first": (ct.POINTER(Segment), [ct.POINTER(SegmentQueue)]),
    "segment_last": (ct.POINTER(Segment), [ct.POINTER(SegmentQueue)]),
    "segment_drop_first": (None, [ct.POINTER(SegmentQueue)]),
    "segment_drop_all": (None, [ct.POINTER(SegmentQueue)]),
    "compensation_make": (ct.c_bool, [ct.POINTER(Compensation)]),
    "compensation_admit": (None, [ct.POINTER(Compensation), ct.POINTER(CompensationState)]),
    "compensation_rest": (None, [ct.POINTER(Compensation), ct.POINTER(CompensationState), I32]),
    "compensation_follow": (None, [ct.POINTER(Compensation), ct.POINTER(CompensationState), I32]),
    "compensation_here_q16": (I32, [ct.POINTER(Compensation), ct.POINTER(CompensationState)]),
    "compensation_step_q24": (I32, [ct.POINTER(Compensation), ct.POINTER(CompensationState), I32, I32, FLAG]),
    "sine_q30": (I32, [U32]),
    "path_start": (None, [ct.POINTER(PathState)]),
    "path_now": (I32, [ct.POINTER(PathConfig), ct.POINTER(PathState), ct.c_void_p, FLAG]),
    "path_ahead": (I32, [ct.POINTER(PathConfig), ct.POINTER(PathState), ct.c_void_p, I32, U32, FLAG]),
    "path_advance": (ct.c_bool, [ct.POINTER(PathConfig), ct.POINTER(PathState)]),
    "pid_reset": (None, [ct.POINTER(PidState)]),
    "pid_step_q24": (I32, [ct.POINTER(PidConfig), ct.POINTER(PidState), I32, FLAG]),
    "pid_unwind": (None, [ct.POINTER(PidState), I64]),
    "pid_preset": (None, [ct.POINTER(PidConfig), ct.POINTER(PidState), I32, I32, I32]),
    "output_limit_q24": (I32, [ct.POINTER(OutputConfig), I32, I32, FLAG]),
    "converter_dac_code": (U16, [ct.POINTER(ConverterConfig), I32, FLAG]),
    "converter_position_q16": (I32, [ct.POINTER(ConverterConfig), U16, FLAG]),
    "feedforward_expand": (ct.c_int, [ct.POINTER(FeedforwardModel), ct.POINTER(FeedforwardTables)]),
    "feedforward_lookup": (ct.c_bool, [ct.POINTER(FeedforwardTables), I32, I32, ct.POINTER(Point)]),
    "feedforward_static_q24": (I32, [ct.POINTER(FeedforwardTables), I32]),
    "feedforward_step_q24": (I32, [ct.POINTER(Point), I32, FLAG]),
    "loop_filter_make": (ct.c_bool, [ct.POINTER(LoopFilterConfig), ct.POINTER(Biquad)]),
    "loop_filter_exchange": (
        None,
        [ct.POINTER(LoopFilterConfig), ct.POINTER(LoopFilterConfig), ct.POINTER(LoopFilterState)],
    ),
    "loop_filter_is_usable": (ct.c_bool, [ct.POINTER(LoopFilterConfig)]),
    "loop_filter_step_q24": (I32, [ct.POINTER(LoopFilterConfig), ct.POINTER(LoopFilterState), I32, FLAG]),
    "axis_start": (None, [ct.POINTER(AxisState)]),
    "axis_begin": (
        None,
        [ct.POINTER(AxisConfig), ct.POINTER(AxisModel), ct.POINTER(AxisState), ct.POINTER(Segment), U32],
    ),
    "axis_enter": (None, [ct.POINTER(AxisConfig), ct.POINTER(AxisModel), ct.POINTER(AxisState), U16, U32]),
    "axis_leave": (ct.c_bool, [ct.POINTER(AxisConfig), ct.POINTER(AxisModel), ct.POINTER(AxisState)]),
    "path_least_jerk_q30": (U32, [U64]),
    "pid_exchange": (None, [ct.POINTER(PidConfig), ct.POINTER(PidConfig), ct.POINTER(PidState)]),
    "motion_of_path": (MotionBounds, [ct.POINTER(PathConfig), U32]),
    "motion_of_join": (MotionBounds, [ct.POINTER(MotionBounds), ct.POINTER(MotionBounds), U64, U64]),
    "motion_steepest_q30": (U32, [ct.c_void_p]),
    "oscillation_step": (ct.c_bool, [ct.POINTER(OscillationState), I32, I32, I32]),
    "watch_range": (ct.c_bool, [ct.POINTER(WatchState), U16, ct.c_uint32, ct.c_uint32]),
    "watch_step": (ct.c_int, [ct.POINTER(WatchConfig), ct.POINTER(WatchState), ct.POINTER(WatchTick)]),
    "axis_set_target": (ct.c_bool, [ct.POINTER(AxisConfig), ct.POINTER(AxisModel), ct.POINTER(AxisState)]),
    "axis_step": (
        ct.c_bool,
        [ct.POINTER(AxisConfig), ct.POINTER(AxisState), U16, I32, ct.POINTER(AxisTrace)],
    ),
}


class Core:
    """The core's functions. Those that report saturation through a pointer are called with `flagged`."""

    def __init__(self, library: Path) -> None:
        self._library = ct.CDLL(str(library))
        for name, (result, arguments) in PROTOTYPES.items():
            function = getattr(self._library, name)
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def flagged(self, name, *arguments):
        """Result and saturation flag of a function whose last argument is that flag."""
        saturated = ct.c_bool(False)
        result = getattr(self, name)(*arguments, ct.byref(saturated))
        return result, saturated.value

    def run(self, config, state, ticks, *, tables=None, wave=None, compensation=None):
        """Runs an axis once per (adc_code, command); the traces. `wave`: 1024 int32 q30 or None."""
        ticks = (Tick * len(ticks))(*ticks)
        traces = (AxisTrace * len(ticks))()
        model = AxisModel(
            ct.addressof(tables) if tables is not None else None,
            ct.pointer(compensation) if compensation is not None else None,
            wave.ctypes.data if wave is not None else None,
        )
        pointers = [ct.addressof(x) for x in (config, model, state, ticks, traces)]
        self.h_run(*pointers, len(ticks))
        return traces


def compile_core(output: Path, compiler: str, *flags: str) -> Path:
    """Core and harness into `output`, with every warning an error."""
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wpedantic", "-Werror"]
    sources = [str(source) for source in sorted(CORE.glob("*.c"))]
    command = [compiler, "-std=c11", *warnings, *flags, f"-I{FIRMWARE}", *sources, str(HARNESS)]
    subprocess.run([*command, "-o", str(output)], check=True, capture_output=True, text=True)
    return output


def wrap_turn64(turns: float) -> int:
    return round(turns * 2**64) % 2**64


def round_half_up(numerator: int, bits: int) -> int:
    """floor(numerator / 2^bits + 1/2), exactly."""
    return (numerator + (1 << bits >> 1)) >> bits


def saturate(value: int, low: int = INT32_MIN, high: int = INT32_MAX) -> tuple[int, bool]:
    limited = max(low, min(high, value))
    return limited, limited != value
