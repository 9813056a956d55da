"""Gains, paths and codes in units, and as the integers that travel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.encode_filters import encode_filters
from phaselead.device.stream import AXES
from phaselead.errors import BadInput
from phaselead.model import LoopFilter

TICK_HZ = 5000
STOP_S = 0.02
"""Of the join from what an axis follows to a hold; longer where the limits want it."""
UNFILTERED_Q31 = 0x7FFFFFFF
I32_MAX = 2**31 - 1
WAVE_POINTS = 1024
ADC_ZERO_BIT = 24
"""From here on the flags of an axis hold 256ths of a code (firmware/app/model_slot.h)."""


def to_i32(value: float, bits: int, what: str, unit: str) -> int:
    """``value`` x 2^bits, rounded to nearest. ``what`` and ``unit`` are for the message.

    Raises:
        BadInput: not finite, beyond int32, or so small that nothing but zero is left of it.
    """
    if not math.isfinite(value):
        raise BadInput(f"{what} = {value} {unit} is no number; give a finite value")
    scaled = round(float(value) * 2.0**bits)
    limit = I32_MAX / 2**bits
    if not -I32_MAX - 1 <= scaled <= I32_MAX:
        times = abs(value) / limit
        raise BadInput(f"{what} = {value:g} {unit} does not fit its format: at most {limit:.12g} {unit}, {times:.3g} x")
    if value != 0 and scaled == 0:
        raise BadInput(f"{what} = {value:g} {unit} is too small for its format: its step is {2.0**-bits:g} {unit}")
    return scaled


def derivative_alpha_q31(f_Hz: float | None) -> int:
    """Coefficient of the filter y += alpha (x - y): the sampled first-order low-pass with corner f_Hz."""
    if f_Hz is None:
        return UNFILTERED_Q31
    if not f_Hz > 0:
        raise BadInput(f"derivative filter of {f_Hz:g} Hz: must be above 0, or none at all")
    return max(1, min(UNFILTERED_Q31 - 1, round(-math.expm1(-2 * math.pi * f_Hz / TICK_HZ) * 2**31)))


def axis_request(
    axis: int,
    mode: wire.Mode,
    kp_V_per_um: float,
    ki_V_per_um_s: float,
    kd_V_s_per_um: float,
    derivative_filter_Hz: float | None,
    filters: Sequence[LoopFilter] = (),
) -> wire.SetAxisRequest:
    """Gains as they travel: Kp, Ki Ts, Kd/Ts (DESIGN: the fixed-point contract); and the filters behind them."""
    return wire.SetAxisRequest(
        axis,
        mode,
        to_i32(kp_V_per_um, 24, "Kp", "V/um"),
        _per_tick(ki_V_per_um_s / TICK_HZ, 32, "Ki", ki_V_per_um_s, TICK_HZ, "V/(um s)"),
        _per_tick(kd_V_s_per_um * TICK_HZ, 24, "Kd", kd_V_s_per_um, 1 / TICK_HZ, "V s/um"),
        derivative_alpha_q31(derivative_filter_Hz),
        encode_filters(filters),
    )


def gains_request(
    axis: int,
    kp_V_per_um: float,
    ki_V_per_um_s: float,
    kd_V_s_per_um: float,
    derivative_filter_Hz: float | None = None,
    filters: Sequence[LoopFilter] = (),
) -> wire.SetGainsRequest:
    """Gains and filters for an axis that may be running, as ``axis_request`` has them."""
    asked = axis_request(axis, wire.Mode.IDLE, kp_V_per_um, ki_V_per_um_s, kd_V_s_per_um, derivative_filter_Hz, filters)
    return wire.SetGainsRequest(
        axis, asked.kp_q24, asked.ki_ts_q32, asked.kd_over_ts_q24, asked.d_alpha_q31, asked.filters
    )


def _per_tick(scaled: float, bits: int, what: str, value: float, back: float, unit: str) -> int:
    """As to_i32, but a refusal speaks of the user's quantity: ``back`` converts to it."""
    try:
        return to_i32(scaled, bits, what, unit)
    except BadInput:
        limit, step = I32_MAX / 2**bits * back, back / 2**bits
        if not math.isfinite(value):
            raise
        how = f"at most {limit:.12g}" if abs(value) > limit else f"the smallest step is {step:.3g}"
        raise BadInput(f"{what} = {value:g} {unit} does not fit its format: {how} {unit}") from None


