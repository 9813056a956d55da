"""What more effects would explain beside a set, to first order: all parameters of the set move along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.history import before_record
from phaselead.gap.parameters import internal
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.moments import Amounts, Integers
from phaselead.gap.posterior.sets import Terms
from phaselead.gap.posterior.shapes import Shapes
from phaselead.gap.regressors import RegressorGroup
from phaselead.record import Samples


class Histories:
    """What the effects of groups had done before each record, as columns that stand behind those of their sizes: those
    of the first record, then those of the second."""

    def __init__(self, of_runs: Sequence[Sequence[Samples]]) -> None:
        self.of_runs = of_runs
        """Per run and group the coefficients (n, b), one prior deviation of a state each, without their level."""
        self._widths = np.array([[one.shape[1] for one in of_run] for of_run in of_runs])

    @property
    def count(self) -> int:
        """Of all columns."""
        return int(self._widths.sum())

    def of_run(self, k: int, run: int) -> Integers:
        """The places of the columns of one run behind k others."""
        begin = k + int(self._widths[:run].sum())
        return np.arange(begin, begin + int(self._widths[run].sum()))

    def behind(self, sizes: Sequence[int]) -> list[Integers]:
        """The places of the columns of each group, where so many sizes of each stand in front of all."""
        if not sizes:
            return []
        of_sizes = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
        places = np.split(sum(sizes) + np.arange(self.count), self._widths.cumsum()[:-1])  # run by run, group by group
        return [np.concatenate([mine, *places[i :: len(sizes)]]) for i, mine in enumerate(of_sizes)]


def histories_of(runs: Sequence[BlockedRun], groups: Sequence[RegressorGroup]) -> Histories:
    """What the effects of groups had done before some runs, at their typical sizes: of what relaxes. A mode has most
    often rung out."""
    return Histories([[_history(run, group) for group in groups] for run in runs])


def _history(run: BlockedRun, group: RegressorGroup) -> Samples:
    effect = group.effect
    if not run.changed or effect.before_record is None or effect.peak is not None:
        return np.zeros((run.edges[-1], 0))
    entry = group.entry([1.0] * len(group.steps))
    found = run.coefficients(before_record(run.modelled, [entry], [entry])[0])
    if run.levelled:
        found[0] = 0.0  # where a record stands then says nothing
    return found


@dataclass(frozen=True)
class Residual:
    """What a set and a group leave."""

    power: Samples
    """(blocks,) of the residual."""
    added: Samples
    """(blocks,) power of what the sizes of the group add, spread."""
    log_prior: float
    """Of the amounts of all that is integrated out, against none of it, and of where the parameters of the set move,
    against where they were."""


class FirstOrder:
    """What effects of small size would take off what a set leaves, block by block, each counting by a weight."""

    def __init__(
        self,
        likelihood: Likelihood,
        terms: Terms,
        weights: Samples,
        shapes: Shapes,
        histories: Histories | None = None,
    ) -> None:
        """``weights`` (blocks,) by which squares count. ``histories`` of the shapes, by default none."""
        self._likelihood, self._terms = likelihood, terms
        groups, self._columns = shapes.groups, shapes.columns
        self._histories = histories or Histories([[np.zeros((len(one), 0)) for _ in groups] for one in self._columns])
        self._sizes = sum(len(group.steps) for group in groups)
        self._places = self._histories.behind([len(group.steps) for group in groups])
        self._normal, self._right = terms.moments.normal(weights[None], terms.prior.precision)
        prior, p = terms.prior, terms.moments.tangents
        self._right.common[0, :p, 0] -= prior.precision * (internal(terms.entries) - prior.centre)
        c, every = self._normal.common.shape[1], self._sizes + self._histories.count
        common, before = np.zeros((c + 1, every)), np.zeros((*self._normal.before.shape[1:3], every))
        self._own = [np.zeros((len(at), len(at))) for at in self._places]
        for i, (run, mine) in enumerate(zip(likelihood.runs, np.split(weights, terms.moments.runs[1:-1]), strict=True)):
            if not run.changed:
                continue
            roots = np.repeat(np.sqrt(mine / run.sizes), run.sizes)[:, None].astype(np.float32)
            weighed, here = self._of_run(i) * roots, self._here(i)
            cross = (self._of_set[i].astype(np.float32) * roots).T @ weighed
            common[:, here] += cross[: c + 1]
            before[i][:, here] = cross[c + 1 :] * terms.moments.moving[i][:, None]
            for at, products in zip(self._places, self._own, strict=True):
                in_run = np.isin(at, here)
                of_group = weighed[:, np.searchsorted(here, at[in_run])]
                products[np.ix_(in_run, in_run)] += of_group.T @ of_group
        with_set = Amounts(common[None, :-1], before[None])
        self._by_itself = self._normal.solve(self._right)
        self._moved_by = self._normal.solve(with_set)
        self._slopes = common[-1] - with_set.along(self._by_itself)[0, :, 0]
        self._taken = with_set.along(self._moved_by)[0]

    @cached_property
    def _of_set(self) -> list[Samples]:
        """Per run the columns (n, c + 1 + b) of the set: its tangents, the shared ones, the residual, and its own."""
        likelihood, p, found = self._likelihood, self._terms.moments.tangents, []
        simulated = likelihood.simulated(self._terms)
        firsts = likelihood.first_rows(simulated)
        for run, shared, one, first in zip(likelihood.runs, likelihood.shared, simulated, firsts, strict=True):
            columns = np.concatenate([one.of_tangents(p), shared, one.columns[:, -1:], one.before], axis=1)
            tangents = first[:p] if run.changed else np.zeros(p)
            columns[0] = np.concatenate([tangents, shared[0], first[-1:], first[p:-1]])
            found.append(columns)
        return found

    def _of_run(self, i: int) -> NDArray[np.float32]:
        """(n, k + h) columns of the sizes of all groups, and of their histories in a run."""
        return np.concatenate([self._columns[i], *self._histories.of_runs[i]], axis=1).astype(np.float32)

    def _here(self, i: int) -> Integers:
        """The places of these among those of all runs."""
        return np.concatenate([np.arange(self._sizes), self._histories.of_run(self._sizes, i)])

    def slope_and_curvature(self, which: int) -> tuple[Samples, Samples]:
        """Slope (sizes,) and curvature (sizes, sizes) of the log density over the sizes of a group; behind these stand
        the amounts of its histories."""
        at = self._places[which]
        return self._slopes[at], self._own[which] - self._taken[np.ix_(at, at)]

    def residual_with(self, which: int, amounts: Samples) -> Residual:
        """What is left with so much (sizes and histories,) of a group, and of the set what then is likeliest."""
        at, p = self._places[which], self._terms.moments.tangents
        common = self._by_itself.common[0, :, 0] - self._moved_by.common[0][:, at] @ amounts
        before = self._by_itself.before[0, :, :, 0] - self._moved_by.before[0][:, :, at] @ amounts
        before = before * self._terms.moments.moving
        sizes = int((at < self._sizes).sum())
        power: list[Samples] = []
        added: list[Samples] = []
        for i, (run, of_set) in enumerate(zip(self._likelihood.runs, self._of_set, strict=True)):
            own = of_set[:, len(common) + 1 :]
            left = of_set[:, len(common)] - of_set[:, : len(common)] @ common - own @ before[i, : own.shape[1]]
            mine = np.zeros_like(left)
            if run.changed:
                in_run = np.isin(at, here := self._here(i))
                of_group = self._of_run(i)[:, np.searchsorted(here, at[in_run])]
                mine = of_group[:, :sizes] @ amounts[:sizes]
                left = left - of_group @ amounts[in_run]
            for column, powers in ((left, power), (mine, added)):
                powers.append(run.products(column[:, None], column[:, None])[:, 0, 0])
            added[-1] = run.spread(added[-1])
        prior, off = self._terms.prior, common[:p] + internal(self._terms.entries) - self._terms.prior.centre
        farther = prior.precision @ (off**2 - (internal(self._terms.entries) - prior.centre) ** 2)
        squares = farther + common[p:] @ common[p:] + (before**2).sum() + amounts[sizes:] @ amounts[sizes:]
        return Residual(np.concatenate(power), np.concatenate(added), -0.5 * float(squares))
