"""Effects fitted to records in um: nothing is whitened, weighed or shrunk."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from phaselead.gap.parameters import (
    SizedEffect,
    bounded,
    fresh_columns,
    from_internal,
    internal,
    parameters_of,
)
from phaselead.gap.residual import ModelledRun
from phaselead.model import Parameter
from phaselead.record import Samples

Taken = Callable[[Sequence[Samples]], Samples]
"""What counts of columns (n_i, k) in um, some for each run: rows (n, k) of all runs, without what is a record's own."""


def least_left(
    entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], taken: Taken, evaluations: int
) -> tuple[Samples, float]:
    """The parameters near those of ``entries`` that leave least of some runs, in internal units (parameters,), and the
    squares that they leave. ``evaluations`` of the runs at most."""
    free, start = parameters_of(entries), internal(entries)
    if not len(start):
        return start, squares_left(entries, runs, taken)

    def errors(x: Samples) -> Samples:
        return _errors(entries_at(entries, free, x), runs, taken)

    def slopes(x: Samples) -> Samples:
        at = entries_at(entries, free, x)
        return -taken([fresh_columns(run, at, free)[:, :-1] for run in runs])

    found = least_squares(errors, start, slopes, method="trf", x_scale="jac", max_nfev=evaluations)
    return found.x, 2 * float(found.cost)


def squares_left(entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], taken: Taken) -> float:
    """Squares that effects leave of some runs."""
    return float(np.sum(_errors(entries, runs, taken) ** 2))


def _errors(entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], taken: Taken) -> Samples:
    return taken([run.error(entries)[:, None] for run in runs])[:, 0]


def entries_at(
    entries: Sequence[SizedEffect], free: Sequence[tuple[int, Parameter]], x: Samples
) -> tuple[SizedEffect, ...]:
    """The effects at other values of their parameters, (parameters,) in internal units."""
    moved = [(effect, dict(params)) for effect, params in entries]
    for (i, p), value in zip(free, x, strict=True):
        moved[i][1][p.name] = from_internal(p, float(value))
    return tuple((effect, bounded(effect, params)) for effect, params in moved)
