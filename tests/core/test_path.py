from fractions import Fraction

import numpy as np
import pytest
from core_bindings import (
    INT32_MAX,
    INT32_MIN,
    Kind,
    PathConfig,
    PathState,
    any_i32,
    any_u32,
    any_u64,
    saturate,
    whole,
    wrap_turn64,
)
from hypothesis import example, given
from hypothesis import strategies as st

wave_points = st.lists(whole(0, 2**30), min_size=1, max_size=64)
MOVE_ENDED = 2**64 - 1


def state_at(phase_turn64, running=1):
    return PathState(phase_turn64, 0, running, 0)


def wave_array(points):
    """1024 points that repeat `points`."""
    return np.resize(np.array(points, dtype=np.int32), 1024)


def close_to(result, exact, bound):
    """The value is within `bound` LSB of the exact one after saturation; a flag means it was at the edge."""
    value, saturated = result
    assert abs(value - max(INT32_MIN, min(INT32_MAX, exact))) <= bound
    if saturated:
        assert value in (INT32_MIN, INT32_MAX)
    elif not INT32_MIN - bound <= exact <= INT32_MAX + bound:
        pytest.fail("a saturation was not reported")


@given(any_i32, any_i32, any_u64)
@example(INT32_MIN, INT32_MIN, 2**63)
@example(INT32_MAX, INT32_MAX, 2**63)
@example(INT32_MAX, INT32_MIN, 2**63)
@example(1, 0, 2**64 - 1)
def test_sine(core, swing, offset, phase):
    share = (1 - np.cos(phase * (2 * np.pi / 2**64))) / 2
    config = PathConfig(Kind.SINE, swing, offset)
    result = core.flagged("path_now", config, state_at(phase), None)
    close_to(result, offset + swing * share, 0.5 + 2 * abs(swing) / 2**31)


def test_sine_rises_from_its_lowest_value(core):
    config = PathConfig(Kind.SINE, 60 * 65536, 20 * 65536)
    for turns, value_um in [(0, 20), (0.25, 50), (0.5, 80), (0.75, 50)]:
        state = state_at(wrap_turn64(turns))
        assert core.flagged("path_now", config, state, None) == (value_um * 65536, False)


@given(any_i32, any_i32, any_u64, wave_points)
@example(INT32_MIN, INT32_MAX, 2**64 - 1, [2**30, 0])
@example(2**20, 0, 2**64 - 2**53, [2**30, 0])  # half way from the last point to the first
def test_wave_interpolates_its_points(core, swing, offset, phase, points):
    wave = wave_array(points)
    place = Fraction(phase, 2**54)
    point, fraction = int(place), place - int(place)
    a, b = int(wave[point]), int(wave[(point + 1) % 1024])
    exact = offset + swing * (a + (b - a) * fraction) / 2**30
    # half an LSB of q30 for the interpolation, half of turn32 for the phase, half of the result
    bound = 0.5 + abs(swing) / 2**30 * (0.5 + abs(b - a) / 2**23)
    result = core.flagged("path_now", PathConfig(Kind.WAVE, swing, offset), state_at(phase), wave.ctypes.data)
    close_to(result, exact, bound + 1e-6)


@given(any_i32, any_i32, any_u64, any_i32)
@example(INT32_MIN, INT32_MIN, 0, INT32_MIN)
def test_wave_of_any_integers_saturates_rather_than_wraps(core, swing, offset, phase, point):
    wave = wave_array([point])
    result = core.flagged("path_now", PathConfig(Kind.WAVE, swing, offset), state_at(phase), wave.ctypes.data)
    assert result == saturate(offset + ((swing * point + 2**29) >> 30))


def test_wave_without_points_is_its_offset(core):
    config = PathConfig(Kind.WAVE, 1000, 77)
    assert core.flagged("path_now", config, state_at(2**62), None) == (77, False)


@given(any_i32, any_i32, any_u64)
@example(INT32_MIN, INT32_MAX, MOVE_ENDED)
@example(INT32_MAX, INT32_MIN, MOVE_ENDED - INT32_MAX)
@example(INT32_MAX, INT32_MIN, MOVE_ENDED - INT32_MAX - 1)
def test_move_is_the_polynomial_of_least_jerk(core, swing, offset, phase):
    s = Fraction(phase, 2**64)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    result = core.flagged("path_now", PathConfig(Kind.MOVE, swing, offset), state_at(phase), None)
    close_to(result, offset + swing * share, 0.5 + 8 * abs(swing) / 2**31)


