"""What was measured as a model: the measured modes for a time view that shows none, or about a linear stage."""

from __future__ import annotations

import numpy as np

from phaselead.control.tuning.shaping import RINGS
from phaselead.model import TICK_S, AdoptedEffect, AxisModel, SmallSignal, TimeView, small_signal


def with_modes(model: AxisModel, plant: SmallSignal) -> AxisModel:
    """A model whose time view shows no mode gets the measured ones: on it the loop would be another. What they delay is
    taken from its dead time."""
    found = [mode for mode in plant.modes if mode[2] < RINGS]
    if model.time is None or small_signal(model).modes or not found:
        return model
    whole = sum(c for c, _, _ in found)
    shares, f_Hz, zeta = zip(*((c / whole, f, z) for c, f, z in sorted(found, key=lambda mode: mode[1])), strict=True)
    late_s = sum(c * z / (np.pi * f) for c, f, z in zip(shares, f_Hz, zeta, strict=True))
    time = model.time.model_copy(update={"delay_s": max(model.time.delay_s - float(late_s), 0.0)})
    mode = AdoptedEffect(name="resonance", params={"c": shares, "f_Hz": f_Hz, "zeta": zeta})
    return model.model_copy(update={"time": time, "effects": (*model.effects, mode)})


def measured_model(parent: AxisModel, plant: SmallSignal, gain_um_per_V: float, at: tuple[float, float]) -> AxisModel:
    """Limits and converters of the parent about a linear stage with the measured modes and dead time. It is where the
    measurement was, ``at`` (V, um), unless its sensor would then not see it at 0 V."""
    middle_V, middle_um = at
    time = TimeView(
        gain_um_per_V=gain_um_per_V,
        offset_um=max(middle_um - gain_um_per_V * middle_V, parent.sensor.x_min_um / 2),
        delay_s=max(plant.delay_s + sum(plant.lags_s), 0.0),
        u_range_V=(parent.limits.u_min_V, parent.limits.u_max_V),
        rate_Hz=1 / TICK_S,
    )
    bare = AxisModel(limits=parent.limits, sensor=parent.sensor, actuator=parent.actuator, time=time)
    return with_modes(bare, plant)
