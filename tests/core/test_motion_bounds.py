"""Bounds on velocity, acceleration and jerk: above the exact ones, and by how little."""

import math

import numpy as np
from core_bindings import INT32_MAX, Kind, MotionBounds, PathConfig, PidConfig, PidState, any_u64, saturate, whole
from hypothesis import given

NAMES = ("velocity", "acceleration", "jerk")
FINE = 2**24
MOVE = (15 / 8, 10 / math.sqrt(3), 60)
SINE = (math.pi, 2 * math.pi**2, 4 * math.pi**3)

swing = whole(-INT32_MAX, INT32_MAX)
step = whole(2**40, 2**63)
"""Of paths from two ticks to an hour."""


def bounds(motion):
    return [getattr(motion, name) for name in NAMES]


def above_by_little(found, exact):
    """Not below, and above by rounding alone: one unit for each product, and a thousandth of the constant."""
    assert exact <= found + 1e-9 * exact
    assert found <= min(2**64 - 1, exact * 1.002 + 130_000)


@given(swing, step)
def test_moves_and_sines(core, swing, step):
    for kind, constants in ((Kind.MOVE, MOVE), (Kind.SINE, SINE)):
        found = core.motion_of_path(PathConfig(kind, swing, 0, 0, step), 0)
        for order, (bound, constant) in enumerate(zip(bounds(found), constants, strict=True), 1):
            above_by_little(bound, constant * abs(swing) * FINE * (step / 2**64) ** order)


@given(swing, step, whole(0, 2**30))
def test_a_waveform_is_as_fast_as_its_steepest_line(core, swing, step, steepest):
    found = core.motion_of_path(PathConfig(Kind.WAVE, abs(swing), 0, 0, step), steepest)
    exact = abs(swing) * FINE * (steepest / 2**30) * 1024 * step / 2**64
    assert exact <= found.velocity + 1e-9 * exact
    assert found.velocity <= exact * (1 + 1e-9) + steepest / 2**20 + 3
    assert (found.acceleration, found.jerk) == (0, 0)


@given(whole(0, 2**30), whole(0, 2**30))
def test_steepest_of_a_wave(core, high, at):
    wave = np.zeros(1024, np.int32)
    wave[at % 1024] = high
    assert core.motion_steepest_q30(wave.ctypes.data) == high


@given(*[whole(0, 2**40)] * 6, whole(0, 2**33), whole(2**48, 2**63))
def test_joins(core, va, aa, ja, vb, ab, jb, apart, step):
    a, b = (va, aa, ja), (vb, ab, jb)
    found = core.motion_of_join(MotionBounds(*a), MotionBounds(*b), apart, step)
    s, d = step / 2**64, apart * FINE
    first, second, third = (m * d * s**order for order, m in enumerate(MOVE, 1))
    exact = (
        max(va, vb) + first,
        max(aa, ab) + 2 * MOVE[0] * (va + vb) * s + second,
        max(ja, jb) + 3 * MOVE[0] * (aa + ab) * s + 3 * MOVE[1] * (va + vb) * s * s + third,
    )
    for bound, value in zip(bounds(found), exact, strict=True):
        above_by_little(bound, value)


@given(*[any_u64] * 8)
def test_nothing_wraps(core, va, aa, ja, vb, ab, jb, apart, step):
    """Of two paths the faster one is never faster than their join."""
    found = core.motion_of_join(MotionBounds(va, aa, ja), MotionBounds(vb, ab, jb), apart, step)
    faster = np.maximum(np.array([va, aa, ja], np.uint64), np.array([vb, ab, jb], np.uint64))
    assert (np.array(bounds(found), np.uint64) >= faster).all()


@given(any_u64)
def test_weight_of_a_join(core, phase):
    s = phase / 2**64
    assert abs(core.path_least_jerk_q30(phase) - 2**30 * s**3 * (10 - 15 * s + 6 * s * s)) <= 5


@given(whole(0, 2**26), whole(0, 2**26), whole(-(2**24), 2**24), whole(-(2**40), 2**40))
def test_the_integrator_takes_over_what_p_changes_by(core, kp, other_kp, error, integral):
    state = PidState(integral_q48=integral, error_q16=error, primed=1)
    before, after = PidConfig(kp, 0, 0, INT32_MAX), PidConfig(other_kp, 0, 0, INT32_MAX)
    steady = PidState(integral_q48=integral, error_q16=error, primed=1)
    core.pid_exchange(before, after, state)
    old, _ = core.flagged("pid_step_q24", before, steady, error)
    new, _ = core.flagged("pid_step_q24", after, state, error)
    assert abs(new - old) <= 1 or abs(state.integral_q48) >= 2**54 or saturate(old)[1]
