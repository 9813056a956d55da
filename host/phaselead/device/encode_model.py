"""The part of a stage that the device works with, as the model blob it is sent.

The device holds integers (formats in the names of ``wire.AxisModel``), so a coefficient may not fit, and
what fits is rounded. ``device_model`` refuses the first and ``quantisation`` shows the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from phaselead.device import wire
from phaselead.device.encode_compensation import (
    NO_COMPENSATION,
    UNUSED,
    CompensationFields,
    encode_compensation,
    encode_coupling,
    held_values,
    refuse_singular,
)
from phaselead.device.quantities import ADC_ZERO_BIT, adc_zero_code
from phaselead.errors import BadInput
from phaselead.model import (
    Actuator,
    AxisModel,
    Compensation,
    Limits,
    Sensor,
    Stage,
    TableView,
    TimeView,
    compensation,
    coupling,
    explained,
)
from phaselead.record import AXES

MAGIC = 0x314C4850
FLAG_TABLE = 1
FLAG_INVERSE = 2
TICK_HZ = 5000
CODES = 65536
"""The device's converters are 16 bit wide."""

GAIN_um_per_V = (0.126, 4096.0)
"""K the device's tables can hold: its inverse is 28 fractional bits wide in 32 (firmware/core/expand.c)."""
LARGEST_RANGE_um = 32768.0
LARGEST_OFFSET_um = 65536.0
"""Of c_um, each (firmware/app/model_check.c)."""


@dataclass(frozen=True)
class DeviceModel:
    """What a model blob says, back in units: limits, converters, table and operator of each axis."""

    stage_sha256: str
    axes: dict[str, AxisModel]


@dataclass(frozen=True)
class Quantised:
    """One coefficient as it is to be uploaded, in the unit of the stage file, and as the device holds it."""

    key: str
    value: float
    held: float


def device_model(stage: Stage) -> bytes:
    """The model blob of a stage. An axis the stage does not have gets the defaults and no table; one whose time view
    has no inverse goes without it (``inverse_refusal`` says why).

    Raises BadInput for a coefficient the device cannot hold: which, and by how much.
    """
    rows = coupling(stage)
    refuse_singular(rows)
    axes = tuple(_encode_axis(stage.axes.get(axis, AxisModel()), axis, rows[i]) for i, axis in enumerate(AXES))
    return wire.Model(magic=MAGIC, stage_hash=bytes.fromhex(stage.sha256), axes=axes).pack()


def inverse_refusal(axis: AxisModel, name: str = "x") -> str | None:
    """Why the device cannot run modes inverse and inverse+pid on an axis, or None when it can."""
    try:
        _encode_inverse(axis, name)
    except BadInput as reason:
        return str(reason)
    return None


def _encode_inverse(axis: AxisModel, name: str) -> CompensationFields:
    return encode_compensation(compensation(axis), f"axes.{name}", _fixed)


def from_device_model(blob: bytes) -> DeviceModel:
    """The content of a model blob, coefficients as the device holds them. Raises BadInput if it is none."""
    try:
        model = wire.Model.unpack(blob)
    except wire.WireError as error:
        raise BadInput(f"model: {error}") from None
    if model.magic != MAGIC:
        raise BadInput("model: does not begin with its magic number; it is no model of phaselead")
    with explained("model"):
        axes = {name: _decode_axis(axis) for name, axis in zip(AXES, model.axes, strict=True)}
    return DeviceModel(model.stage_hash.hex(), axes)


def quantisation(stage: Stage) -> list[Quantised]:
    """Every coefficient the device is sent, beside what it becomes there."""
    blob = device_model(stage)
    held = from_device_model(blob).axes
    pairs = _compensation_pairs(stage, blob)
    for name in sorted(stage.axes):
        for part in ("limits", "actuator", "sensor", "table"):
            before, after = getattr(stage.axes[name], part), getattr(held[name], part)
            if before is None:
                continue
            for field in _sent_fields(part):
                pairs += _pairs(f"axes.{name}.{part}.{field}", getattr(before, field), getattr(after, field))
    return pairs


