"""Effects fitted to records by least squares in um."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from phaselead.gap.parameters import SizedEffect, entries_at, fresh_columns, internal
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

WithoutOwn = Callable[[Sequence[Samples]], Samples]
"""Takes columns (n_i, k) in um of each run and gives rows (n, k) of all runs, without what is a record's own."""


def fitted_in_um(
    entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], without_own: WithoutOwn, evaluations: int
) -> tuple[tuple[SizedEffect, ...], float]:
    """The effects at the parameters near theirs that leave least of some runs, and the squares in um^2 that they leave.

    The runs are simulated ``evaluations`` times at most, their slopes as often.
    """
    start = internal(entries)
    if not len(start):
        return tuple(entries), squares_left(entries, runs, without_own)

    def errors(x: Samples) -> Samples:
        return _errors(entries_at(entries, x), runs, without_own)

    def slopes(x: Samples) -> Samples:
        at = entries_at(entries, x)
        return -without_own([fresh_columns(run.run, run.answer, at)[:, :-1] for run in runs])

    found = least_squares(errors, start, slopes, method="trf", x_scale="jac", max_nfev=evaluations)
    return entries_at(entries, found.x), 2 * float(found.cost)


def squares_left(entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], without_own: WithoutOwn) -> float:
    """Squares in um^2 that effects leave of some runs."""
    return float(np.sum(_errors(entries, runs, without_own) ** 2))


def _errors(entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], without_own: WithoutOwn) -> Samples:
    return without_own([run.error(entries)[:, None] for run in runs])[:, 0]
