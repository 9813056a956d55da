"""Effects with their parameters: units in which these are fitted, bounds, and what each does to a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from phaselead.gap.records import GapRun
from phaselead.model import Effect, Parameter
from phaselead.record import Samples

SizedEffect = tuple[Effect, Mapping[str, float]]
"""An effect and its parameters, each a single number."""

Answer = Callable[[Sequence[SizedEffect]], Samples]
"""Position (n,) in um over the scored rows of a run, of its model with some effects."""

DIFFERENCE = 0.01
"""Finite difference for a tangent, in internal units."""
AT_END = 0.001
"""Relative distance to an end of its range from which a parameter stands at it."""


def parameters_of(entries: Sequence[SizedEffect]) -> list[tuple[int, Parameter]]:
    """Every parameter, after the number of the entry it belongs to."""
    return [(i, p) for i, (effect, _) in enumerate(entries) for p in effect.parameters]


def bounded(effect: Effect, params: Mapping[str, float]) -> dict[str, float]:
    """The parameters, those out of their bounds moved to the nearest."""
    return {p.name: float(np.clip(params[p.name], p.low, p.high)) for p in effect.parameters}


def stands_at_an_end(p: Parameter, value: float) -> bool:
    """Whether a value stands at an end of its parameter's range; an end of 0 is none, nor the highest where ordinary
    stages have it."""
    highest = value >= (1 - AT_END) * p.high and not p.may_be_highest
    return highest or value <= p.low + AT_END * abs(p.low) != 0


def to_internal(p: Parameter, value: float) -> float:
    """A value in internal units: its logarithm where the parameter is logarithmic, in typical values otherwise."""
    return float(np.log(value)) if is_logarithmic(p) else value / internal_unit(p)


def from_internal(p: Parameter, value: float) -> float:
    """Back from the internal unit, within the bounds."""
    with np.errstate(over="ignore"):  # an overflow is clipped to the bound
        return float(np.clip(np.exp(value) if is_logarithmic(p) else value * internal_unit(p), p.low, p.high))


def is_logarithmic(p: Parameter) -> bool:
    """Whether it is fitted as its logarithm: what has a logarithmic scale and cannot be 0, as a size must be able
    to."""
    return p.log and p.low > 0


def internal(entries: Sequence[SizedEffect]) -> Samples:
    """All parameters in internal units, (parameters,)."""
    return np.array([to_internal(p, entries[i][1][p.name]) for i, p in parameters_of(entries)])


def entries_at(entries: Sequence[SizedEffect], x: Samples) -> tuple[SizedEffect, ...]:
    """The effects at other values of their parameters, (parameters,) in internal units, within the bounds."""
    moved = [(effect, dict(params)) for effect, params in entries]
    for (i, p), value in zip(parameters_of(entries), x, strict=True):
        moved[i][1][p.name] = from_internal(p, float(value))
    return tuple(moved)


def internal_unit(p: Parameter) -> float:
    """One internal unit of a parameter that is not logarithmic."""
    return abs(p.typical) if p.typical else (p.high - p.low) / 10


def fresh_columns(run: GapRun, answer_of: Answer, entries: Sequence[SizedEffect]) -> Samples:
    """Columns (n, parameters + 1) in um over the scored rows of one run: what one internal unit of each parameter does
    to its answer, by finite differences, and the residual last."""
    answer = answer_of(entries)
    columns = [(answer_of(_changed(entries, i, p, d)) - answer) / d for i, p, d in _differences(entries)]
    return np.stack([*columns, run.x_um[run.rows] - answer]).T


def _differences(entries: Sequence[SizedEffect]) -> list[tuple[int, Parameter, float]]:
    """A finite difference in internal units for each parameter, towards the inside of its bounds."""
    found = []
    for i, p in parameters_of(entries):
        at = to_internal(p, entries[i][1][p.name])
        inside = at + DIFFERENCE < to_internal(p, p.high)
        found.append((i, p, DIFFERENCE if inside else -DIFFERENCE))
    return found


def _changed(entries: Sequence[SizedEffect], index: int, p: Parameter, change: float) -> list[SizedEffect]:
    """The entries with one parameter of one of them changed, in internal units."""
    changed = list(entries)
    effect, params = entries[index]
    changed[index] = (effect, {**params, p.name: from_internal(p, to_internal(p, params[p.name]) + change)})
    return changed