def _compensation_pairs(stage: Stage, blob: bytes) -> list[Quantised]:
    sent = dict(zip(AXES, wire.Model.unpack(blob).axes, strict=True))
    pairs: list[Quantised] = []
    for name in sorted(stage.axes):
        if not sent[name].flags & FLAG_INVERSE:
            continue
        held = held_values(sent[name])
        for field, values in _wanted_values(compensation(stage.axes[name])).items():
            pairs += [
                Quantised(f"axes.{name}.inverse.{field}[{i}]", value, held[field][i]) for i, value in enumerate(values)
            ]
    return pairs


def _wanted_values(found: Compensation) -> dict[str, list[float]]:
    view = found.view
    return {
        "preview_s": [found.preview_s],
        "gain_um_per_V": [view.gain_um_per_V],
        "offset_um": [view.offset_um],
        "rest_fraction": [view.rest_fraction],
        "play_r_V": list(view.play_r_V),
        "play_w_um_per_V": list(view.play_w_um_per_V),
        "deadzone_d_V": list(view.deadzone_d_V),
        "deadzone_s_um_per_V": list(view.deadzone_s_um_per_V),
        "creep_k": list(found.creep_k),
        "creep_alpha": [-math.expm1(-1 / (TICK_HZ * tau_s)) for tau_s in found.creep_tau_s],
    }


def _sent_fields(part: str) -> tuple[str, ...]:
    return {
        "limits": ("u_min_V", "u_max_V", "u_park_V", "slew_V_per_s", "ramp_V_per_s", "error_um", "oscillation_um"),
        "actuator": ("u_min_V", "u_max_V"),
        "sensor": ("x_min_um", "x_max_um"),
        "table": ("swing_V", "f_Hz", "a_um_per_V", "b_deg", "c_um"),
    }[part]


def _pairs(key: str, value: float | tuple[float, ...], held: float | tuple[float, ...]) -> list[Quantised]:
    if isinstance(value, tuple) and isinstance(held, tuple):
        return [Quantised(f"{key}[{i}]", *pair) for i, pair in enumerate(zip(value, held, strict=True))]
    assert isinstance(value, float)
    assert isinstance(held, float)
    return [Quantised(key, value, held)]


def _encode_axis(axis: AxisModel, name: str, coupling_row: list[float]) -> wire.AxisModel:
    key, limits, table = f"axes.{name}", axis.limits, axis.table
    inverse = None if inverse_refusal(axis, name) else _encode_inverse(axis, name)
    dac_zero, codes_per_V = _encode_actuator(axis.actuator, limits, f"{key}.actuator")
    (adc_zero, rest), um_per_code = _encode_sensor(axis.sensor, f"{key}.sensor")
    if table is not None:
        _refuse_beyond_tables(table, f"{key}.table")
    swing = table.swing_V if table else (0.0, 0.0)
    f = table.f_Hz if table else (0.0, 0.0)
    at = f"{key}.limits"
    return wire.AxisModel(
        flags=(FLAG_TABLE if table else 0) | (FLAG_INVERSE if inverse else 0) | rest << ADC_ZERO_BIT,
        u_min_q24=_fixed(limits.u_min_V, 24, f"{at}.u_min_V"),
        u_max_q24=_fixed(limits.u_max_V, 24, f"{at}.u_max_V"),
        u_park_q24=_fixed(limits.u_park_V, 24, f"{at}.u_park_V"),
        slew_q24=_fixed(limits.slew_V_per_s, 24, f"{at}.slew_V_per_s", Fraction(1, TICK_HZ), vanish=False),
        ramp_q24=_fixed(limits.ramp_V_per_s, 24, f"{at}.ramp_V_per_s", Fraction(1, TICK_HZ), vanish=False),
        dac_zero_code=dac_zero,
        dac_codes_per_V_q16=codes_per_V,
        adc_zero_code=adc_zero,
        adc_um_per_code_q32=um_per_code,
        swing_min_q24=_fixed(swing[0], 24, f"{key}.table.swing_V[0]", vanish=table is None),
        swing_max_q24=_fixed(swing[1], 24, f"{key}.table.swing_V[1]", vanish=table is None),
        f_min_q16=_fixed(f[0], 16, f"{key}.table.f_Hz[0]", vanish=table is None),
        f_max_q16=_fixed(f[1], 16, f"{key}.table.f_Hz[1]", vanish=table is None),
        a_q32=_fixed_each(table.a_um_per_V if table else (0.0,) * 3, 32, f"{key}.table.a_um_per_V"),
        b_q40=_fixed_each(table.b_deg if table else (0.0,) * 6, 40, f"{key}.table.b_deg", Fraction(1, 360)),
        c_q32=_fixed_each(table.c_um if table else (0.0,) * 6, 32, f"{key}.table.c_um"),
        coupling_q28=encode_coupling(coupling_row, name),
        error_limit_q16=_fixed(limits.error_um, 16, f"{at}.error_um"),
        error_ticks=max(1, round(limits.error_s * TICK_HZ)) if limits.error_um > 0 else 0,
        oscillation_limit_q16=_fixed(limits.oscillation_um, 16, f"{at}.oscillation_um"),
        **(inverse or NO_COMPENSATION),
    )


