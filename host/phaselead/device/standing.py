"""Where the axes of a device stand: their outputs, and one reading of each sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields

import numpy as np

from phaselead.device.device import Device
from phaselead.device.parking import after_interrupt
from phaselead.device.status import DeviceStatus
from phaselead.result import Table

LARGEST_STEP_V = 0.1
"""Between where an axis stands and where its path begins; the device would take it at the slew limit."""
COUNTERS = ("overruns", "stream_dropped", "rx_errors")


@dataclass(frozen=True)
class Standing:
    """Where an axis is now: its output, and one reading of its sensor."""

    u_V: float
    x_um: float


@dataclass(frozen=True)
class StatusInUnits(DeviceStatus):
    """The status of a device, and ``axes``: where each axis stands, by the calibration of the model it holds."""

    axes: Mapping[str, Standing] = field(default_factory=dict)

    def tables(self) -> list[Table | str]:
        headings = ("axis", "position (µm)", "output (V)", "mode", "")
        rows = [
            (axis, f"{at.x_um:.2f}", f"{at.u_V:.3f}", self.modes[i], self._doing(axis))
            for i, (axis, at) in enumerate(self.axes.items())
        ]
        counted = [f"{getattr(self, name)} {name.replace('_', ' ')}" for name in COUNTERS if getattr(self, name)]
        counted += [
            f"{count} saturations of {axis}" for axis, count in zip("xyz", self.saturations, strict=True) if count
        ]
        said = [f"since power-on: {', '.join(counted)}"] if counted else []
        return [self.sentence(), Table(headings, tuple(rows)), *said]

    def sentence(self) -> str:
        """State, fault and model in words."""
        model = "no model" if int(self.model_crc, 16) == 0 else f"model {self.model_crc}"
        if self.fault == "none":
            return f"{self.state}, no fault, {model}"
        where = f" on axis {self.fault_axis}" if self.fault_axis else ""
        return (
            f"{self.state}: {self.fault}{where} at tick {self.fault_tick}, {model}; `phaselead explain {self.fault}` "
            "says why, `phaselead park` clears it"
        )

    def _doing(self, axis: str) -> str:
        return "running" if axis in self.running_axes else "at rest" if axis in self.at_rest else ""


def status_in_units(device: Device) -> StatusInUnits:
    """The status of the device with positions in um and outputs in V."""
    status, calibration = device.status(), device.converters()

    def standing(index: int, axis: str) -> Standing:
        codes = np.array([status.dac_codes[index], status.adc_codes[index]], np.uint16)
        return Standing(float(calibration[axis].u_V(codes)[0]), float(calibration[axis].x_um(codes)[1]))

    axes = {axis: standing(index, axis) for index, axis in enumerate("xyz")}
    return StatusInUnits(**{one.name: getattr(status, one.name) for one in fields(DeviceStatus)}, axes=axes)


@contextmanager
def says_when_interrupted(device: Device, kept: str) -> Iterator[None]:
    """What Ctrl-C in here says: what has become of the output, and of what was measured."""
    try:
        yield
    except KeyboardInterrupt as ended:
        ended.args = (*(str(part) for part in ended.args or (after_interrupt(device.session),)), kept)
        raise


def standings(device: Device) -> Mapping[str, Standing]:
    """Where every axis is now."""
    return status_in_units(device).axes
