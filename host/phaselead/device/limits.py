"""The hard limits that a device keeps in its own flash: in units here, in converter codes on the device."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from phaselead.device import wire
from phaselead.device.device import Device, axis_index
from phaselead.device.quantities import TICK_HZ, Converters
from phaselead.device.session import FLASH_WAITS_S
from phaselead.device.stream import AXES
from phaselead.errors import BadInput
from phaselead.model import AxisModel, Stage
from phaselead.result import Result, Table

CODE_MAX, NO_SLEW = 65535, 2**32 - 1
UNLIMITED = wire.AxisLimits(0, CODE_MAX, NO_SLEW, 0, CODE_MAX)
HEADINGS = ("axis", "u min (V)", "u max (V)", "slew (V/s)", "x min (um)", "x max (um)")
ROUNDED = 1e-4
"""Of a limit, at most, by which its code lies inwards: a code of the default converter is 0.31 mV."""
ROUNDING = 1e-6
"""Of a code: what a value that is exactly a code may be off by in floating point."""


@dataclass(frozen=True)
class AxisLimits:
    """Hard limits of one axis; None: none but the converters' own range."""

    u_min_V: float | None = None
    u_max_V: float | None = None
    slew_V_per_s: float | None = None
    x_min_um: float | None = None
    x_max_um: float | None = None

    def __bool__(self) -> bool:
        return any(value is not None for value in asdict(self).values())


@dataclass(frozen=True)
class Limits(Result):
    """Hard limits of every axis, keyed "x", "y", "z"; prints as a table.

    ``lost``: limits were set, but the device cannot read them any more, and refuses to arm until they are set again.
    """

    axes: dict[str, AxisLimits]
    lost: bool = False

    def __getitem__(self, axis: str) -> AxisLimits:
        return self.axes[axis]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: the axes, and ``limits_lost``."""
        return {axis: asdict(limits) for axis, limits in self.axes.items()} | {"limits_lost": self.lost}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row an axis."""
        names = [field.name for field in fields(AxisLimits)]
        return {"axis": list(self.axes)} | {
            name: [getattr(limits, name) for limits in self.axes.values()] for name in names
        }

    def tables(self) -> list[Table | str]:
        rows = tuple((axis, *(_cell(value) for value in asdict(limits).values())) for axis, limits in self.axes.items())
        lost = ["The limits that were set cannot be read any more: set them again, until then nothing is armed."]
        return [Table(HEADINGS, rows), *(lost if self.lost else [])]


def _cell(value: float | None) -> str:
    return "none" if value is None else f"{value:.5g}"


def in_units(codes: wire.AxisLimits, converter: Converters) -> AxisLimits:
    """Limits in codes as the volts and micrometres that they are by this calibration."""

    def u_V(code: int) -> float:
        return (code - converter.dac_zero_code) / converter.dac_codes_per_V

    def x_um(code: int) -> float:
        return (code - converter.adc_zero_code) * converter.adc_um_per_code

    return AxisLimits(
        u_V(codes.dac_min) if codes.dac_min > 0 else None,
        u_V(codes.dac_max) if codes.dac_max < CODE_MAX else None,
        codes.slew_codes_q16 / 2**16 * TICK_HZ / converter.dac_codes_per_V if codes.slew_codes_q16 < NO_SLEW else None,
        x_um(codes.adc_min) if codes.adc_min > 0 else None,
        x_um(codes.adc_max) if codes.adc_max < CODE_MAX else None,
    )


