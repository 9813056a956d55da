"""Converters: exactly the nearest code, exactly the nearest q16, for every calibration and every value."""

from core_bindings import INT32_MAX, INT32_MIN, ConverterConfig, any_i32, round_half_up, saturate, whole
from hypothesis import example, given

code = whole(0, 65535)
STANDARD = ConverterConfig(32768, 3200 * 65536, 599186, 280 * 65536)


@given(any_i32, any_i32, any_i32)
@example(INT32_MIN, INT32_MIN, INT32_MIN)
@example(INT32_MAX, INT32_MIN, INT32_MIN)
@example(32768, 3200 * 65536, INT32_MAX)
def test_dac_code_is_nearest(core, zero, scale, u_q24):
    config = ConverterConfig(zero, scale, 0, 0)
    expected = saturate(zero + round_half_up(u_q24 * scale, 40), 0, 65535)
    assert core.flagged("converter_dac_code", config, u_q24) == expected


@given(whole(-(2**30), 2**30), any_i32, code)
@example(-(2**30), INT32_MIN, 65535)
@example(-(2**30), INT32_MAX, 65535)
@example(2**30, INT32_MIN, 0)
def test_position_is_nearest(core, zero_q8, scale, adc_code):
    config = ConverterConfig(0, 0, zero_q8, scale)
    expected = saturate(round_half_up((256 * adc_code - zero_q8) * scale, 24))
    assert core.flagged("converter_position_q16", config, adc_code) == expected


@given(code)
def test_default_dac_gives_every_code_back(core, wanted):
    """A code's own voltage converts to that code: the scale neither skips nor merges codes."""
    u_q24 = round((wanted - 32768) / 3200 * 2**24)
    assert core.flagged("converter_dac_code", STANDARD, u_q24) == (wanted, False)


def test_default_rails(core):
    assert core.flagged("converter_dac_code", STANDARD, int(10.24 * 2**24)) == (65535, True)
    assert core.flagged("converter_dac_code", STANDARD, int(10.2 * 2**24)) == (65408, False)
    assert core.flagged("converter_dac_code", STANDARD, -int(10.2 * 2**24)) == (128, False)
    assert core.flagged("converter_dac_code", STANDARD, 0) == (32768, False)
