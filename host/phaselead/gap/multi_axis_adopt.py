"""Common modes as effects of a stage file: per axis its own path, what it sees of the others, and the softening."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.multi_axis_fit import SharedFit
from phaselead.gap.result import NamedEffect, Value, Values
from phaselead.model import AdoptedEffect, AxisModel, Entry, TimeView, rest_position_um
from phaselead.record import Samples

SURE = 1.96
LEAST_GAIN = 1e-3
"""An own static gain below this share of the base's leaves that as it is."""


def own_gains(fit: SharedFit) -> Samples:
    """(axes,) by which the base's gains change: static gain of each axis' own path."""
    gains = np.diag(fit.model.static).copy()
    gains[np.abs(gains) < LEAST_GAIN] = LEAST_GAIN
    return np.asarray(gains)


def resonance_params(fit: SharedFit, axis: int) -> dict[str, Value | Values]:
    """Of one axis' own path, as shares of its static motion."""
    model, gain = fit.model, own_gains(fit)[axis]
    f_std, zeta_std, c_std, v_std = _stds(fit, axis)
    c, v = model.displacement[axis, axis] / gain, model.velocity[axis, axis] / gain
    return {
        "f_Hz": _list(model.f_Hz, f_std, "Hz"),
        "zeta": _list(model.zeta, zeta_std, "1"),
        "c": _list(c, c_std / abs(gain), "1"),
        "velocity": _list(v, v_std / abs(gain), "1"),
    }


def coupling_params(fit: SharedFit, axis: int, axes: Sequence[str]) -> dict[str, Value | Values]:
    """What the other actuators do at one axis, per um of their own static motion."""
    model, gains = fit.model, own_gains(fit)
    f_std, zeta_std, _, _ = _stds(fit, axis)
    found: dict[str, Value | Values] = {
        "f_Hz": _list(model.f_Hz, f_std, "Hz"),
        "zeta": _list(model.zeta, zeta_std, "1"),
    }
    for j, other in enumerate(axes):
        if j == axis:
            continue
        _, _, c_std, v_std = _stds(fit, j)
        gain = gains[j]
        found[f"from_{other}"] = _list(model.displacement[axis, j] / gain, c_std / abs(gain), "um/um")
        found[f"velocity_{other}"] = _list(model.velocity[axis, j] / gain, v_std / abs(gain), "um/um")
        direct, std = float(model.direct[axis, j] / gain), float(fit.fit.share_std[j] / abs(gain))
        found[f"direct_{other}"] = (direct, "um/um", (direct - SURE * std, direct + SURE * std))
    return found


def softening_params(fit: SharedFit, axis: int) -> dict[str, Value | Values]:
    """Of one actuator: what its level does to its gain and to the modes."""
    shift = fit.fit.shift
    assert shift is not None
    eta, split = np.sqrt(1 - fit.model.zeta**2), fit.split[:, axis]
    params = _softening(fit, axis)
    kappa, std = float(params["kappa"]), float(fit.fit.value_std[axis])  # type: ignore[arg-type]
    low, high = fit.taus_s or (0.0, np.inf)
    return {
        "kappa": (kappa, "1", (kappa - SURE * std, kappa + SURE * std)),
        "tau_s": (float(params["tau_s"]), "s", (low, high)),  # type: ignore[arg-type]
        "about_mean": (0.0, "1", (0.0, 0.0)),
        "f_drop": _list(shift.real * split, fit.fit.shift_std[0::2] * split, "1"),
        "zeta_rise": _list(-shift.imag * split * eta, fit.fit.shift_std[1::2] * split * eta, "1"),
    }


def _softening(fit: SharedFit, axis: int) -> Mapping[str, float | Sequence[float]]:
    entries: Sequence[Entry] = list(fit.entries.values())[axis]
    return next(params for e, params in entries if e.name == "softening")


def _stds(fit: SharedFit, source: int) -> tuple[Samples, Samples, Samples, Samples]:
    """Deviations (m,) of f_Hz, zeta, displacement and velocity for one actuator, poles and shares by themselves."""
    model = fit.model
    m, inputs = len(model.poles), model.inputs
    real, imaginary = fit.fit.pole_std[0::2], fit.fit.pole_std[1::2]
    eta = np.sqrt(1 - model.zeta**2)
    along = np.hypot(model.zeta * real, eta * imaginary)
    across = np.hypot(eta * real, model.zeta * imaginary)
    weights = fit.fit.share_std[inputs:].reshape(inputs, m, 2)[source]
    velocity, turning = weights.T
    return model.f_Hz * along, eta * across, np.hypot(eta * turning, model.zeta * velocity), velocity


def _list(values: Samples, std: Samples, unit: str) -> Values:
    pairs = tuple((float(v - SURE * s), float(v + SURE * s)) for v, s in zip(values, std, strict=True))
    return tuple(float(v) for v in values), unit, pairs


def adopted_axis(model: AxisModel, gain: float, found: Sequence[NamedEffect]) -> AxisModel:
    """The axis with its base at the new gain and the effects in its list, in place of those of the same name."""
    view = model.time
    assert view is not None
    names = {one.name for one in found}
    kept = [e for e in model.effects if e.name not in names]
    new = [
        AdoptedEffect(
            name=one.name,
            params={name: value for name, (value, _, _) in one.params.items()},
            ci95={name: interval for name, (_, _, interval) in one.params.items()},
            share=min(max(one.share, 0.0), 1.0),
        )
        for one in found
    ]
    return model.model_copy(update={"time": _scaled(view, gain), "effects": tuple([*kept, *new])})


def _scaled(view: TimeView, gain: float) -> TimeView:
    """All slopes times ``gain``, at rest where it was. A negative gain turns the axis round."""
    if gain < 0 and view.play_r_V:
        raise ValueError("plays cannot be turned round")
    scaled = view.model_copy(
        update={
            "gain_um_per_V": gain * view.gain_um_per_V,
            "play_w_um_per_V": tuple(gain * w for w in view.play_w_um_per_V),
            "deadzone_s_um_per_V": tuple(gain * s for s in view.deadzone_s_um_per_V),
        }
    )
    return scaled.model_copy(update={"offset_um": scaled.offset_um + rest_position_um(view) - rest_position_um(scaled)})
