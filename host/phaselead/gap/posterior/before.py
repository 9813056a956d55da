"""What comes with effects beside their own doing: what went on before a record began, and their part in the base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect, fresh_columns, is_logarithmic, to_internal
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect, Parameter, Params, Place
from phaselead.record import Samples

NEAR_RATIO, NEAR_PART = 0.3, 0.2
"""Deviation of a shape that is near another: of its logarithm, or as a part of its range."""


def before_record(modelled: ModelledRun, entries: Sequence[tuple[Effect, Params]]) -> list[Samples]:
    """Columns (n, k) in um of what each effect had done before the record began, one deviation of the state of each of
    its lags; k is 0 of one that is not slow. What stood off as a voltage passes the hysteresis."""
    run = modelled.run
    since_s = run.t_s - run.t_s[0]
    found: list[Samples] = []
    for effect, params in entries:
        if effect.before_record is None:
            found.append(np.zeros((run.stop - run.start, 0)))
            continue
        columns = effect.before_record(since_s, params, modelled.axis)
        if effect.place <= Place.AMPLIFIER:
            found.append(np.stack([modelled.after_voltage(column) for column in columns.T], axis=1))
        else:
            found.append(columns[run.rows])
    return found


def as_fault(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> Samples:
    """Columns (n, parameters) in um of effects that the base may lack in all records: one deviation of each parameter,
    as large as they are and of shapes near theirs. Each effect by itself.

    What a little more of a lag does is shown at its typical size at most: behind a large one it looks like no small
    lag, and the base can lack no more. Other effects may show nothing at such sizes."""
    found = [np.zeros((modelled.run.stop - modelled.run.start, 0))]
    for entry in entries:
        shown = _typical_at_most(entry) if entry[0].is_lag else entry
        found.append(fresh_columns(modelled, [shown])[:, :-1] * fault_deviations(entry))
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
