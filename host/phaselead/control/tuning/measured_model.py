"""What was measured as a model: the measured modes for a time view that shows none, or about a linear stage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.control.tuning.plant import FAR, rings
from phaselead.model import TICK_S, AdoptedEffect, AxisModel, SmallSignal, TimeView, small_signal

Mode = tuple[float, float, float]
"""Share, frequency in Hz, damping."""


def with_modes(model: AxisModel, plant: SmallSignal) -> AxisModel:
    """A model whose time view shows no mode gets the measured ones: on it the loop would be another. What they delay is
    taken from its dead time. One that shows some gets the measured frequency and damping of each: lines across a mode
    tell them closer than a fit of large motion, and a path near it asks for that."""
    found = [mode for mode in plant.modes if rings(mode)]
    if model.time is None or not found:
        return model
    if small_signal(model).modes:
        return _with_measured(model, found)
    whole = sum(c for c, _, _ in found)
    shares, f_Hz, zeta = zip(*((c / whole, f, z) for c, f, z in sorted(found, key=lambda mode: mode[1])), strict=True)
    late_s = sum(c * z / (np.pi * f) for c, f, z in zip(shares, f_Hz, zeta, strict=True))
    time = model.time.model_copy(update={"delay_s": max(model.time.delay_s - float(late_s), 0.0)})
    mode = AdoptedEffect(name="resonance", params={"c": shares, "f_Hz": f_Hz, "zeta": zeta})
    return model.model_copy(update={"time": time, "effects": (*model.effects, mode)})


def _with_measured(model: AxisModel, found: Sequence[Mode]) -> AxisModel:
    """Modes that an effect has moved from where they are written stay."""
    shown = {f_Hz for _, f_Hz, _ in small_signal(model).modes}
    effects = tuple(_measured(one, found) if _places(one) <= shown else one for one in model.effects)
    return model if effects == model.effects else model.model_copy(update={"effects": effects})


def _places(effect: AdoptedEffect) -> set[float]:
    return set(np.atleast_1d(effect.params["f_Hz"])) if effect.name == "resonance" else set()


def _measured(effect: AdoptedEffect, found: Sequence[Mode]) -> AdoptedEffect:
    """Each mode takes the figures of the nearest measured one, where that is no other one."""
    if effect.name != "resonance":
        return effect
    f_Hz, zeta = (np.atleast_1d(effect.params[name]).astype(float) for name in ("f_Hz", "zeta"))
    measured = np.array([mode[1:] for mode in found])
    nearest = np.abs(np.log(measured[:, 0] / f_Hz[:, None])).argmin(axis=1)
    near = np.abs(np.log(measured[nearest, 0] / f_Hz)) < np.log(FAR)
    known = near & np.array([(nearest[near] == one).sum() == 1 for one in nearest])
    figures = {
        "f_Hz": tuple(map(float, np.where(known, measured[nearest, 0], f_Hz))),
        "zeta": tuple(map(float, np.where(known, measured[nearest, 1], zeta))),
    }
    several = isinstance(effect.params["f_Hz"], tuple)
    params = effect.params | {name: values if several else values[0] for name, values in figures.items()}
    ci95 = {name: interval for name, interval in effect.ci95.items() if params[name] == effect.params[name]}
    return effect.model_copy(update={"params": params, "ci95": ci95})


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
