"""What one more record would say of rival sets: how far apart their answers lie in the space of the records there are.

The record joins the space like any other. What the base misses, the equations of the sets and their parameters are as
uncertain in it as the records there are leave them. A waveform that a reference record has played already cancels most
of what the base misses, since that is then known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.posterior.build import missed_columns
from phaselead.gap.posterior.evidence import FITTED_AT, Solver, uncertain_columns
from phaselead.gap.posterior.misfit import as_fault, before_record, parameters_of
from phaselead.gap.posterior.priors import prior_of
from phaselead.gap.posterior.space import joined
from phaselead.gap.problem import Problem
from phaselead.gap.refit import SizedEffect, fresh_columns
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

ROUNDING = 1e-12
"""Of the largest eigenvalue of an information matrix: what is below is rounding."""

Whiten = Callable[[Samples], Samples]
"""Columns (n, k) in um of the proposed record to whitened ones (m, k), its own nuisances taken out."""


class Forecast:
    """Squared distances between the answers of some sets to a record that is not there yet."""

    def __init__(self, solver: Solver, problem: Problem, sets: Sequence[Sequence[SizedEffect]]) -> None:
        """``problem`` is one whose records the solver's space holds."""
        self._solver, self._problem, self._sets = solver, problem, sets
        self._misfits = [solver.misfit_in(entries) for entries in sets]
        self._faulty = sets if not solver.space.changed.all() else ()
        misfits = [(solver.misfit(entries), True) for entries in sets]
        self._of_all = uncertain_columns([*misfits, *((solver.faults(entries), False) for entries in self._faulty)])
        self._known = [self._posterior(entries) for entries in sets]

    def squared_distances(self, modelled: ModelledRun, whiten: Whiten) -> Samples:
        """(sets, sets) in squared deviations between the answer of one set, which is true, and of another, whose
        parameters then move as far as the records there are allow. Half of it is the log odds to be expected.

        ``modelled`` is the run without a measurement.
        """
        space = self._solver.space
        faults = list(self._solver.alone.values())
        before = [one for entries in self._sets if (one := before_record(modelled, entries)) is not None]
        parts = [
            whiten(missed_columns(self._problem, modelled, faults)) @ space.made_by,
            whiten(self._common(modelled)),
            *(whiten(_tangents(modelled, entries)) for entries in self._sets),
            *(whiten(one) for one in before),
            whiten(np.stack([modelled.answer(entries) for entries in self._sets], axis=1)),
        ]
        every = np.concatenate(parts, axis=1)
        ends = np.cumsum([0, *(part.shape[1] for part in parts)])
        base, common, *tangents = [np.arange(a, b) for a, b in pairwise(ends)]
        answers, states = tangents[-1], np.arange(ends[2 + len(self._sets)], ends[-2])
        products = _integrated(every.T @ every, base, space.own)
        products = _integrated(products, states, np.eye(len(states)))
        places = [np.concatenate([base, common, one]) for one in tangents[: len(self._sets)]]
        means = np.zeros((len(products), len(self._sets)))
        for j, (mean, _) in enumerate(self._known):
            means[answers[j], j], means[places[j], j] = 1.0, mean
        found = np.zeros((len(self._sets),) * 2)
        for j, (_, root) in enumerate(self._known):
            apart = means - means[:, [j]]
            found[:, j] = np.einsum("ij,ij->j", apart, _integrated(products, places[j], root) @ apart)
        return np.maximum(found, 0.0)

    def _common(self, modelled: ModelledRun) -> Samples:
        """Columns (n, q) in um that any of the sets brings: its misfit, and its effects as faults of the base."""
        misfits = [misfit(modelled) for misfit in self._misfits]
        return np.concatenate([*misfits, *(as_fault(modelled, entries) for entries in self._faulty)], axis=1)

    def _posterior(self, entries: Sequence[SizedEffect]) -> tuple[Samples, Samples]:
        """Mean (a,) and a root (a, b) of the covariance of the amounts of the base's columns, the common ones and the
        tangents of one set, as the records leave them where it is true."""
        solver, space = self._solver, self._solver.space
        tangents = solver.changed_columns(lambda r: _tangents(r.modelled, entries))
        others = [columns for columns, _ in solver.of_records(entries)]
        prior = prior_of(entries, solver.step_s).precision
        known, count = self._of_all, sum(part.count for part in others)
        precision = np.concatenate([known.precision(FITTED_AT), prior, np.ones(count)])
        columns = joined(known.columns, tangents, *others, solver.residual(entries))
        moments = space.information(columns, space.all)
        information, right = moments[:-1, :-1], moments[:-1, -1]
        k = len(information) - len(precision)
        information[k:, k:] += np.diag(precision)
        root = _root_of_inverse(information)
        mean = root @ (root.T @ right)
        root[:k], mean[:k] = space.shared @ root[:k], space.shared @ mean[:k]
        kept = len(mean) - count
        return mean[:kept], root[:kept]


def _tangents(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> Samples:
    """Columns (n, parameters) in um: what one internal unit of each parameter does."""
    return np.asarray(fresh_columns(modelled, entries, parameters_of(entries))[:, :-1])


def _integrated(products: Samples, places: Samples, root: Samples) -> Samples:
    """Products (p, p) of columns with those at ``places`` integrated out, whose amounts have the covariance R R'."""
    taken = root.T @ products[places]
    factor = cho_factor(np.eye(len(taken)) + taken[:, places] @ root)
    return np.asarray(products - taken.T @ cho_solve(factor, taken))


def _root_of_inverse(information: Samples) -> Samples:
    """R (k, k) with R R' the inverse."""
    scale = 1 / np.sqrt(np.diag(information))
    power, turn = np.linalg.eigh(scale[:, None] * information * scale)
    return np.asarray(scale[:, None] * turn / np.sqrt(np.maximum(power, ROUNDING * power[-1])))
