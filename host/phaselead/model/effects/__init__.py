"""The catalogue of physical effects: one file each, found here; a new effect is a new file with an ``EFFECT``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.derived import Derived, Interval, Scene, derived_estimates
from phaselead.model.effects.filters import (
    Mode,
    behind_modes,
    lags,
    mode_coefficients,
    modes_in_C,
    relaxed_late,
    resonant,
    second_order_residual,
    without_lags,
)
from phaselead.model.effects.interface import Effect, Entry, ModePart, Params, Signal, modes_in, rewritten
from phaselead.model.effects.mode_bank import Complex, modes_of, shares, state_weights, states, states_and_slopes
from phaselead.model.effects.parameters import CheckedParameters, Parameter, Value
from phaselead.model.effects.place import MODES_FROM, Place
from phaselead.model.effects.softening import push_level
from phaselead.model.effects.virtual import NotPlayed, VirtualAxis
from phaselead.nearest import nearest
from phaselead.record import Samples

__all__ = [
    "MODES_FROM",
    "CheckedParameters",
    "Complex",
    "Derived",
    "Effect",
    "Entry",
    "Mode",
    "ModePart",
    "NotPlayed",
    "Parameter",
    "Params",
    "Place",
    "Scene",
    "Signal",
    "VirtualAxis",
    "behind_modes",
    "catalogue",
    "derived_sizes",
    "effect",
    "effect_of_creep",
    "effect_of_fading",
    "effect_of_lag",
    "effect_of_modes",
    "effect_of_shares",
    "lags",
    "mode_coefficients",
    "modes_in",
    "modes_in_C",
    "modes_of",
    "push_level",
    "relaxed_late",
    "resonant",
    "rewritten",
    "second_order_residual",
    "shares",
    "state_weights",
    "states",
    "states_and_slopes",
    "without_lags",
]


@cache
def _all() -> Mapping[str, Effect]:
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    effects = {m.EFFECT.name: m.EFFECT for m in modules if hasattr(m, "EFFECT")}
    return {e.name: e for e in sorted(effects.values(), key=lambda e: (e.listed, e.name))}


def catalogue(without: Sequence[str] = ()) -> Mapping[str, Effect]:
    """Every effect by name, in the order in which they are listed; ``without`` leaves some out. Raises BadInput."""
    for name in without:
        effect(name)
    return MappingProxyType({name: e for name, e in _all().items() if name not in without})


def effect(name: str) -> Effect:
    """One effect. Raises BadInput when the catalogue has none of that name."""
    if name not in _all():
        raise BadInput(f"no effect is called {name!r}; {nearest(name, _all(), 'there are')}")
    return _all()[name]


def effect_of_modes(modes: Sequence[Mode]) -> tuple[Effect, dict[str, float | tuple[float, ...]]]:
    """The effect that gives the mechanics its modes, and the parameters that it has with these."""
    return next((e, e.from_modes(modes)) for e in _all().values() if e.from_modes is not None)


def effect_of_lag(tau_s: float) -> Entry:
    """The effect that lags in front of the operator, and the parameters that it has with this time constant."""
    return next((e, {e.sizes[0].name: tau_s}) for e in _all().values() if e.lag_s is not None)


def effect_of_creep(per_decade: float, first_s: float, last_s: float) -> Entry:
    """The effect that goes on after the voltage has stopped, straight in the logarithm of time between two times, and
    its parameters."""
    found = next(e for e in _all().values() if e.creep_terms is not None)
    return found, {found.sizes[0].name: per_decade, **dict(zip(found.rising, (first_s, last_s), strict=True))}


def effect_of_fading(r_V: Samples, w_um_per_V: Samples, axis: AxisModel) -> Entry:
    """The effect that gives the time view of an axis fading plays of these thresholds and weights (m,)."""
    return next((e, e.from_fading(r_V, w_um_per_V, axis)) for e in _all().values() if e.from_fading is not None)


def effect_of_shares(shares_of_motion: Mapping[str, float]) -> Entry:
    """The effect by which an axis sees others move, and its parameters for these shares of their motion, by name."""
    return next((e, e.from_shares(shares_of_motion)) for e in _all().values() if e.from_shares is not None)


def derived_sizes(
    name: str,
    estimates: Mapping[str, tuple[Value, str, Interval | Sequence[Interval]]],
    scene: Scene,
    correlation: Samples | None = None,
) -> dict[str, tuple[float, str, Interval]]:
    """What an effect's ``estimates`` (value, unit and 95 % interval of each parameter) come to as a person means them:
    value, unit and interval of each derived size, by name; empty where the effect has none, or is not known.
    ``correlation`` (k, k) is of the parameters, in order; without it they are taken as independent."""
    e = _all().get(name)
    if e is None or not e.derived:
        return {}
    params = e.complete({p: value for p, (value, _, _) in estimates.items()})
    ci95 = {p: interval for p, (_, _, interval) in estimates.items()}
    return derived_estimates(e.derived, params, ci95, scene, correlation)