def _fixed_each(values: tuple[float, ...], bits: int, key: str, factor: Fraction = Fraction(1)) -> tuple[int, ...]:
    return tuple(_fixed(value, bits, f"{key}[{i}]", factor, width=64) for i, value in enumerate(values))


def _fixed(
    value: float,
    bits: int,
    key: str,
    factor: Fraction = Fraction(1),
    *,
    width: int = 32,
    vanish: bool = True,
) -> int:
    """``value`` x ``factor`` x 2^bits, rounded to nearest. ``vanish``: whether it may round to nothing."""
    integer = round(Fraction(value) * factor * 2**bits)
    if not -(2 ** (width - 1)) <= integer < 2 ** (width - 1):
        largest = float(Fraction(2 ** (width - 1) - 1, 2**bits) / factor)
        raise BadInput(
            f"{key} = {value:g} does not fit the device: it holds at most {largest:.6g}, "
            f"this is {abs(value) / largest:.3g} times that"
        )
    if integer == 0 and not vanish:
        smallest = float(Fraction(1, 2**bits) / factor)
        raise BadInput(f"{key} = {value:g} does not fit the device: the smallest step it holds is {smallest:.3g}")
    return int(integer)


def _encode_actuator(actuator: Actuator, limits: Limits, key: str) -> tuple[int, int]:
    """Code of 0 V and codes per volt, once the limits are within the converter's reach."""
    _refuse_other_width(actuator.bits, key)
    if not limits.u_min_V <= 0 <= limits.u_max_V:  # firmware/app/model_check.c
        raise BadInput(
            f"{key.removesuffix('.actuator')}.limits: u_min_V..u_max_V = {limits.u_min_V:g}..{limits.u_max_V:g} "
            "leaves out 0 V, where the device powers on; include it"
        )
    for name in ("u_min_V", "u_max_V"):
        limit = getattr(limits, name)
        last_V = actuator.u_max_V - (actuator.u_max_V - actuator.u_min_V) / CODES
        if not actuator.u_min_V <= limit <= last_V:
            beyond = max(actuator.u_min_V - limit, limit - last_V)
            raise BadInput(
                f"{key.removesuffix('.actuator')}.limits.{name} = {limit:g} is {beyond:.3g} V beyond the "
                f"converter ({actuator.u_min_V:g}..{last_V:.6g} V); narrow the limits"
            )
    codes_per_V = CODES / Fraction(actuator.u_max_V - actuator.u_min_V)
    zero = round(-Fraction(actuator.u_min_V) * codes_per_V)
    return zero, _fixed(float(codes_per_V), 16, f"{key}: codes per volt", vanish=False)


