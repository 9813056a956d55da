"""Sizes that follow from the parameters of an effect, as a person means them: a bow's peak, a drift's mean rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.model.axis import AxisModel
from phaselead.model.effects.parameters import Params
from phaselead.record import Samples

Interval = tuple[float, float]
NUDGE = 0.25
"""Of an interval's half-width: the step of the derivatives by which it is passed on."""


@dataclass(frozen=True)
class Scene:
    """What a size refers to beside the parameters."""

    axis: AxisModel
    spans_s: tuple[tuple[float, float], ...] = ()
    """First and last time of each record."""


@dataclass(frozen=True)
class Derived:
    """One derived size: ``value`` of complete parameters in a scene."""

    name: str
    unit: str
    value: Callable[[Params, Scene], float]
    doc: str = ""


def derived_estimates(
    sizes: Sequence[Derived],
    params: Params,
    ci95: Mapping[str, Interval | Sequence[Interval]],
    scene: Scene,
    correlation: Samples | None = None,
) -> dict[str, tuple[float, str, Interval]]:
    """Value, unit and 95 % interval of each size, from complete ``params`` and the intervals of the fitted numbers.

    Intervals are passed on to first order (JCGM 100:2008, 5.1.2), each side by itself. ``correlation`` (k, k) is of
    the parameters in ``ci95``, in order; without it they are taken as independent.
    """
    fitted = [name for name, interval in ci95.items() if _is_one(interval) and name in params]
    found = {}
    for size in sizes:
        at = size.value(params, scene)
        up = np.array([_moved(size, params, scene, at, name, ci95[name], 1) for name in fitted])
        down = np.array([_moved(size, params, scene, at, name, ci95[name], 0) for name in fitted])
        together = np.eye(len(fitted)) if correlation is None else correlation
        # A parameter's upper side raises some sizes and lowers others.
        above, below = (_length(_towards(up, down, side), together) for side in (1, -1))
        found[size.name] = (at, size.unit, (at - below, at + above))
    return found


def _length(changes: Samples, together: Samples) -> float:
    """Of changes (k,) with a correlation (k, k)."""
    return float(np.sqrt(np.maximum(changes @ together @ changes, 0.0)))


def _towards(up: Samples, down: Samples, side: int) -> Samples:
    """(k,): the change of a size, signed by its slope, by the side of each parameter's interval that moves it there."""
    slope = np.sign(up - down)
    return np.asarray(slope * np.maximum(np.maximum(side * up, side * down), 0.0))


def _moved(size: Derived, params: Params, scene: Scene, at: float, name: str, interval: object, side: int) -> float:
    """What one parameter's move to a side of its interval does to the size, to first order."""
    value, ends = params[name], interval
    assert isinstance(value, (int, float))
    assert isinstance(ends, Sequence)
    step = NUDGE * (float(ends[side]) - value)
    return (size.value({**params, name: value + step}, scene) - at) / NUDGE


def _is_one(interval: object) -> bool:
    """Whether it is the interval of a number, not of a list."""
    return isinstance(interval, Sequence) and len(interval) == 2 and not isinstance(interval[0], Sequence)
