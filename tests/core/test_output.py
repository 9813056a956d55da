from core_bindings import INT32_MAX, INT32_MIN, OutputConfig, any_i32, whole
from hypothesis import example, given

slew = whole(0, INT32_MAX)


def limited(low, high, step, previous, wanted):
    slewed = max(previous - step, min(previous + step, wanted))
    return max(low, min(high, slewed))


@given(any_i32, any_i32, slew, any_i32, any_i32)
@example(INT32_MIN, INT32_MAX, 0, INT32_MIN, INT32_MAX)
@example(INT32_MIN, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MAX)
@example(INT32_MIN, INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN)
@example(0, 0, 0, INT32_MAX, INT32_MIN)
def test_slew_then_clamp_exactly(core, one, other, step, previous, wanted):
    low, high = sorted((one, other))
    config = OutputConfig(low, high, step)
    expected = limited(low, high, step, previous, wanted)
    assert core.flagged("output_limit_q24", config, previous, wanted) == (expected, expected != wanted)


@given(any_i32, any_i32, whole(INT32_MIN, -1), any_i32, any_i32)
def test_clamp_holds_even_with_a_senseless_slew(core, one, other, step, previous, wanted):
    low, high = sorted((one, other))
    result, _ = core.flagged("output_limit_q24", OutputConfig(low, high, step), previous, wanted)
    assert low <= result <= high


@given(any_i32, any_i32, any_i32, slew)
def test_a_steady_wish_is_reached_and_kept(core, one, other, wanted, step):
    """From inside the clamp, no step exceeds the slew limit, and a wish within both is met at once."""
    low, high = sorted((one, other))
    wanted = max(low, min(high, wanted))
    config = OutputConfig(low, high, step)
    u, was_limited = core.flagged("output_limit_q24", config, low, wanted)
    assert abs(u - low) <= step
    assert was_limited == (wanted - low > step)
    assert core.flagged("output_limit_q24", config, wanted, wanted) == (wanted, False)
