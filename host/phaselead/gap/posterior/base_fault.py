"""What a base may lack in all records: an effect, as it looks at a size that nobody would have noticed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect, fresh_columns, is_logarithmic, to_internal
from phaselead.gap.residual import ModelledRun
from phaselead.model import Parameter
from phaselead.record import Samples

NEAR_RATIO, NEAR_PART = 0.3, 0.2
"""Deviation of a shape that is near another: of its logarithm, or as a part of its range."""


def as_fault(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> Samples:
    """Columns (n, parameters) in um of effects that the base may lack in all records: one deviation of each parameter,
    as large as they are and of shapes near theirs. Each effect by itself.

    What a little more of a lag does is shown at its typical size at most: behind a large one it looks like no small
    lag, and the base can lack no more. Other effects may show nothing at such sizes."""
    found = [np.zeros((modelled.run.stop - modelled.run.start, 0))]
    for entry in entries:
        shown = _typical_at_most(entry) if entry[0].is_lag else entry
        found.append(fresh_columns(modelled.run, modelled.answer, [shown])[:, :-1] * fault_deviations(entry))
    return np.concatenate(found, axis=1)


def _typical_at_most(entry: SizedEffect) -> SizedEffect:
    """The effect with no size above its typical one."""
    effect, params = entry
    sizes = {p.name: float(np.clip(params[p.name], -abs(p.typical), abs(p.typical))) for p in effect.sizes}
    return effect, {**params, **sizes}


def fault_deviations(entry: SizedEffect) -> Samples:
    """(parameters,) in internal units, of each parameter of an effect that the base may lack."""
    effect, params = entry
    return np.array([_fault_deviation(p, params[p.name]) for p in effect.parameters])


def _fault_deviation(p: Parameter, value: float) -> float:
    """In internal units."""
    if p.role == "size":
        return abs(to_internal(p, value))
    return NEAR_RATIO if is_logarithmic(p) else NEAR_PART * abs(to_internal(p, p.high) - to_internal(p, p.low))
