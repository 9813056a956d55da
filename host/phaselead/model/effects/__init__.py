"""The catalogue of physical effects: one file each, found here; a new effect is a new file with an ``EFFECT``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType

from phaselead.errors import BadInput
from phaselead.model.effects.interface import Effect, Entry, Parameter, Params, Picture, Place, Samples, Signal, number

__all__ = [
    "Effect",
    "Entry",
    "Parameter",
    "Params",
    "Picture",
    "Place",
    "Samples",
    "Signal",
    "catalogue",
    "effect",
    "number",
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
        raise BadInput(f"no effect is called {name!r}; there are {', '.join(_all())}")
    return _all()[name]
