"""Common modes as effects of a stage file: for each axis its own path, its coupling to the others and its softening."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np

from phaselead.gap.adopt import stage_file_entries
from phaselead.gap.error_rates import TWO_SIDED_95
from phaselead.gap.findings import Estimate, Estimates, NamedEffect
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.in_front import fitted_parameters
from phaselead.model import AxisModel, Effect, Params, TimeView, rest_position_um
from phaselead.record import Samples

LEAST_STATIC_GAIN = 1e-3
"""Smallest static gain of an axis' own path, as a share of that of the base."""


def own_gains(fit: CommonModes) -> Samples:
    """(axes,) static gain of each axis' own path, as a multiple of the base's."""
    gains = np.diag(fit.model.static).copy()
    gains[np.abs(gains) < LEAST_STATIC_GAIN] = LEAST_STATIC_GAIN
    return np.asarray(gains)


def resonance_params(fit: CommonModes, axis: int) -> dict[str, Estimate | Estimates]:
    """Modes of one axis' own path, as shares of its static motion."""
    model, gain = fit.model, own_gains(fit)[axis]
    f_std, zeta_std, c_std, v_std = _stds(fit, axis)
    c, v = model.displacement[axis, axis] / gain, model.velocity[axis, axis] / gain
    return {
        "f_Hz": _with_intervals(model.f_Hz, f_std, "Hz"),
        "zeta": _with_intervals(model.zeta, zeta_std, "1"),
        "c": _with_intervals(c, c_std / abs(gain), "1"),
        "velocity": _with_intervals(v, v_std / abs(gain), "1"),
    }


def coupling_params(fit: CommonModes, axis: int, axes: Sequence[str]) -> dict[str, Estimate | Estimates]:
    """What the other actuators do at one axis, per um of their own static motion."""
    model, gains = fit.model, own_gains(fit)
    f_std, zeta_std, _, _ = _stds(fit, axis)
    found: dict[str, Estimate | Estimates] = {
        "f_Hz": _with_intervals(model.f_Hz, f_std, "Hz"),
        "zeta": _with_intervals(model.zeta, zeta_std, "1"),
    }
    for j, other in enumerate(axes):
        if j == axis:
            continue
        _, _, c_std, v_std = _stds(fit, j)
        gain = gains[j]
        found[f"from_{other}"] = _with_intervals(model.displacement[axis, j] / gain, c_std / abs(gain), "um/um")
        found[f"velocity_{other}"] = _with_intervals(model.velocity[axis, j] / gain, v_std / abs(gain), "um/um")
        direct, std = float(model.direct[axis, j] / gain), float(fit.fit.share_std[j] / abs(gain))
        found[f"direct_{other}"] = (direct, "um/um", (direct - TWO_SIDED_95 * std, direct + TWO_SIDED_95 * std))
    return found


def params_in_front(fit: CommonModes, axis: int) -> dict[str, dict[str, Estimate | Estimates]]:
    """By name, what was fitted between one actuator and the modes: softening, and what is beside it."""
    found: dict[str, dict[str, Estimate | Estimates]] = {}
    index = axis
    name, entries = list(fit.entries.items())[axis] if fit.entries else ("", [])
    for effect, params in entries[len(fit.given.get(name, ())) :]:
        found[effect.name] = {}
        for p in fitted_parameters(effect):
            value, std = float(fit.fit.values[index]), float(fit.fit.value_std[index])
            bounded = max(value - TWO_SIDED_95 * std, p.low), min(value + TWO_SIDED_95 * std, p.high)
            found[effect.name][p.name] = (value, p.unit, bounded)
            index += len(fit.entries)
        if effect.shared_modes == "level":
            found[effect.name] |= _level_shapes(fit, effect, params) | _shifts(fit, axis)
    return found


def _level_shapes(fit: CommonModes, effect: Effect, params: Params) -> dict[str, Estimate | Estimates]:
    """The shapes of softening: those tried with what is known of them, the others as they were held."""
    known = {"tau_s": fit.taus_s, "exponent": fit.exponents}
    values = {p: float(params[p.name]) for p in effect.shapes}  # type: ignore[arg-type]
    return {p.name: (v, p.unit, known.get(p.name) or (v, v)) for p, v in values.items()}


def _shifts(fit: CommonModes, axis: int) -> dict[str, Estimate | Estimates]:
    """How the level of one actuator moves the modes."""
    shift = fit.fit.shift
    assert shift is not None
    eta, split = np.sqrt(1 - fit.model.zeta**2), fit.split[:, axis]
    return {
        "f_drop": _with_intervals(shift.real * split, fit.fit.shift_std[0::2] * split, "1"),
        "zeta_rise": _with_intervals(-shift.imag * split * eta, fit.fit.shift_std[1::2] * split * eta, "1"),
    }


def _stds(fit: CommonModes, source: int) -> tuple[Samples, Samples, Samples, Samples]:
    """Standard deviations (m,) of f_Hz, zeta, displacement and velocity for one actuator, correlations left out."""
    model = fit.model
    m, inputs = len(model.poles), model.inputs
    real, imaginary = fit.fit.pole_std[0::2], fit.fit.pole_std[1::2]
    eta = np.sqrt(1 - model.zeta**2)
    along = np.hypot(model.zeta * real, eta * imaginary)
    across = np.hypot(eta * real, model.zeta * imaginary)
    weights = fit.fit.share_std[inputs:].reshape(inputs, m, 2)[source]
    velocity, turning = weights.T
    return model.f_Hz * along, eta * across, np.hypot(eta * turning, model.zeta * velocity), velocity


def _with_intervals(values: Samples, std: Samples, unit: str) -> Estimates:
    """A list parameter with its unit and 95 % intervals."""
    pairs = tuple((float(v - TWO_SIDED_95 * s), float(v + TWO_SIDED_95 * s)) for v, s in zip(values, std, strict=True))
    return tuple(float(v) for v in values), unit, pairs


def adopted_axis(
    model: AxisModel, gain: float | None, found: Sequence[NamedEffect], provisional: AbstractSet[str]
) -> AxisModel:
    """The axis with its base scaled by ``gain``, None for as it is, and the effects in place of those of the same name;
    ``provisional`` are the names that are not vouched for."""
    view = model.time
    assert view is not None
    names = {one.name for one in found}
    kept = [e for e in model.effects if e.name not in names]
    effects = (*kept, *stage_file_entries(found, provisional))
    return model.model_copy(update={"time": view if gain is None else _scaled(view, gain), "effects": effects})


def _scaled(view: TimeView, gain: float) -> TimeView:
    """The view with all slopes times ``gain`` and the same position at rest. A negative gain reverses the axis.

    Raises ValueError for a negative gain where the view has plays.
    """
    if gain < 0 and view.play_r_V:
        raise ValueError("plays cannot be reversed")
    scaled = view.model_copy(
        update={
            "gain_um_per_V": gain * view.gain_um_per_V,
            "play_w_um_per_V": tuple(gain * w for w in view.play_w_um_per_V),
            "deadzone_s_um_per_V": tuple(gain * s for s in view.deadzone_s_um_per_V),
        }
    )
    return scaled.model_copy(update={"offset_um": scaled.offset_um + rest_position_um(view) - rest_position_um(scaled)})
