"""PID against exact integers, over every gain, error and state that can occur."""

import ctypes as ct

from core_bindings import INT32_MAX, INT32_MIN, PidConfig, PidState, any_i32, round_half_up, saturate, whole
from hypothesis import example, given
from hypothesis import strategies as st

alpha = st.one_of(whole(0, INT32_MAX), st.just(INT32_MAX))
INTEGRAL_LIMIT, DERIVATIVE_LIMIT = 2**55, 2**61
integral = whole(-INTEGRAL_LIMIT, INTEGRAL_LIMIT)
derivative = whole(-DERIVATIVE_LIMIT, DERIVATIVE_LIMIT)
gains = st.builds(PidConfig, any_i32, any_i32, any_i32, alpha)
ordinary_gains = st.builds(PidConfig, whole(-(2**24), 2**24), whole(-(2**24), 2**24), whole(-(2**24), 2**24), alpha)
ordinary_error = whole(-250 * 65536, 250 * 65536)


def least(alpha_q31):
    return PidConfig(INT32_MIN, INT32_MIN, INT32_MIN, alpha_q31)


def expected_step(config, integral_q48, derivative_q40, previous, error):
    """What one step must give: integral, derivative, output, whether anything saturated."""
    integral_q48, s1 = saturate(integral_q48 + config.ki_ts_q32 * error, -INTEGRAL_LIMIT, INTEGRAL_LIMIT)
    raw, s2 = saturate(config.kd_over_ts_q24 * saturate(error - previous)[0], -DERIVATIVE_LIMIT, DERIVATIVE_LIMIT)
    if config.d_alpha_q31 == INT32_MAX:
        derivative_q40 = raw
    else:
        derivative_q40 += round_half_up(config.d_alpha_q31 * (raw - derivative_q40), 31)
    total_q48 = (config.kp_q24 * error + derivative_q40) * 256 + integral_q48
    output, s3 = saturate(round_half_up(total_q48 >> 8, 16))
    return integral_q48, derivative_q40, output, s1 or s2 or s3


@given(gains, integral, derivative, any_i32, any_i32)
@example(least(INT32_MAX), INTEGRAL_LIMIT, 0, INT32_MAX, INT32_MIN)
@example(least(0), -INTEGRAL_LIMIT, DERIVATIVE_LIMIT, INT32_MIN, INT32_MAX)
@example(least(INT32_MAX - 1), 0, -DERIVATIVE_LIMIT, INT32_MAX, INT32_MIN)
@example(least(INT32_MAX - 1), 0, DERIVATIVE_LIMIT, INT32_MIN, INT32_MAX)
def test_step_is_exact(core, config, integral_q48, derivative_q40, previous, error):
    state = PidState(integral_q48, 0, derivative_q40, previous, 1)
    output, saturated = core.flagged("pid_step_q24", config, state, error)
    expected = expected_step(config, integral_q48, derivative_q40, previous, error)
    assert (state.integral_q48, state.derivative_q40, output, saturated) == expected
    assert state.integral_step_q48 == state.integral_q48 - integral_q48
    assert (state.error_q16, state.primed) == (error, 1)


@given(ordinary_gains, st.lists(ordinary_error, min_size=2, max_size=50))
def test_sequence_follows_equation_13(core, config, errors):
    """Without a derivative filter the output is eq. 13 to 0.51 LSB after any number of ticks."""
    config.d_alpha_q31 = INT32_MAX
    state = PidState(error_q16=errors[0])
    total, previous = 0, errors[0]
    for error in errors:
        output, saturated = core.flagged("pid_step_q24", config, state, error)
        total += config.ki_ts_q32 * error
        exact_q48 = (config.kp_q24 * error + config.kd_over_ts_q24 * (error - previous)) * 256 + total
        if saturated or abs(total) >= INTEGRAL_LIMIT:
            return
        assert abs(output * 2**24 - exact_q48) <= 0.51 * 2**24
        previous = error


