"""What one more record would say of rival sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.equation_misfit import is_of_material, may_be_missed_um2, missed_um2
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples


class Forecast:
    """Distances between the answers of some sets to a record that is not there yet."""

    def __init__(self, likelihood: Likelihood, sets: Sequence[Sequence[SizedEffect]]) -> None:
        self._likelihood = likelihood
        self._fits: list[Fit] = [likelihood.fit(entries, steps=0) for entries in sets]
        settled = [likelihood.settled(fit.terms, [fit.share]).amounts for fit in self._fits]
        # Of what may be missed in all records, as the records there are have it beside each set.
        self._shared_amounts = [of_set.common[0, :, 0] for of_set in settled]
        self._precisions = [np.asarray(np.linalg.pinv(fit.joint_covariance, hermitian=True)) for fit in self._fits]

    def squared_distances(self, modelled: ModelledRun, free: bool = True) -> Samples:
        """(sets, sets) in squared deviations between the answer of one set, which is true, and of another. Half of it
        is the log odds to be expected.

        ``modelled`` is the run without a measurement. ``free``: whether the base lacks what each set says that it does
        in all records, and whether that and the parameters of the other set move as far as the records there are allow.
        """
        run = BlockedRun(modelled, self._likelihood.runs[0].usual_um)
        answers = run.coefficients(np.stack([modelled.answer(fit.entries) for fit in self._fits], axis=1))
        shared = self._likelihood.shared_in(run) if free else np.zeros((len(answers), 0))
        own = [run.simulated(fit.entries) for fit in self._fits] if free else []
        # The tangents of each set, then what is shared, then what each had done before: as its precision is ordered.
        columns = [np.concatenate([of.columns[:, : of.tangents], shared, of.before], axis=1) for of in own]
        found = np.zeros((len(self._fits),) * 2)
        for j, true in enumerate(self._fits):
            variance, n = self._power_and_count(run, true)
            for i in range(len(self._fits)):
                if i == j:
                    continue
                between = answers[:, j] - answers[:, i]
                if free:
                    between = between + shared @ (self._shared_amounts[j] - self._shared_amounts[i])
                moving = columns[i] if free else np.zeros((len(answers), 0))
                with_difference = np.column_stack([moving, between])
                products = run.products(with_difference, with_difference)
                found[i, j] = _apart(products, variance, n, self._precisions[i])
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


def _apart(products: Samples, variance: Samples, n: Samples, precision: Samples) -> float:
    """From the mean products (blocks, q + 1, q + 1) of what may move and a difference what is left of it: by how much
    likelier it is, as ``n`` coefficients of each block, under a variance that holds it. ``precision`` (p, p) is of the
    first p that may move; the others have a deviation of 1."""
    q, p = products.shape[1] - 1, len(precision)
    if q:
        known = np.eye(q)
        known[:p, :p] = precision
        normal = np.tensordot(n / variance, products, 1)
        moved = np.linalg.solve(normal[:q, :q] + known, normal[:q, -1])
        with_difference = np.append(-moved, 1.0)
    else:
        with_difference = np.ones(1)
    left = np.maximum((products @ with_difference) @ with_difference, 0.0)
    return float((n * np.log1p(left / variance)).sum())
