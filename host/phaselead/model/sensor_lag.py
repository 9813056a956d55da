"""By how much a sensor is behind the stage."""

from __future__ import annotations

import math

from phaselead.model.axis import AxisModel
from phaselead.model.effects import Place, effect


def sensor_lag_s(axis: AxisModel) -> float:
    """Time constant of the sensor's low-pass: of the adopted effects, else of ``sensor.bandwidth_Hz``; 0 where neither
    is known. A fit cannot tell it from the stage's own delay: it comes from a data sheet."""
    known = [(effect(e.name), e.params) for e in axis.effects if effect(e.name).place == Place.SENSOR]
    lags_s = [e.lag_in_loop_s(e.complete(params)) for e, params in known if e.lag_in_loop_s is not None]
    if lags_s:
        return sum(lags_s)
    return 0.0 if axis.sensor.bandwidth_Hz is None else 1 / (2 * math.pi * axis.sensor.bandwidth_Hz)
