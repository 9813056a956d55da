"""From which size an effect is expected to be named, stated before anything that the records show is used.

An effect of some size is taken to be all that the base lacks. What is left of it where it must be a fault of the base
in all records instead, or an effect that it is confused with, brings the log odds of as many coefficients as count,
beside the noise and what the base and the equation are expected to miss. Asked is the size at which these pay for a
name, at a shape such that half of the prior's shapes need less.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.error_rates import SURE
from phaselead.gap.parameters import SizedEffect, bounded
from phaselead.gap.posterior.blocks import BlockedRun, with_levels_about_their_sessions
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.missed import SHARES, is_of_material, may_be_missed_um2, missed_um2
from phaselead.gap.posterior.priors import LARGEST, prior_of
from phaselead.gap.posterior.sets import confused
from phaselead.gap.regressors import RegressorGroup, typical_sizes
from phaselead.record import Samples

ROUNDS = 8
"""At most, in which an effect and its rival are simulated at the size that was found."""
NEAR_ENOUGH = 1.25
"""Ratio of the sizes of two rounds that ends them."""
FURTHER = 10.0
"""Ratio of the next size to one at which nothing shows."""
TRIED = np.geomspace(1e-5, 1e3, 500)
"""Typical sizes."""
MOST_STATED = 10.0
"""Typical sizes beyond which nobody asks."""

Coefficients = Sequence[Samples]
"""Per run those (n, k) of k columns."""


@dataclass(frozen=True)
class Shapes:
    """Shapes of the effects of a catalogue."""

    groups: Sequence[RegressorGroup]
    columns: Sequence[NDArray[np.float32]]
    """Per run the coefficients (n, k) of every group, zeros of a reference."""

    def of(self, name: str) -> list[int]:
        """The groups of one effect at typical sizes."""
        named = [(i, group) for i, group in enumerate(self.groups) if group.effect.name == name]
        return [i for i, group in named if group.steps == typical_sizes(group.effect)]

    def first(self, index: int) -> Coefficients:
        """(n, 1) of the first size of a group."""
        at = sum(len(group.steps) for group in self.groups[:index])
        return [columns[:, [at]].astype(np.float64) for columns in self.columns]


def detectable(likelihood: Likelihood, shapes: Shapes, log_odds: float) -> dict[str, float]:
    """By effect the first size, in its unit, at which it is expected to be named; without those that this is beyond
    ``MOST_STATED`` typical ones. ``log_odds`` are asked against nothing, those of a name against each effect it
    is confused with."""
    effects = {group.effect.name: group.effect for group in shapes.groups}
    found = {}
    for name, effect in effects.items():
        rivals = [other for other, one in effects.items() if confused(effect, one)]
        size = _Expected(likelihood, shapes, name).size(rivals, log_odds)
        if size <= MOST_STATED * effect.sizes[0].typical:
            found[name] = size
    return found


class _Expected:
    """What is expected of the records with one effect in them."""

    def __init__(self, likelihood: Likelihood, shapes: Shapes, name: str) -> None:
        self._likelihood, self._shapes = likelihood, shapes
        # Of a block that counts as so many coefficients, as if it were one.
        self._without_um2 = (likelihood.noise + likelihood.base) / likelihood.counted_beside(likelihood.base)
        mine = shapes.of(name)
        self._of_material = bool(is_of_material([self._entry(mine[0], 1.0)])[0])
        likely = np.exp([prior_of([self._entry(i, 1.0)]).log_density for i in mine])
        needed = np.array([self._times(self._first(i), [], [], 1.0) for i in mine])
        order = np.argsort(needed)
        half = int(np.searchsorted(np.cumsum(likely[order]), 0.5 * likely.sum()))
        self._index = mine[order[min(half, len(mine) - 1)]]

    def size(self, rivals: Sequence[str], log_odds: float) -> float:
        """In the effect's unit; infinite where no size that was tried shows it."""
        found = self._told(partial(self._alone, log_odds), 1.0, 0.0)
        for rival in rivals:
            found = self._told(partial(self._past, rival), found, found)
        return float(found * self._shapes.groups[self._index].steps[0])

    @staticmethod
    def _told(needed: Callable[[float], float], times: float, least: float) -> float:
        """The multiple, ``least`` or more, at which an effect is told that is simulated at that multiple, from what is
        ``needed`` with one simulated at any: not in proportion where it sets in at a threshold, or differs from a
        rival by its square. Infinite only where one of ``MOST_STATED`` typical sizes, or more, is told at none."""
        low, high, found = least, np.inf, np.inf
        for _ in range(ROUNDS):
            found = max(least, needed(times)) if np.isfinite(times) else times
            if (times >= MOST_STATED and not np.isfinite(found)) or 1 / NEAR_ENOUGH < found / times < NEAR_ENOUGH:
                return found
            low, high = (times, high) if found > times else (low, min(high, times))
            ahead = float(np.sqrt(times * min(found, FURTHER**2 * times)))
            times = ahead if low < ahead < high else float(np.sqrt(low * high))
        return high if np.isfinite(high) else found

    def _entry(self, index: int, times: float) -> SizedEffect:
        """So many times the first typical size of a group alone."""
        group = self._shapes.groups[index]
        params = group.params([times, *np.zeros(len(group.steps) - 1).tolist()])
        return group.effect, bounded(group.effect, params)

    def _simulated(self, index: int, times: float) -> Coefficients:
        """What so many times the first typical size adds, for one typical size; any times as much where an effect is
        linear in its sizes. Beyond the range of a size the largest in it is simulated."""
        typical = self._first(index)
        if self._shapes.groups[index].effect.basis is not None:
            return typical
        runs = zip(self._likelihood.runs, typical, strict=True)
        effect, params = entry = self._entry(index, times)
        simulated = params[effect.sizes[0].name] / self._shapes.groups[index].steps[0]
        found = [_added(run, entry) / simulated if run.changed and simulated else column for run, column in runs]
        return with_levels_about_their_sessions(self._likelihood.runs, found)

    @cached_property
    def _first(self) -> Callable[[int], Coefficients]:
        """The first size of a group, worked out once."""
        return cache(self._shapes.first)

    @cached_property
    def _everywhere(self) -> Coefficients:
        """The first size of the effect where the base lacks it in all records."""
        entry, found = self._entry(self._index, 1.0), []
        for run, column in zip(self._likelihood.runs, self._first(self._index), strict=True):
            found.append(column if run.changed else _added(run, entry))
        return with_levels_about_their_sessions(self._likelihood.runs, found)

    def _alone(self, log_odds: float, times: float) -> float:
        """The multiple from which it is told from nothing and from a fault of the base in all records, as far as it
        shows simulated at about this one."""
        column = self._simulated(self._index, times)
        return self._times(column, [self._everywhere], [times], log_odds, priced=True)

    def _past(self, rival: str, times: float) -> float:
        """The same from a rival."""
        column, theirs = self._simulated(self._index, times), self._shapes.of(rival)
        columns = [self._first(i) for i in theirs]
        best = int(np.argmax([self._along(one, column) for one in columns]))
        amount = times * self._matched(columns[best], column)
        others = [self._everywhere, self._simulated(theirs[best], amount), *(columns if len(columns) > 1 else [])]
        deviations = [times, *[LARGEST] * (len(others) - 1)]
        return self._times(column, others, deviations, float(np.log(SURE / (1 - SURE))))

    def _moments(self, columns: Sequence[Coefficients]) -> Samples:
        """Mean products (blocks, k, k)."""
        parts = zip(self._likelihood.runs, _side_by_side(columns), strict=True)
        return np.concatenate([run.products(one, one) for run, one in parts])

    def _moments_beside_shared(self, columns: Sequence[Coefficients]) -> Samples:
        """The same of the likelihood's shared columns and, behind them, these."""
        likelihood, own = self._likelihood, self._moments(columns)
        parts = zip(likelihood.runs, likelihood.shared, _side_by_side(columns), strict=True)
        across = np.concatenate([run.products(shared, one) for run, shared, one in parts])
        k = likelihood.among_shared.size
        whole: Samples = np.empty((len(own), k + own.shape[1], k + own.shape[1]))
        whole[:, :k, :k], whole[:, k:, k:] = likelihood.among_shared.whole, own
        whole[:, :k, k:], whole[:, k:, :k] = across, across.transpose(0, 2, 1)
        return whole

    def _matched(self, rival: Coefficients, column: Coefficients) -> float:
        """The amount of a rival's column that is nearest to another."""
        total = np.tensordot(1 / self._without_um2, self._moments([rival, column]), 1)
        return float(total[0, 1] / max(total[0, 0], 1e-300))

    def _along(self, rival: Coefficients, column: Coefficients) -> float:
        """Correlation of a rival's column with another."""
        total = np.tensordot(1 / self._without_um2, self._moments([rival, column]), 1)
        return float(abs(total[0, 1]) / np.sqrt(max(total[0, 0] * total[1, 1], 1e-300)))

    def _times(
        self,
        column: Coefficients,
        others: Sequence[Coefficients],
        deviations: Sequence[float],
        log_odds: float,
        priced: bool = False,
    ) -> float:
        """The multiple at which a column is expected to bring so many log odds past others, each of which may take
        one of these deviations, and, if ``priced``, what the prior of its size costs."""
        likelihood = self._likelihood
        moments = self._moments_beside_shared([*others, column])
        total = np.tensordot(1 / self._without_um2, moments, 1)
        widths, deviations = [one[0].shape[1] for one in (likelihood.shared, *others)], [1.0, *deviations]
        precision = np.diag(np.repeat(np.array(deviations, dtype=np.float64) ** -2, widths))
        taken = np.linalg.solve(total[:-1, :-1] + precision, total[:-1, -1])
        # The others may also take all of it where it acts, and leave records without it as if these were outliers.
        acting = np.tensordot(likelihood.changed / self._without_um2, moments, 1)
        all_taken = np.linalg.solve(acting[:-1, :-1] + precision, acting[:-1, -1])
        parts = np.split(moments[:, -1, -1], np.cumsum([len(run.sizes) for run in likelihood.runs])[:-1])
        power = np.concatenate([run.spread(part) for run, part in zip(likelihood.runs, parts, strict=True)])
        squares = TRIED[:, None] ** 2
        added = squares * power
        variance = likelihood.noise + likelihood.base + missed_um2(SHARES[0], added, added * self._of_material)
        n = likelihood.counted_beside(may_be_missed_um2(likelihood.base, added))
        needed = 0.0
        for amounts in (taken, all_taken):
            past = np.append(-amounts, 1.0)
            left = np.maximum((moments @ past) @ past, 0.0)
            odds = 0.5 * (n * np.log1p(squares * left / variance)).sum(axis=1)
            information = (n * left / (likelihood.noise + likelihood.base)).sum(axis=1)
            asked = log_odds + (0.5 * np.log(np.maximum(information, 1.0)) if priced else 0.0)
            enough = np.flatnonzero(odds >= asked)
            needed = max(needed, float(TRIED[enough[0]]) if len(enough) else np.inf)
        return needed


def _side_by_side(columns: Sequence[Coefficients]) -> list[Samples]:
    """Per run those (n, k) of all of several."""
    return [np.concatenate(of_run, axis=1) for of_run in zip(*columns, strict=True)]


def _added(run: BlockedRun, entry: SizedEffect) -> Samples:
    """Coefficients (n, 1) of what an effect adds to the base."""
    return run.coefficients((run.modelled.answer([entry]) - run.modelled.answer())[:, None])