@given(any_i32, any_i32, whole(1, 2**31))
def test_move_arrives_exactly(core, swing, offset, duration):
    """However 2^64 / duration was rounded, the last tick ends at the target, to the LSB."""
    for step in (2**64 // duration, -(-(2**64) // duration)):
        config = PathConfig(Kind.MOVE, swing, offset, 0, min(step, 2**64 - 1), duration)
        state = PathState(min(step * (duration - 1), 2**64 - 1), duration - 1, 1)
        assert core.path_advance(config, state)
        assert core.flagged("path_now", config, state, None) == saturate(offset + swing)


@given(any_i32, any_i32, any_u64, st.sampled_from([Kind.HOLD, 4, 2**32 - 1]))
def test_hold_and_unknown_kinds_are_the_offset(core, swing, offset, phase, kind):
    config = PathConfig(kind, swing, offset)
    assert core.flagged("path_now", config, state_at(phase), None) == (offset, False)


@given(any_i32, any_i32, any_u64, st.sampled_from([Kind.SINE, Kind.WAVE]), any_i32, wave_points)
def test_ahead_is_the_value_a_lead_later(core, swing, offset, phase, kind, lead, points):
    wave = wave_array(points)
    config = PathConfig(kind, swing, offset)
    ahead = core.flagged("path_ahead", config, state_at(phase), wave.ctypes.data, lead, 0)
    later = state_at((phase + lead * 2**32) % 2**64)
    assert ahead == core.flagged("path_now", config, later, wave.ctypes.data)


@given(any_i32, any_i32, any_u64, any_u64, any_u32)
@example(1, 0, 0, 2**64 - 1, 2**32 - 1)
@example(1, 0, 0, 2**48, 65536)
def test_ahead_of_a_move_never_passes_its_end(core, swing, offset, phase, step, lead_ticks_q16):
    config = PathConfig(Kind.MOVE, swing, offset, 0, step)
    ahead = core.flagged("path_ahead", config, state_at(phase), None, 0, lead_ticks_q16)
    later = state_at(min(phase + (step * lead_ticks_q16 >> 16), 2**64 - 1))
    assert ahead == core.flagged("path_now", config, later, None)


@given(any_i32, any_i32, any_u64, any_u64, st.sampled_from([Kind.SINE, Kind.MOVE, Kind.HOLD]), any_i32, any_u32)
def test_no_lead_once_the_path_is_done(core, swing, offset, phase, step, kind, lead, lead_ticks_q16):
    config = PathConfig(kind, swing, offset, 0, step)
    done = state_at(phase, running=0)
    assert core.flagged("path_ahead", config, done, None, lead, lead_ticks_q16) == core.flagged(
        "path_now", config, done, None
    )


@given(st.sampled_from(Kind), any_u64, st.integers(0, 40), st.integers(1, 60))
def test_sequence_of_ticks(core, kind, step, ticks, n):
    """Phase, length and the one `done` of a path, against integers."""
    config = PathConfig(kind, 1000, 0, 0, step, ticks)
    state = PathState(123, 456, 0, 0)
    core.path_start(state)
    phase, running, elapsed = 0, True, 0
    for _ in range(n):
        done = core.path_advance(config, state)
        expected = False
        if running:
            elapsed += 1
            phase = min(phase + step, MOVE_ENDED) if kind == Kind.MOVE else (phase + step) % 2**64
            arrived = kind == Kind.MOVE and phase == MOVE_ENDED
            expected = elapsed >= ticks if ticks else arrived
            running = not expected
        assert done == expected
        assert (state.phase_turn64, state.elapsed, state.running) == (phase, elapsed, int(running))


def test_a_path_not_started_stays_at_its_start(core):
    config = PathConfig(Kind.SINE, 1000, 7, 0, 2**60, 0)
    state = PathState()
    assert not core.path_advance(config, state)
    assert core.flagged("path_now", config, state, None) == (7, False)


def test_phase_does_not_drift(core):
    """5 Hz for a day of ticks: the phase is off by less than the rounding of its step, times the ticks."""
    ticks = 5000 * 86400
    step = wrap_turn64(5 / 5000)
    assert abs(step * ticks / 2**64 - 5 * 86400) < 1e-9
