"""Where the axes of a device stand: their outputs, and one reading of each sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.device.device import Device

LARGEST_STEP = {"um": 2.0, "V": 0.1}
"""Between where an axis stands and where its path begins; the device would take it at the slew limit."""


@dataclass(frozen=True)
class Standing:
    """Where an axis is now: its output, and one reading of its sensor."""

    u_V: float
    x_um: float


def standings(device: Device) -> dict[str, Standing]:
    """Where every axis is now."""
    status, calibration = device.status(), device.converters()

    def standing(index: int, axis: str) -> Standing:
        codes = np.array([status.dac_codes[index], status.adc_codes[index]], np.uint16)
        return Standing(float(calibration[axis].u_V(codes)[0]), float(calibration[axis].x_um(codes)[1]))

    return {axis: standing(index, axis) for index, axis in enumerate("xyz")}
