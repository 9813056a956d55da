"""Effects fitted one by one to records as they stand, in um: what is slow and large counts as what it is.

So they are found from far away, and they predict. What their names are worth is another question.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from phaselead.gap.least_squares import fitted_in_um
from phaselead.gap.parameters import SizedEffect, stands_at_an_end
from phaselead.gap.posterior.contest import likelihood_of
from phaselead.gap.posterior.first_order import Histories
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.posterior.shapes import Shapes
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.regressors import RegressorGroup
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect
from phaselead.record import Samples

MOST_FITTED, FITTED_TO_THE_END = 7, 3
"""Effects that are fitted, and those of them that are fitted to the end: what the time for an answer allows."""
ROUGH_EVALUATIONS, EVALUATIONS = 3, 12
"""Simulations of the records in a rough fit and in one to the end, at most."""


def each_fitted(
    runs: Sequence[ModelledRun], effects: Sequence[Effect], base_may_be_off: bool = False
) -> list[SizedEffect]:
    """Effects by themselves, fitted to some runs, the one that leaves least first: those that are expected to explain
    most, and that do so at a size within its range. What is a record's own is taken out: its offset, and where its
    plays began. With ``base_may_be_off``, so is what a refit of the base could change."""
    if not effects:
        return []
    likelihood = likelihood_of(runs, base_may_be_off)
    free = _Free(likelihood)

    def without_own(columns: Sequence[Samples]) -> Samples:
        pairs = zip(likelihood.runs, columns, strict=True)
        return free.taken_out(np.concatenate([run.coefficients(one) for run, one in pairs]))

    def fitted(entry: SizedEffect, evaluations: int) -> tuple[float, SizedEffect]:
        found, left = fitted_in_um([entry], [run.modelled for run in likelihood.runs], without_own, evaluations)
        return left, (entry[0], found[0][1])

    starts = _PlainStarts(likelihood, effects, free)
    every = starts.beside(likelihood.fit(())).values()
    promising = sorted(every, key=lambda several: -max(start.gain for start in several))[:MOST_FITTED]
    of_each = ([fitted(start.entry, ROUGH_EVALUATIONS) for start in several] for several in promising)
    rough = sorted((min(tried, key=itemgetter(0)) for tried in of_each), key=itemgetter(0))
    found = [fitted(entry, EVALUATIONS) for _, entry in rough[:FITTED_TO_THE_END]] + rough[FITTED_TO_THE_END:]
    within = [(left, entry) for left, entry in found if not _as_large_as_it_can_be(entry)]
    return [entry for _, entry in sorted(within, key=itemgetter(0))]


def _as_large_as_it_can_be(entry: SizedEffect) -> bool:
    """Whether one of its sizes stands at an end of its range: then it imitates something else."""
    effect, params = entry
    return any(stands_at_an_end(p, params[p.name]) for p in effect.sizes)


class _Free:
    """What a refit of the base could change, the same in all runs, each column as large as its prior deviation."""

    def __init__(self, likelihood: Likelihood) -> None:
        self._columns = np.concatenate(likelihood.shared)
        self._usual_um = likelihood.runs[0].usual_um
        normal = self._columns.T @ self._columns + self._usual_um**2 * np.eye(self._columns.shape[1])
        self._inverse = np.linalg.inv(normal)

    def taken_out(self, columns: Samples) -> Samples:
        """Columns (n, k) without what of them could be the base's, and behind them what that costs, so that their
        products are those under the prior."""
        amounts = self._inverse @ (self._columns.T @ columns)
        return np.concatenate([columns - self._columns @ amounts, self._usual_um * amounts])


class _PlainStarts(Starts):
    """Starts that explain most squares in um beside the base alone: no coefficient counts more than another."""

    with_outliers = False

    def __init__(self, likelihood: Likelihood, effects: Sequence[Effect], free: _Free) -> None:
        super().__init__(likelihood, effects)
        self._free = free

    def moments(
        self,
        fit: Fit,
        shapes: Shapes,
        independent: Samples | float = 1.0,
        histories: Histories | None = None,
    ) -> list[tuple[RegressorGroup, Samples, Samples]]:
        """Per shape the slope (sizes,) and curvature (sizes, sizes) of the squares, beside the base whatever the
        set, and without ``histories``."""
        runs, found, first = self.likelihood.runs, [], 0
        usual_um = runs[0].usual_um
        residual = self._free.taken_out(np.concatenate([run.base_error for run in runs]) / usual_um)[:, 0]
        for group in shapes.groups:
            last = first + len(group.steps)
            mine = np.concatenate([one[:, first:last] for one in shapes.columns]).astype(np.float64) / usual_um
            mine = self._free.taken_out(mine)
            found.append((group, mine.T @ residual, mine.T @ mine))
            first = last
        return found
