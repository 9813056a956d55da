"""What one more record would say of rival sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect, fresh_columns
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.missed import is_of_material, may_be_missed_um2, missed_um2
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples


class Forecast:
    """Distances between the answers of some sets to a record that is not there yet."""

    def __init__(self, likelihood: Likelihood, sets: Sequence[Sequence[SizedEffect]]) -> None:
        self._likelihood = likelihood
        self._fits: list[Fit] = [likelihood.fit(entries, steps=0) for entries in sets]
        self._settled = [self._shared_amounts(fit) for fit in self._fits]
        self._covariances = [likelihood.covariances(fit.terms, [fit.share])[0] for fit in self._fits]

    def squared_distances(self, modelled: ModelledRun, free: bool = True) -> Samples:
        """(sets, sets) in squared deviations between the answer of one set, which is true, and of another. Half of it
        is the log odds to be expected.

        ``modelled`` is the run without a measurement. ``free``: whether the base lacks what each set says that it does
        in all records, and whether that and the parameters of the other set move as far as the records there are allow.
        """
        run = BlockedRun(modelled, self._likelihood.runs[0].usual_um)
        answers = np.stack([modelled.answer(fit.entries) for fit in self._fits], axis=1)
        answer = run.coefficients(answers)
        tangents = [np.zeros((len(answer), 0)) for _ in self._fits]
        if free:
            shared = self._likelihood.shared_in(run)
            answer += np.stack([shared @ amounts for amounts in self._settled], axis=1)
            tangents = [np.concatenate([self._tangents(run, fit), shared], axis=1) for fit in self._fits]
        found = np.zeros((len(self._fits),) * 2)
        for j, true in enumerate(self._fits):
            variance, n = self._power_and_count(run, true)
            for i in range(len(self._fits)):
                if i != j:
                    columns = np.concatenate([tangents[i], answer[:, [j]] - answer[:, [i]]], axis=1)
                    found[i, j] = _apart(run.products(columns, columns), variance, n, self._covariances[i])
        return found

    def _power_and_count(self, run: BlockedRun, true: Fit) -> tuple[Samples, Samples]:
        """Power (blocks,) in um^2 of what the record would hold beside the answer of the set that is true, and as how
        many coefficients a block would count."""
        noise, base, _ = self._likelihood.expected.of(run, run.motion)
        added = np.zeros((len(true.entries), len(run.sizes)))
        for i in range(len(true.entries)):
            rest = [*true.entries[:i], *true.entries[i + 1 :]]
            added[i] = run.spread(run.power(run.modelled.answer(true.entries) - run.modelled.answer(rest)))
        missed = missed_um2(true.share, added.sum(axis=0), added[is_of_material(true.entries)].sum(axis=0))
        may_be_missed = may_be_missed_um2(base, added.sum(axis=0))
        return noise + base + missed, self._likelihood.expected.counted(run.octaves, run.sizes, noise, may_be_missed)

    def _shared_amounts(self, fit: Fit) -> Samples:
        """(k,) of what may be missed in all records, as the records there are have it beside a set."""
        return self._likelihood.settled(fit.terms, [fit.share]).amounts.common[0, :, 0]

    def _tangents(self, run: BlockedRun, fit: Fit) -> Samples:
        """Coefficients (n, parameters): what one internal unit of each parameter does."""
        return run.coefficients(fresh_columns(run.modelled, fit.entries)[:, :-1])


def _apart(moments: Samples, variance: Samples, n: Samples, covariance: Samples) -> float:
    """From the mean products (blocks, p + 1, p + 1) of tangents and a difference what is left of it: by how much
    likelier it is, as ``n`` coefficients of each block, under a variance that holds it."""
    p = moments.shape[1] - 1
    if p:
        normal = np.tensordot(n / variance, moments, 1)
        moved = np.linalg.solve(normal[:p, :p] + np.linalg.pinv(covariance, hermitian=True), normal[:p, -1])
        with_difference = np.append(-moved, 1.0)
    else:
        with_difference = np.ones(1)
    left = np.maximum((moments @ with_difference) @ with_difference, 0.0)
    return float((n * np.log1p(left / variance)).sum())