def _encode_sensor(sensor: Sensor, key: str) -> tuple[tuple[int, int], int]:
    """Code of 0 um and 256ths above it, and um per code, once every code is a position the device can hold."""
    _refuse_other_width(sensor.bits, key)
    for name in ("x_min_um", "x_max_um"):
        _fixed(getattr(sensor, name), 16, f"{key}.{name}")
    span_um = Fraction(sensor.x_max_um) - Fraction(sensor.x_min_um)
    zero, rest = divmod(round(-Fraction(sensor.x_min_um) / span_um * CODES * 256), 256)
    if not -CODES < zero < 2 * CODES - 1:
        raise BadInput(f"{key}: its span {sensor.x_min_um:g}..{sensor.x_max_um:g} um is too far from 0 um; shift it")
    return (zero, rest), _fixed(float(span_um / CODES), 32, f"{key}: micrometres per code", vanish=False)


def _refuse_other_width(bits: int, key: str) -> None:
    if bits != 16:
        raise BadInput(f"{key}.bits = {bits}: the device's converters have 16 bits; scale the span to 16")


def _refuse_beyond_tables(table: TableView, key: str) -> None:
    """Gain, range, phase and frequency that the device's tables cannot hold anywhere in the rectangle."""
    _, a1, a2 = table.a_um_per_V
    low, high = table.swing_V
    swings = [low, high] + ([-a1 / (2 * a2)] if a2 and low < -a1 / (2 * a2) < high else [])
    for gain in (float(table.gain(swing)) for swing in swings):
        if not GAIN_um_per_V[0] <= gain <= GAIN_um_per_V[1]:
            amplified = (
                "are its voltages those behind the amplifier? A stage file has the control volts in front of it: "
                "divide the recorded ones by the amplifier's gain and fit again, or "
            )
            raise BadInput(
                f"{key}.a_um_per_V: the gain reaches {gain:.4g} um/V, the device holds "
                f"{GAIN_um_per_V[0]:g}..{GAIN_um_per_V[1]:g} um/V; {amplified if gain < GAIN_um_per_V[0] else ''}"
                "narrow swing_V or check the unit"
            )
    if table.range_um[1] >= LARGEST_RANGE_um:
        raise BadInput(
            f"{key}.a_um_per_V: the range reaches {table.range_um[1]:.4g} um, the device holds less than "
            f"{LARGEST_RANGE_um:g} um; narrow swing_V"
        )
    for i, value in enumerate(table.c_um):
        if abs(value) > LARGEST_OFFSET_um:
            raise BadInput(
                f"{key}.c_um[{i}] = {value:g} does not fit the device: it holds at most "
                f"{LARGEST_OFFSET_um:g}, this is {abs(value) / LARGEST_OFFSET_um:.3g} times that"
            )
    swings_V, f_Hz = np.meshgrid(np.linspace(*table.swing_V, 17), np.linspace(*table.f_Hz, 17))
    phases = table.phase_deg(swings_V, f_Hz, extrapolate=True)
    worst = np.unravel_index(np.argmax(np.abs(phases)), phases.shape)
    if abs(phases[worst]) >= 180:
        raise BadInput(
            f"{key}.b_deg: the phase reaches {phases[worst]:.4g} degrees at {swings_V[worst]:g} V, "
            f"{f_Hz[worst]:g} Hz, the device holds less than half a turn; narrow f_Hz"
        )
    if table.f_Hz[1] > TICK_HZ / 2:
        raise BadInput(
            f"{key}.f_Hz[1] = {table.f_Hz[1]:g} Hz is above half the tick rate ({TICK_HZ / 2:g} Hz); narrow f_Hz"
        )


