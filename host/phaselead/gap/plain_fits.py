"""Effects fitted one by one to records as they stand, in um: what is slow and large counts as what it is.

So they are found from far away, and they predict. What their names are worth is another question.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.least_squares import entries_at, least_left
from phaselead.gap.parameters import SizedEffect, parameters_of, stands_at_an_end
from phaselead.gap.posterior import Fit, Starts, likelihood_of
from phaselead.gap.regressors import RegressorGroup
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect
from phaselead.record import Samples

MOST_FITTED, FITTED_TO_THE_END = 7, 3
"""Effects that are fitted, and those of them that are fitted to the end: what the time for an answer allows."""
ROUGH_EVALUATIONS, EVALUATIONS = 3, 12
"""Of the records, at most."""


def each_fitted(runs: Sequence[ModelledRun], effects: Sequence[Effect]) -> list[SizedEffect]:
    """Effects by themselves, fitted to some runs, the one that leaves least first: those that are expected to explain
    most, and that do so at a size within its range. What is a record's own is taken out: its offset, and where its
    plays began."""
    if not effects:
        return []
    starts = _PlainStarts(likelihood_of(runs), effects)
    likelihood = starts.likelihood
    of_runs = [run.modelled for run in likelihood.runs]

    def taken(run: int, columns: Samples) -> Samples:
        return likelihood.runs[run].coefficients(columns)

    def fitted(entry: SizedEffect, evaluations: int) -> tuple[float, SizedEffect]:
        at, left = least_left([entry], of_runs, taken, evaluations)
        return left, entries_at([entry], parameters_of([entry]), at)[0]

    promising = list(starts.beside(likelihood.fit(())).values())[:MOST_FITTED]
    rough = [_least([fitted(start.entry, ROUGH_EVALUATIONS) for start in several]) for several in promising]
    rough.sort(key=lambda one: one[0])
    found = [fitted(entry, EVALUATIONS) for _, entry in rough[:FITTED_TO_THE_END]] + rough[FITTED_TO_THE_END:]
    within = [(left, entry) for left, entry in found if not _as_large_as_it_can_be(entry)]
    return [entry for _, entry in sorted(within, key=lambda one: one[0])]


def _least(tried: Sequence[tuple[float, SizedEffect]]) -> tuple[float, SizedEffect]:
    return min(tried, key=lambda one: one[0])


def _as_large_as_it_can_be(entry: SizedEffect) -> bool:
    """Whether one of its sizes stands at an end of its range: then it imitates something else."""
    effect, params = entry
    return any(stands_at_an_end(p, params[p.name]) for p in effect.sizes)


class _PlainStarts(Starts):
    """Starts that explain most squares in um beside the base alone: no coefficient counts more than another."""

    def moments(
        self,
        fit: Fit,
        groups: Sequence[RegressorGroup],
        columns: Sequence[NDArray[np.float32]],
        independent: Samples | float = 1.0,
    ) -> list[tuple[RegressorGroup, Samples, Samples]]:
        found, first = [], 0
        residuals = [run.base_error[:, 0] / run.usual_um for run in self.likelihood.runs]
        for group in groups:
            last = first + len(group.steps)
            of_runs = [
                one[:, first:last].astype(np.float64) / run.usual_um
                for one, run in zip(columns, self.likelihood.runs, strict=True)
            ]
            pairs = list(zip(of_runs, residuals, strict=True))
            slope = np.sum([one.T @ left for one, left in pairs], axis=0)
            found.append((group, slope, np.asarray(np.sum([one.T @ one for one in of_runs], axis=0))))
            first = last
        return found