def path_request(
    axis: int, kind: wire.PathKind, swing: float, offset: float, f_Hz: float, ticks: int, volts: bool
) -> wire.SetPathRequest:
    """A path as it travels; ``swing`` and ``offset`` in V when ``volts``, else in um.

    A sine or wave has its frequency, a move its duration in ``ticks``; ``ticks`` 0 is for ever.

    Raises:
        BadInput: a value its format cannot hold, a frequency beyond half the tick rate, a move of no time.
    """
    bits, unit = (24, "V") if volts else (16, "um")
    step = 0
    if kind in (wire.PathKind.SINE, wire.PathKind.WAVE):
        if not 0 < f_Hz < TICK_HZ / 2:
            raise BadInput(f"frequency {f_Hz:g} Hz: must lie above 0 and below {TICK_HZ / 2:g} Hz")
        step = round(float(f_Hz) / TICK_HZ * 2.0**64)
    elif kind == wire.PathKind.MOVE:
        if ticks < 1:
            raise BadInput(f"a move of {ticks} ticks: it needs a duration of at least one")
        step = min(-(-(2**64) // ticks), 2**64 - 1)
    if not 0 <= ticks < 2**64:
        raise BadInput(f"a path of {ticks} ticks: between 0 (for ever) and 2^64 - 1")
    swing = _of_format(swing, bits) if kind == wire.PathKind.MOVE else swing
    ways = to_i32(swing, bits, "swing", unit), to_i32(_of_format(offset, bits), bits, "offset", unit)
    return wire.SetPathRequest(axis, kind, *ways, step, ticks)


def _of_format(value: float, bits: int) -> float:
    """A place, or the way between two, which is none where it is less than the device can tell."""
    return 0.0 if abs(value) * 2.0**bits < 0.5 else value


def wave_points(points: NDArray[np.float64]) -> bytes:
    """One period, 1024 values from 0 to 1, as it travels (i32 q30).

    Raises:
        BadInput: another number of points, or a value outside 0 .. 1.
    """
    values = np.asarray(points, np.float64)
    if values.shape != (WAVE_POINTS,):
        raise BadInput(f"a waveform has {WAVE_POINTS} points, this one {values.size}; resample it")
    if not ((values >= 0) & (values <= 1)).all():
        raise BadInput("a waveform's points lie between 0 and 1 (of the swing); scale them")
    return np.rint(values * 2**30).astype("<i4").tobytes()


@dataclass(frozen=True)
class Converters:
    """What the converter codes of one axis mean: the device's own calibration, exact in float64."""

    dac_zero_code: int = 32768
    dac_codes_per_V: float = 65536 / 20.48
    adc_zero_code: float = 599186 / 256
    """In 256ths."""
    adc_um_per_code: float = 280 / 65536

    def u_V(self, codes: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Output voltages of DAC codes, shape (n,)."""
        return (codes.astype(np.float64) - self.dac_zero_code) / self.dac_codes_per_V

    def x_um(self, codes: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Positions of ADC codes, shape (n,)."""
        return (codes.astype(np.float64) - self.adc_zero_code) * self.adc_um_per_code


def adc_zero_code(axis: wire.AxisModel) -> float:
    """Of 0 um, with the 256ths that stand in the flags."""
    return axis.adc_zero_code + (axis.flags >> ADC_ZERO_BIT) / 256


def converters(model: bytes | None) -> dict[str, Converters]:
    """Calibration of each axis by the model blob, or the device's defaults without one."""
    if model is None:
        return {axis: Converters() for axis in AXES}
    axes = wire.Model.unpack(model).axes
    return {
        name: Converters(
            axis.dac_zero_code,
            axis.dac_codes_per_V_q16 / 2**16,
            adc_zero_code(axis),
            axis.adc_um_per_code_q32 / 2**32,
        )
        for name, axis in zip(AXES, axes, strict=True)
    }