def _decode_axis(axis: wire.AxisModel) -> AxisModel:
    u_lsb, x_lsb = 2**16 / axis.dac_codes_per_V_q16, axis.adc_um_per_code_q32 / 2**32
    adc_zero = adc_zero_code(axis)
    table = None
    if axis.flags & FLAG_TABLE:
        table = TableView(
            swing_V=(axis.swing_min_q24 / 2**24, axis.swing_max_q24 / 2**24),
            f_Hz=(axis.f_min_q16 / 2**16, axis.f_max_q16 / 2**16),
            a_um_per_V=tuple(value / 2**32 for value in axis.a_q32),
            b_deg=tuple(value * 360 / 2**40 for value in axis.b_q40),
            c_um=tuple(value / 2**32 for value in axis.c_q32),
        )
    limits_V = (axis.u_min_q24 / 2**24, axis.u_max_q24 / 2**24)
    return AxisModel(
        limits=Limits(
            u_min_V=limits_V[0],
            u_max_V=limits_V[1],
            u_park_V=axis.u_park_q24 / 2**24,
            slew_V_per_s=axis.slew_q24 * TICK_HZ / 2**24,
            ramp_V_per_s=axis.ramp_q24 * TICK_HZ / 2**24,
            error_um=axis.error_limit_q16 / 2**16,
            error_s=axis.error_ticks / TICK_HZ if axis.error_ticks else Limits().error_s,
            oscillation_um=axis.oscillation_limit_q16 / 2**16,
        ),
        actuator=Actuator(u_min_V=-axis.dac_zero_code * u_lsb, u_max_V=(CODES - axis.dac_zero_code) * u_lsb, bits=16),
        sensor=Sensor(x_min_um=-adc_zero * x_lsb, x_max_um=(CODES - adc_zero) * x_lsb, bits=16),
        table=table,
        time=_decode_operator(axis, limits_V) if axis.flags & FLAG_INVERSE else None,
    )


def _decode_operator(axis: wire.AxisModel, u_range_V: tuple[float, float]) -> TimeView:
    """The operator that mode inverse undoes. Modes, lags and creep are in the sections only, and in the preview, which
    stands for the delay here."""
    held = held_values(axis)
    unused = UNUSED / 2**24
    plays = [(r, w) for r, w in zip(held["play_r_V"], held["play_w_um_per_V"], strict=True) if r < unused and w]
    knots = [(d, s) for d, s in zip(held["deadzone_d_V"], held["deadzone_s_um_per_V"], strict=True) if d < unused]
    return TimeView(
        gain_um_per_V=held["gain_um_per_V"][0],
        play_r_V=tuple(r for r, _ in plays),
        play_w_um_per_V=tuple(w for _, w in plays),
        deadzone_d_V=tuple(d for d, _ in knots),
        deadzone_s_um_per_V=tuple(s for _, s in knots),
        offset_um=held["offset_um"][0],
        delay_s=held["preview_s"][0],
        rest_fraction=held["rest_fraction"][0],
        u_range_V=u_range_V,
        rate_Hz=TICK_HZ,
    )


def refused_key(invalid_field: int) -> str:
    """The stage file's key behind ``invalid_field`` of a refused MODEL_COMMIT (100 x axis + field number)."""
    axis, field = divmod(invalid_field, 100)
    keys = (
        "model", "table", "limits.u_min_V", "limits.u_max_V", "limits.u_park_V", "limits.slew_V_per_s",
        "limits.ramp_V_per_s", "actuator", "actuator", "sensor", "sensor", "table.swing_V[0]",
        "table.swing_V[1]", "table.f_Hz[0]", "table.f_Hz[1]", "table.a_um_per_V", "table.b_deg", "table.c_um",
        "time.delay_s", "effects", "effects", "effects", "effects", "time.gain_um_per_V", "time.offset_um",
        "time.rest_fraction", "time.play_r_V", "time.play_w_um_per_V", "time.deadzone_d_V", "time.deadzone_s_um_per_V",
        "effects", "limits.error_um", "limits.error_s", "limits.oscillation_um",
    )  # fmt: skip
    if axis >= len(AXES) or not 1 <= field < len(keys):
        return "model"
    return f"axes.{AXES[axis]}.{keys[field]}"
