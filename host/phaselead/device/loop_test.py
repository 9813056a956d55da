"""Self-test of a board: its DAC looped to its ADC with a wire, before any amplifier is connected."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from phaselead.device import wire
from phaselead.device.device import Device
from phaselead.device.stream import AXES
from phaselead.errors import PhaseleadError
from phaselead.record import parse_axes
from phaselead.result import Result, Table

LEVELS_V = (0.0, 2.0, 4.0, 6.0, 8.0, 9.5, 0.0)
SETTLE_TICKS = 500
DAC_V_PER_CODE = 20.48 / 65536
ADC_V_PER_CODE = 20.0 / 65536
"""AD7606B, +-10 V over all codes; the DAC's scale is the one a device without a model has."""
MOST_GAIN_ERROR = 0.01
MOST_OFFSET_V = 0.02
MOST_MISFIT_V = 0.005
MOST_NOISE_CODES = 4.0
FOLLOWS_FROM = 0.1
"""Gain from which an input follows its output at all: an open one picks up a few per cent of its neighbours."""


@dataclass(frozen=True)
class LoopResult:
    """One axis: how its ADC saw its DAC."""

    axis: str
    gain: float
    offset_V: float
    misfit_V: float
    noise_codes: float

    @property
    def passed(self) -> bool:
        return (
            abs(self.gain - 1) <= MOST_GAIN_ERROR
            and abs(self.offset_V) <= MOST_OFFSET_V
            and self.misfit_V <= MOST_MISFIT_V
            and self.noise_codes <= MOST_NOISE_CODES
        )

    def advice(self) -> str | None:
        """What is likely wrong and what to do, None where nothing is."""
        if self.passed:
            return None
        if abs(self.gain) < FOLLOWS_FROM:
            return f"{self.axis}: its input does not follow its output: no wire joins them; wire DAC to ADC, try again"
        if self.misfit_V > MOST_MISFIT_V or self.noise_codes > MOST_NOISE_CODES:
            return (
                f"{self.axis}: what comes back is bent or noisy, as no wire makes it: a stage or an amplifier is "
                "connected, or a contact is loose; leave only the wire from DAC to ADC, try again"
            )
        return f"{self.axis}: the line is straight but gain or offset is off: check references, dividers and grounds"

    def as_dict(self) -> dict[str, object]:
        return {
            "passed": self.passed,
            "gain": round(self.gain, 5),
            "offset_mV": round(1e3 * self.offset_V, 3),
            "misfit_mV": round(1e3 * self.misfit_V, 3),
            "noise_codes": round(self.noise_codes, 2),
        }


class SelfTest(Result, dict[str, LoopResult]):
    """How the ADC of each axis saw its DAC, keyed "x", "y", "z"; prints as a table."""

    @property
    def passed(self) -> bool:
        """Whether every axis did."""
        return all(result.passed for result in self.values())

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead selftest --json`` writes it."""
        return {"axes": {axis: result.as_dict() for axis, result in self.items()}}

    def advice(self) -> list[str]:
        """What is likely wrong, a line for each axis that has not passed."""
        return [line for result in self.values() if (line := result.advice()) is not None]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each axis: axis, passed, gain, offset_mV, misfit_mV, noise_codes."""
        rows = [{"axis": axis} | result.as_dict() for axis, result in self.items()]
        return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}

    def tables(self) -> list[Table | str]:
        headings = tuple(name.replace("_", " ") for name in self.columns)
        rows = tuple(tuple(map(str, row)) for row in zip(*self.columns.values(), strict=True))
        return [Table(headings, rows), *self.advice()]

    def __repr__(self) -> str:
        return f"<SelfTest: {'passed' if self.passed else 'not passed'}, axes {''.join(self)}>"


def loop_result(axis: str, dac_codes: list[float], adc_codes: list[float], noise_codes: float) -> LoopResult:
    """Fits ADC volts = gain x DAC volts + offset through mean codes of several levels, 16 bits, mid-scale 0 V."""
    driven_V = (np.asarray(dac_codes) - 32768) * DAC_V_PER_CODE
    seen_V = (np.asarray(adc_codes) - 32768) * ADC_V_PER_CODE
    gain, offset_V = np.polyfit(driven_V, seen_V, 1)
    misfit_V = float(np.max(np.abs(seen_V - gain * driven_V - offset_V)))
    return LoopResult(axis, float(gain), float(offset_V), misfit_V, noise_codes)


def selftest(device: Device, axes: str = AXES) -> SelfTest:
    """Drives each axis through some voltages and reads each back. The device is parked afterwards.

    Raises:
        BadInput: axes that make no sense.
        PhaseleadError: the device has a model, whose limits are for a stage and not for a wire.
    """
    return SelfTest({axis: measure_loop(device, axis) for axis in parse_axes(axes)})


def measure_loop(device: Device, axis: str) -> LoopResult:
    """Drives one axis through some voltages, reads each back, and parks. Raises PhaseleadError as ``selftest``."""
    if device.info()["model_loaded"]:
        raise PhaseleadError("the device has a model; a self-test is for a board without one: power it on afresh")
    dac, adc, noise = [], [], [0.0]
    with contextlib.ExitStack() as home:
        home.callback(device.park)
        for level_V in LEVELS_V:
            device.set_axis(axis, wire.Mode.OPEN)
            device.set_path(axis, "hold", swing=0, offset=level_V)
            capture = device.capture(2 * SETTLE_TICKS, axes=axis)
            stream = capture.axes[axis]
            assert stream.adc is not None
            assert stream.dac is not None
            dac.append(float(np.mean(stream.dac[SETTLE_TICKS : 2 * SETTLE_TICKS])))
            adc.append(float(np.mean(stream.adc[SETTLE_TICKS : 2 * SETTLE_TICKS])))
            noise.append(float(np.std(stream.adc[SETTLE_TICKS : 2 * SETTLE_TICKS])))
    return loop_result(axis, dac, adc, max(noise))
