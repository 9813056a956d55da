"""How far records move beside what a model says of them, and from where on it is the doing of units or columns."""

from __future__ import annotations

from collections.abc import Iterable

from phaselead.model.effects import effect
from phaselead.quantity import digits


def scale_range() -> tuple[float, float]:
    """What a change of the scale may come to, at least and at most; beyond it units, signs or columns are others."""
    gain = effect("gain_change").parameters[0]
    return 1 + gain.low, 1 + gain.high


def out_of_scale(gain: float | None) -> bool:
    """Whether no change of a stage multiplies its motion by this; None: it is not known."""
    low, high = scale_range()
    return gain is not None and not low <= gain <= high


def as_far(gain: float) -> str:
    """How far something moves that moves so many times as the model says, backwards where that is below 0."""
    times = digits(abs(gain), 2)
    if gain < 0 and float(times) == 1:
        return "backwards beside the model"
    return f"{'backwards, ' if gain < 0 else ''}{times} times as far as the model says"


def scale_doubt(gains: Iterable[float]) -> str:
    """What is said of records that move so many times as far as they should."""
    each = " and ".join(dict.fromkeys(map(as_far, gains)))
    return f"{each}: check units, signs and columns, or give --map; or the model is of another stage"
