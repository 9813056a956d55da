"""From which size an effect is expected to be named, stated before anything that the records show is used.

An effect of some size is taken to be all that the base lacks. What is left of it where it must be a fault of the base
in all records instead, or an effect that it is confused with, brings the log odds of as many coefficients as count,
beside the noise and what the base and the equation are expected to miss. Asked is the size at which these pay for a
name, at a shape such that half of the prior's shapes need less.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.error_rates import SURE
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.equation_misfit import SHARES, is_of_material, may_be_missed_um2, missed_um2
from phaselead.gap.posterior.levels import with_levels_about_their_sessions
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.priors import LARGEST, prior_of
from phaselead.gap.posterior.sets import confused
from phaselead.gap.posterior.shapes import Added, Products, Shapes
from phaselead.gap.regressors import RegressorGroup
from phaselead.record import Samples

ROUNDS = 8
"""At most, in which an effect and its rival are simulated at the size that was found."""
NEAR_ENOUGH = 1.25
"""Ratio of the sizes of two rounds that ends them."""
FURTHER = 10.0
"""Ratio of the next size to one at which nothing shows."""
TRIED = np.geomspace(1e-5, 1e3, 501)
"""Typical sizes."""
STRIDE = 20
"""Every which of these is tried first: a factor of 2.1."""
MOST_STATED = 10.0
"""Typical sizes beyond which nobody asks."""


def detectable(likelihood: Likelihood, shapes: Shapes, log_odds: float) -> dict[str, float]:
    """By effect the first size, in its unit, at which it is expected to be named; without those that this is beyond
    ``MOST_STATED`` typical ones. ``log_odds`` are asked against nothing, those of a name against each effect it
    is confused with."""
    effects = {group.effect.name: group.effect for group in shapes.groups}
    products, found = Products(likelihood, shapes), {}
    for name, effect in effects.items():
        rivals = [other for other, one in effects.items() if confused(effect, one)]
        size = _Expected(products, name).size(rivals, log_odds)
        if size <= MOST_STATED * effect.sizes[0].typical:
            found[name] = size
    return found


class _Expected:
    """What is expected of the records with one effect in them."""

    def __init__(self, products: Products, name: str) -> None:
        self._products, self._likelihood, self._name = products, products.likelihood, name
        self._last: tuple[float, Added] | None = None
        mine = products.shapes.of(name)
        self._of_material = bool(is_of_material([self._entry(self._group(name, 0), 1.0)])[0])
        likely = np.exp([prior_of([self._entry(self._group(name, i), 1.0)]).log_density for i in range(len(mine))])
        needed = np.array([self._times(self._products.first(name, i), [], [], 1.0) for i in range(len(mine))])
        order = np.argsort(needed)
        half = int(np.searchsorted(np.cumsum(likely[order]), 0.5 * likely.sum()))
        self._shape = int(order[min(half, len(mine) - 1)])

    def size(self, rivals: Sequence[str], log_odds: float) -> float:
        """In the effect's unit; infinite where no size that was tried shows it."""
        found = self._told(partial(self._alone, log_odds), 1.0, 0.0)
        for rival in rivals:
            found = self._told(partial(self._past, rival), found, found)
        return float(found * self._group(self._name, self._shape).steps[0])

    @staticmethod
    def _told(needed: Callable[[float], float], times: float, least: float) -> float:
        """The smallest multiple, ``least`` or more, at which the effect is told when it is simulated at that very one.

        ``needed`` says from one simulation which multiple is told, as if the effect grew in proportion from there. That
        fails where it sets in at a threshold, or differs from a rival by its square. So it is simulated again until
        both are within ``NEAR_ENOUGH``, in ``ROUNDS`` at most. Infinite only where simulations at ``MOST_STATED``
        typical sizes or more show nothing."""
        low, high, found = least, np.inf, np.inf
        for _ in range(ROUNDS):
            found = max(least, needed(times)) if np.isfinite(times) else times
            if (times >= MOST_STATED and not np.isfinite(found)) or 1 / NEAR_ENOUGH < found / times < NEAR_ENOUGH:
                return found
            low, high = (times, high) if found > times else (low, min(high, times))
            ahead = float(np.sqrt(times * min(found, FURTHER**2 * times)))
            times = ahead if low < ahead < high else float(np.sqrt(low * high))
        return high if np.isfinite(high) else found

    def _group(self, name: str, shape: int) -> RegressorGroup:
        """One of the shapes of an effect."""
        shapes = self._products.shapes
        return shapes.groups[shapes.of(name)[shape]]

    def _entry(self, group: RegressorGroup, times: float) -> SizedEffect:
        """So many times the first typical size of a group alone."""
        return group.entry(group.alone(0, times))

    def _mine(self, times: float) -> Added:
        """What so many times the first typical size adds, for one typical size; of the last size it is kept."""
        if self._last is None or self._last[0] != times:
            self._last = times, self._simulated(self._name, self._shape, times)
        return self._last[1]

    def _simulated(self, name: str, shape: int, times: float) -> Added:
        """The same of any effect in one of its shapes; any times as much where an effect is linear in its sizes. Beyond
        the range of a size the largest in it is simulated."""
        typical, group = self._products.first(name, shape), self._group(name, shape)
        if group.effect.basis is not None:
            return typical
        effect, params = entry = self._entry(group, times)
        simulated = params[effect.sizes[0].name] / group.steps[0]
        runs = zip(self._likelihood.runs, typical.of_runs, strict=True)
        found = [_added(run, entry) / simulated if run.changed and simulated else column for run, column in runs]
        return self._products.added(with_levels_about_their_sessions(self._likelihood.runs, found))

    @cached_property
    def _everywhere(self) -> Added:
        """The first size of the effect where the base lacks it in all records."""
        entry, found = self._entry(self._group(self._name, self._shape), 1.0), []
        for run, column in zip(
            self._likelihood.runs, self._products.first(self._name, self._shape).of_runs, strict=True
        ):
            found.append(column if run.changed else _added(run, entry))
        return self._products.added(with_levels_about_their_sessions(self._likelihood.runs, found))

    def _alone(self, log_odds: float, times: float) -> float:
        """The multiple from which it is told from nothing and from a fault of the base in all records, as far as it
        shows simulated at about this one."""
        column = self._mine(times)
        return self._times(column, [self._everywhere], [times], log_odds, priced=True)

    def _past(self, rival: str, times: float) -> float:
        """The same from a rival."""
        column, shapes = self._mine(times), self._products.shapes_of(rival)
        weights = 1 / self._without_um2
        squares = np.maximum(weights @ np.diagonal(shapes.own, axis1=1, axis2=2), 1e-300)
        alike = weights @ self._products.across(shapes, column)[:, :, 0]
        best = int(np.argmax(np.abs(alike) / np.sqrt(squares)))
        theirs = self._simulated(rival, best, times * float(alike[best] / squares[best]))
        others = [self._everywhere, theirs, *([shapes] if shapes.count > 1 else [])]
        deviations = [times, *[LARGEST] * (len(others) - 1)]
        return self._times(column, others, deviations, float(np.log(SURE / (1 - SURE))))

    @cached_property
    def _without_um2(self) -> Samples:
        """Variance of a block that counts as so many coefficients, as if it were one, without any effect."""
        likelihood = self._likelihood
        return np.asarray((likelihood.noise + likelihood.base) / likelihood.counted_beside(likelihood.base))

    def _moments(self, several: Sequence[Added]) -> Samples:
        """Mean products (blocks, k, k) of the likelihood's shared columns and, behind them, these."""
        among_shared = self._likelihood.among_shared
        ends = [among_shared.size, *(among_shared.size + np.cumsum([one.count for one in several])).tolist()]
        places = [slice(a, b) for a, b in pairwise(ends)]
        whole: Samples = np.empty((len(self._without_um2), ends[-1], ends[-1]))
        whole[:, : ends[0], : ends[0]] = among_shared.whole
        for i, (one, at) in enumerate(zip(several, places, strict=True)):
            beside = [one.beside_shared, *(self._products.across(other, one) for other in several[: i + 1])]
            above = np.concatenate(beside, axis=1)
            whole[:, : at.stop, at], whole[:, at, : at.stop] = above, above.transpose(0, 2, 1)
        return whole

    def _times(
        self,
        column: Added,
        others: Sequence[Added],
        deviations: Sequence[float],
        log_odds: float,
        priced: bool = False,
    ) -> float:
        """The multiple at which a column is expected to bring so many log odds past others, each of which may take
        one of these deviations, and, if ``priced``, what the prior of its size costs."""
        likelihood = self._likelihood
        moments = self._moments([*others, column])
        widths = [likelihood.among_shared.size, *(one.count for one in others)]
        precision = np.diag(np.repeat(np.array([1.0, *deviations], dtype=np.float64) ** -2, widths))
        # The others may also take all of it where it acts, and leave records without it as if these were outliers.
        left_um2 = []
        for weights in (1 / self._without_um2, likelihood.changed / self._without_um2):
            total = np.tensordot(weights, moments, 1)
            taken = np.linalg.solve(total[:-1, :-1] + precision, total[:-1, -1])
            less = np.append(-taken, 1.0)
            left_um2.append(np.maximum((moments @ less) @ less, 0.0))
        parts = np.split(moments[:, -1, -1], np.cumsum([len(run.sizes) for run in likelihood.runs])[:-1])
        power = np.concatenate([run.spread(part) for run, part in zip(likelihood.runs, parts, strict=True)])

        def told(times: Samples) -> NDArray[np.bool_]:
            squares = times[:, None] ** 2
            added = squares * power
            variance = likelihood.noise + likelihood.base + missed_um2(SHARES[0], added, added * self._of_material)
            n = likelihood.counted_beside(may_be_missed_um2(likelihood.base, added))
            enough = np.ones(len(times), dtype=bool)
            for one in left_um2:
                odds = 0.5 * (n * np.log1p(squares * one / variance)).sum(axis=1)
                information = (n * one / (likelihood.noise + likelihood.base)).sum(axis=1)
                enough &= odds >= log_odds + (0.5 * np.log(np.maximum(information, 1.0)) if priced else 0.0)
            return enough

        return _least(told)


def _least(told: Callable[[Samples], NDArray[np.bool_]]) -> float:
    """The least of the sizes tried at which something is told, as at all larger ones; infinite where there is none. Of
    few sizes first, and then of those below the first of these."""
    coarse = np.flatnonzero(told(TRIED[::STRIDE]))
    if not len(coarse):
        return np.inf
    end = int(coarse[0]) * STRIDE
    below = TRIED[max(end - STRIDE + 1, 0) : end]
    fine = np.flatnonzero(told(below))
    return float(below[fine[0]] if len(fine) else TRIED[end])


def _added(run: BlockedRun, entry: SizedEffect) -> Samples:
    """Coefficients (n, 1) of what an effect adds to the base."""
    return run.coefficients((run.modelled.answer([entry]) - run.modelled.answer())[:, None])