@given(ordinary_gains, st.lists(ordinary_error, min_size=2, max_size=50))
def test_filtered_derivative_stays_near_the_exact_filter(core, config, errors):
    """Each tick rounds once, by half an LSB of q40, and the filter forgets: n/2 LSB at most after n ticks."""
    state = PidState(error_q16=errors[0])
    exact, previous = 0.0, errors[0]
    for n, error in enumerate(errors):
        core.flagged("pid_step_q24", config, state, error)
        raw = config.kd_over_ts_q24 * (error - previous)
        exact = raw if config.d_alpha_q31 == INT32_MAX else exact + config.d_alpha_q31 / 2**31 * (raw - exact)
        assert abs(state.derivative_q40 - exact) <= 0.5 * n + abs(exact) * 1e-12 + 2**-4 * abs(raw) / 2**44
        previous = error


@given(ordinary_gains, st.lists(any_i32, max_size=50))
def test_integral_is_bounded_whatever_comes(core, config, errors):
    state = PidState()
    for error in errors:
        core.flagged("pid_step_q24", config, state, error)
        assert abs(state.integral_q48) <= INTEGRAL_LIMIT


def test_slow_integrator_does_not_stall(core):
    """1 LSB of error through the least gain still arrives."""
    config, state = PidConfig(0, 1, 0, INT32_MAX), PidState()
    for _ in range(1000):
        core.flagged("pid_step_q24", config, state, 1)
    assert state.integral_q48 == 1000


@given(gains, integral, any_i32, any_i32, whole(-(2**33), 2**33))
def test_unwind_takes_back_only_what_pushes_into_the_cut(core, config, integral_q48, previous, error, cut):
    state = PidState(integral_q48, 0, 0, previous, 1)
    core.flagged("pid_step_q24", config, state, error)
    after, step = state.integral_q48, state.integral_step_q48
    core.pid_unwind(state, cut)
    deeper = (cut < 0 < step) or (step < 0 < cut)
    assert state.integral_q48 == (integral_q48 if deeper else after)


@given(gains, any_i32, any_i32, any_i32, any_i32)
@example(PidConfig(INT32_MIN, 0, 0, 0), 0, INT32_MIN, INT32_MIN, INT32_MAX)
@example(PidConfig(INT32_MIN, 0, 0, 0), 0, INT32_MAX, INT32_MAX, INT32_MIN)
def test_preset_continues_from_the_output(core, config, previous, error, output, feedforward):
    """The step after a preset, its integration aside, gives the old output to 1 LSB, if it fits."""
    state = PidState(0, 5, 0, previous, 0)
    core.pid_preset(config, state, error, output, feedforward)
    wanted_q48 = (output - feedforward) * 2**24 - config.kp_q24 * error * 256
    assert state.integral_q48 == saturate(wanted_q48, -INTEGRAL_LIMIT, INTEGRAL_LIMIT)[0]
    if abs(wanted_q48) <= INTEGRAL_LIMIT:
        without_integration = PidConfig(config.kp_q24, 0, config.kd_over_ts_q24, config.d_alpha_q31)
        feedback, saturated = core.flagged("pid_step_q24", without_integration, state, error)
        assert state.derivative_q40 == 0
        assert saturated or abs(feedback + feedforward - output) <= 1


def test_reset_clears_everything(core):
    state = PidState(1, 2, 3, 4, 5)
    core.pid_reset(state)
    assert bytes(state) == bytes(ct.sizeof(PidState))


def test_sign_convention(core):
    """Below the reference (error > 0) every positive gain pushes the output up."""
    for config in (PidConfig(1 << 20, 0, 0, INT32_MAX), PidConfig(0, 1 << 20, 0, INT32_MAX)):
        assert core.flagged("pid_step_q24", config, PidState(), 65536 * 100)[0] > 0
    falling_behind = PidState(0, 0, 0, 0, 1)
    assert core.flagged("pid_step_q24", PidConfig(0, 0, 1 << 20, INT32_MAX), falling_behind, 65536)[0] > 0