def in_codes(limits: AxisLimits, converter: Converters) -> wire.AxisLimits:
    """Limits in units as the codes that just keep them.

    Raises BadInput for a limit that is no number or beyond the converters' range, a lower limit above its upper one, a
    slew limit that is not above 0, and limits that leave out 0 V.
    """
    for name, value in asdict(limits).items():
        if value is not None and not math.isfinite(value):
            raise BadInput(f"{name} = {value} is no number; give a finite value")
    found = UNLIMITED
    if limits.u_min_V is not None:
        at = limits.u_min_V * converter.dac_codes_per_V + converter.dac_zero_code
        found = replace(found, dac_min=_code(math.ceil(at - ROUNDING), "u_min", limits.u_min_V, "V"))
    if limits.u_max_V is not None:
        at = limits.u_max_V * converter.dac_codes_per_V + converter.dac_zero_code
        found = replace(found, dac_max=_code(math.floor(at + ROUNDING), "u_max", limits.u_max_V, "V"))
    if limits.slew_V_per_s is not None:
        step = math.floor(limits.slew_V_per_s / TICK_HZ * converter.dac_codes_per_V * 2**16)
        if not 0 < step < NO_SLEW:
            raise BadInput(f"slew = {limits.slew_V_per_s:g} V/s: must be above 0; leave it out for no limit")
        found = replace(found, slew_codes_q16=step)
    if limits.x_min_um is not None:
        at = limits.x_min_um / converter.adc_um_per_code + converter.adc_zero_code
        found = replace(found, adc_min=_code(math.ceil(at - ROUNDING), "x_min", limits.x_min_um, "um"))
    if limits.x_max_um is not None:
        at = limits.x_max_um / converter.adc_um_per_code + converter.adc_zero_code
        found = replace(found, adc_max=_code(math.floor(at + ROUNDING), "x_max", limits.x_max_um, "um"))
    if not found.dac_min <= converter.dac_zero_code <= found.dac_max:
        raise BadInput("the limits leave out 0 V, where the output is at power-on; u_min must be <= 0 V <= u_max")
    if not found.adc_min < found.adc_max:
        raise BadInput("x_min is not below x_max; exchange them")
    return found


def _code(code: int, name: str, value: float, unit: str) -> int:
    if not 0 <= code <= CODE_MAX:
        raise BadInput(f"{name} = {value:g} {unit} is beyond the converter's range; leave it out for no limit")
    return code


def read_limits(device: Device) -> Limits:
    """The hard limits in force, by the calibration of the device's model."""
    reply, calibration = device.session.request(wire.LimitsReadRequest()), device.converters()
    axes = {axis: in_units(codes, calibration[axis]) for axis, codes in zip(AXES, reply.limits, strict=True)}
    return Limits(axes, bool(reply.limits_lost))


def set_limits(device: Device, axes: str, limits: AxisLimits, *, keep_others: bool = True) -> Limits:
    """Sets hard limits of these axes ("x", "xy") and keeps them in the device's flash, all or none; while parked. Gives
    those of all axes.

    What is None in ``limits`` stays as it is, or with ``keep_others=False`` becomes unlimited. Raises BadInput for
    limits that make no sense, DeviceRefused when the device is armed, or when its output or the safe value of its model
    is outside of them.
    """
    calibration = device.converters()
    every = list(device.session.request(wire.LimitsReadRequest()).limits)
    for axis in axes:
        index = axis_index(axis)
        wanted = in_codes(limits, calibration[axis])
        if keep_others:
            wanted = _of_both(every[index], wanted, limits)
            if wanted.dac_min > wanted.dac_max or wanted.adc_min >= wanted.adc_max:
                raise BadInput(f"axis {axis}: a lower limit is not below the upper one in force; give both")
        every[index] = wanted
    device.session.request(wire.LimitsSetRequest(tuple(every)), FLASH_WAITS_S)
    return read_limits(device)


def _of_both(now: wire.AxisLimits, wanted: wire.AxisLimits, given: AxisLimits) -> wire.AxisLimits:
    """The fields that are given as wanted, the others as they are."""
    names = [field.name for field in fields(wire.AxisLimits)]
    chosen = zip(names, asdict(given).values(), strict=True)
    return wire.AxisLimits(**{name: getattr(now if value is None else wanted, name) for name, value in chosen})


def held_back(device: Device, stage: Stage) -> list[str]:
    """Where a model asks for more than the device's hard limits allow, a line for each axis: what holds instead."""
    if not device.held_back:
        return []
    hard = read_limits(device)
    said = {axis: looser_than(model, hard[axis]) for axis, model in stage.axes.items()}
    return [
        f"axis {axis}: {', '.join(phrases)} by the device's hard limits (`phaselead limits` shows them)"
        for axis, phrases in said.items()
        if phrases
    ]


def looser_than(model: AxisModel, hard: AxisLimits) -> list[str]:
    """A phrase for each limit of a model that is looser than the hard one."""
    said = []
    for name, unit in (("u_min_V", "V"), ("u_max_V", "V"), ("slew_V_per_s", "V/s")):
        wants, most = getattr(model.limits, name), getattr(hard, name)
        if most is not None and (most - wants if name == "u_min_V" else wants - most) > ROUNDED * max(abs(wants), 1.0):
            said.append(f"{name} {wants:g} is held to {most:.5g} {unit}")
    return said
