"""The catalogue of physical effects: one file each, found here; a new effect is a new file with an ``EFFECT``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType

from phaselead.effects.effect import Effect, Entry, Parameter, Params, Place, Samples, Signal
from phaselead.errors import BadInput
from phaselead.stage.file import EFFECT_NAMES

__all__ = ["Effect", "Entry", "Parameter", "Params", "Place", "Samples", "Signal", "catalogue", "effect"]


@cache
def _all() -> Mapping[str, Effect]:
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    effects = {m.EFFECT.name: m.EFFECT for m in modules if hasattr(m, "EFFECT")}
    known = [name for name in EFFECT_NAMES if name in effects]
    return {name: effects[name] for name in [*known, *sorted(set(effects) - set(known))]}


def catalogue(without: Sequence[str] = ()) -> Mapping[str, Effect]:
    """Every effect by name, in the order of the design; ``without`` leaves some out. Raises BadInput."""
    for name in without:
        effect(name)
    return MappingProxyType({name: e for name, e in _all().items() if name not in without})


def effect(name: str) -> Effect:
    """One effect. Raises BadInput when the catalogue has none of that name."""
    if name not in _all():
        raise BadInput(f"no effect is called {name!r}; there are {', '.join(_all())}")
    return _all()[name]
