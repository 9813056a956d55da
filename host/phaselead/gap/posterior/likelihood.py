"""Sets of effects beside one base: what each does in the records, how well it is fitted, and its evidence.

How likely records are in which a set leaves so much is in ``density``, and in ``shared_misfit`` what all sets may miss
alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from phaselead.gap.history import SMALL_AMOUNT, STANDING, Stood, amounts_stood, stands_off, stood_of
from phaselead.gap.parameters import SizedEffect, entries_at, internal, is_logarithmic, parameters_of
from phaselead.gap.posterior.blocks import Simulated
from phaselead.gap.posterior.density import ANYWHERE_UM2, LEAST_GAIN, SETTLED
from phaselead.gap.posterior.equation_misfit import MOST_MISSED, is_of_material, log_prior_of_share, shares_of
from phaselead.gap.posterior.levels import about_their_sessions, with_levels_about_their_sessions
from phaselead.gap.posterior.moments import Moments
from phaselead.gap.posterior.priors import Prior, prior_of
from phaselead.gap.posterior.sets import Begun, Fit, Terms
from phaselead.gap.posterior.shared_misfit import WithSharedMisfit
from phaselead.gap.posterior.still_moving import likeliest_moving, log_sum_over_records
from phaselead.record import Samples

STEPS, DAMPINGS = 8, 5
"""Of a fit at most, and how many dampings a step tries."""
NEGLIGIBLE = 1e-3
"""Probability of a share below which it does not widen an interval."""


@dataclass
class Likelihood(WithSharedMisfit):
    """Of sets of effects beside one base."""

    def terms(
        self, entries: Sequence[SizedEffect], moving: Samples | None = None, stood: Sequence[Stood] = ()
    ) -> Terms:
        """A set of effects at its parameters. ``moving`` (runs, b): 1 for what still goes on in a record of what had
        been done before, by default all. ``stood``: by run what had stood off as a voltage, by default nothing."""
        names = {effect.name for effect, _ in entries}
        stood = tuple({name: one for name, one in of_run.items() if name in names} for of_run in stood)
        stood = stood or ({},) * len(self.runs)
        found = [run.simulated(entries, of_run) for run, of_run in zip(self.runs, stood, strict=True)]
        of_effects = self._added_um2(found)
        material = of_effects[is_of_material(entries)].sum(axis=0)
        moved_before = np.concatenate([one.moved_before for one in found])
        moments = self._moments(found)
        moments = moments if moving is None else moments.where_moving(moving)
        of_all = of_effects.sum(axis=0)
        of = tuple(one.of_effects for one in found)
        return Terms(tuple(entries), moments, of_all, material, moved_before, prior_of(entries), stood, of)

    def simulated(self, terms: Terms) -> list[Simulated]:
        """What a set of effects does in each run."""
        return [run.simulated(terms.entries, stood) for run, stood in zip(self.runs, terms.stood, strict=True)]

    def _moments(self, found: Sequence[Simulated]) -> Moments:
        """Of tangents, of what is integrated out, and of the residual."""
        width = max(one.columns.shape[1] for one in found)
        own = np.zeros((self._blocks[-1], width, width))
        across = np.zeros((self._blocks[-1], width, self.among_shared.size))
        firsts = self.first_rows(found)
        parts = zip(self.runs, self.shared, found, firsts, pairwise(self._blocks), strict=True)
        for run, shared, one, first, (a, b) in parts:
            none = width - one.columns.shape[1]
            own[a:b, none:, none:] = run.products(one.columns, one.columns)
            across[a:b, none:] = run.products(one.columns, shared)
            if run.levelled:
                own[a, none:, none:] = np.outer(first, first)
                across[a, none:] = np.outer(first, shared[0])
        p = max(one.tangents for one in found)
        moving = np.ones((len(found), width - 1 - p))
        return Moments(own, across, self.among_shared, self._blocks, p, moving)

    def first_rows(self, found: Sequence[Simulated]) -> list[Samples]:
        """The first row (k,) of the columns in each run, levels about their mean in the session."""
        return about_their_sessions(self.runs, [one.columns[0] for one in found])

    def _near(self, terms: Terms, entries: tuple[SizedEffect, ...]) -> Terms:
        """A set at parameters near those of ``terms``, without tangents, for their likelihood alone."""
        own: Samples = np.zeros(terms.moments.integrated.own.shape[:2])
        across = np.zeros((self._blocks[-1], self.among_shared.size))
        found = self.simulated(terms)
        there = [one.before @ amounts_stood(entries, one.of_effects, stood)[:, None]
                 for one, stood in zip(found, terms.stood, strict=True)]  # fmt: skip
        each = [run.error(entries, stood) + more
                for run, stood, more in zip(self.runs, terms.stood, there, strict=True)]  # fmt: skip
        lefts = with_levels_about_their_sessions(self.runs, each)
        parts = zip(self.runs, self.shared, found, lefts, pairwise(self._blocks), strict=True)
        for run, shared, one, left, (a, b) in parts:
            mine = np.concatenate([one.before, left], axis=1)
            own[a:b, own.shape[1] - mine.shape[1] :] = run.products(left, mine)[:, 0]
            across[a:b] = run.products(left, shared)[:, 0]
        of_records = np.repeat(terms.moments.moving, np.diff(self._blocks), axis=0)
        own[:, :-1] *= of_records
        moments = terms.moments.with_residual(own, across)
        prior = prior_of(entries)
        none = Prior(prior.log_density, np.zeros(0), np.zeros(0))
        return replace(terms, entries=entries, moments=moments, prior=none, levels_say=True, settled={})

    def held_out_log_density(self, entries: Sequence[SizedEffect]) -> float:
        """Of the held-out records as effects at their parameters predict them, levels and all."""
        each = [run.coefficients(run.modelled.error(entries if run.changed else ())[:, None]) for run in self.runs]
        lefts = with_levels_about_their_sessions(self.runs, each)
        pairs = zip(self.runs, lefts, strict=True)
        power = np.concatenate([run.products(left, left)[:, 0, 0] for run, left in pairs])[None]
        variance = self._without_effects[None]
        return (self.log_density(power, variance) - self.log_density(power, variance, held_out=False)).item()

    def _covariances(self, terms: Terms, shares: Sequence[float]) -> Samples:
        """(s, p + k, p + k) of the parameters in internal units, and of the amounts of the shared columns."""
        independent = self.independent(terms, shares, terms.signal)
        normal, _ = self.information(terms, shares, independent=independent)
        return np.asarray(np.linalg.inv(normal.reduced))

    def fit(
        self, start: Sequence[SizedEffect] | Begun | Terms, steps: int = STEPS, least_gain: float = LEAST_GAIN
    ) -> Fit:
        """The most likely parameters near those of ``start``, which may be terms of this likelihood; ``least_gain`` in
        log units ends the search for them."""
        begun = self._begun(start)
        moving = begun.moments.moving
        if not moving.size:
            return self.judged(*self.fitted_terms(begun, steps, least_gain=least_gain)[:2])
        # Begun where what had been done before goes on as in the start, and where it is over in all records; then it
        # goes on in those that bear it out. Both beginnings may lead to the same, and which of them does better may be
        # known from another fit.
        known = isinstance(start, Begun) and start.moving_found
        found: dict[bytes, Fit] = {}
        for goes_on in (moving, *([] if known else [np.zeros_like(moving)])):
            terms, share, _ = self.fitted_terms(begun.where_moving(goes_on), steps, least_gain=least_gain)
            chosen, _ = self._moving(terms, share)
            if chosen.tobytes() in found:
                continue
            if not np.array_equal(chosen, goes_on):
                terms, share, _ = self.fitted_terms(terms.where_moving(chosen), steps, least_gain=least_gain)
            found[chosen.tobytes()] = self.judged(terms, share)
        return max(found.values(), key=lambda fit: fit.log_evidence)

    def fitted_terms(
        self,
        start: Sequence[SizedEffect] | Begun | Terms,
        steps: int = STEPS,
        rounds: int = STANDING,
        least_gain: float = LEAST_GAIN,
    ) -> tuple[Terms, float, float]:
        """A set at its most likely parameters near those of ``start``, the share there and the log density.
        ``rounds``: in which what had stood off is found beside itself, at most."""
        terms = self._begun(start)
        terms, share, best = self._beside_what_stood(terms, *self.likeliest_share(terms), rounds)
        damping = 1e-3
        for _ in range(steps if terms.entries else 0):
            information, slope = self.information(terms, [share])
            gained = 0.0
            for _ in range(DAMPINGS):
                step = information.damped(damping).solve(slope)
                if slope.along(step).item() / 2 < least_gain:  # what it would gain were all normal
                    break
                near = self._near(terms, _moved(terms.entries, step.common[0, :, 0]))
                gained = self._log_joints(near, [share])[share] - best
                if gained > 0:
                    terms, share, best = self._stepped(near, share, best)
                    damping = max(damping / 5, 1e-6)
                    break
                damping = max(damping, 1e-3) * 10
            if gained < least_gain:
                break
        return terms, share, best

    def _begun(self, start: Sequence[SizedEffect] | Begun | Terms) -> Terms:
        if isinstance(start, Terms):
            return start
        begun = start if isinstance(start, Begun) else Begun(start)
        terms = self.terms(begun.entries, begun.moving, begun.stood)
        if not begun.last_is_over:
            return terms
        return terms.where_moving(terms.moments.moving * (terms.of_columns != len(begun.entries) - 1))

    def _stepped(self, near: Terms, share: float, best: float) -> tuple[Terms, float, float]:
        """The set at the parameters of ``near``, beside what most likely had stood off then, the share and the log
        density; beside what had stood off before the step where that loses what the step gained."""
        stood, _ = self._likeliest_stood(near, share)
        way = []
        for one in (stood, near.stood):
            terms = self.terms(near.entries, near.moments.moving, one)
            way.append((terms, *self.likeliest_share(terms, share)))
            if way[-1][2] > best or one is near.stood:
                break
        return max(way, key=lambda one: one[2])

    def _likeliest_stood(self, terms: Terms, share: float) -> tuple[tuple[Stood, ...], float]:
        """For each run the voltages that most likely had stood off before it, by one linear step from the present
        guess, and the largest change of that guess in prior deviations: none below ``SETTLED``. The weights are those
        of records that are explained in full: one explained in part would count as an outlier."""
        if not any(stands_off(effect) for effect, _ in terms.entries):
            return terms.stood, 0.0
        amounts = self.explaining(terms, share).before[0, :, :, 0]
        stood = tuple(stood_of(terms.entries, mine, one[: len(mine)])
                      for mine, one in zip(terms.of_effects, amounts, strict=True))  # fmt: skip
        moved = [amounts_stood(terms.entries, mine, now) - amounts_stood(terms.entries, mine, then)
                 for mine, now, then in zip(terms.of_effects, stood, terms.stood, strict=True)]  # fmt: skip
        farthest = float(np.abs(np.concatenate(moved)).max(initial=0.0))
        return (terms.stood, 0.0) if farthest < SETTLED else (stood, farthest)

    def _beside_what_stood(self, terms: Terms, share: float, best: float, rounds: int) -> tuple[Terms, float, float]:
        """The set beside what most likely had stood off before each record as a voltage, the share and the log density
        then: much of it does not do in proportion what a little does. Where it does not settle, the likeliest on the
        way counts."""
        way = [(terms, share, best)]
        for _ in range(rounds):
            stood, farthest = self._likeliest_stood(terms, share)
            if stood is terms.stood:
                return way[-1]
            terms = self.terms(terms.entries, terms.moments.moving, stood)
            share, best = self.likeliest_share(terms, share)
            way.append((terms, share, best))
            if farthest < SMALL_AMOUNT:  # so little more does in proportion what it does
                return way[-1]
        return max(way, key=lambda one: one[2])

    def judged(self, terms: Terms, share: float) -> Fit:
        """Evidence and covariance of a set at its most likely parameters."""
        grid = shares_of(terms.entries)
        prior = np.array([log_prior_of_share(terms.entries, one) for one in grid])
        _, ratios = self._moving(terms, share)
        held = {i for i, run in enumerate(self.runs) if run.modelled.run.role == "holdout"}
        of_all = sum(log_sum_over_records(list(of_runs.values())) for of_runs in ratios)
        of_fitted = sum(log_sum_over_records([r for i, r in of_runs.items() if i not in held]) for of_runs in ratios)
        every = prior + self._log_evidence(terms, grid, held_out=True) + of_all
        fitted = prior + self._log_evidence(terms, grid, held_out=False) + of_fitted
        likely = np.exp(every - every.max())
        named = float(likely[[share <= MOST_MISSED for share in grid]].sum() / likely.sum())
        kept = np.flatnonzero(likely / likely.sum() > NEGLIGIBLE)
        joint = np.tensordot(likely[kept] / likely.sum(), self._covariances(terms, [grid[i] for i in kept]), 1)
        levels = [self._log_levels(terms, share, held_out) for held_out in (True, False)]
        return Fit(terms, _log_sum(every), _log_sum(fitted), named, share, joint, *levels)

    def _log_levels(self, terms: Terms, share: float, held_out: bool) -> float:
        """What the levels bring to the log evidence of a set, the price that its parameters pay for them included."""
        mine = self._is_level & (held_out | self.fitted)
        if not mine.any():
            return 0.0
        without = replace(terms, levels_say=False, settled={})
        none = np.full((1, 1, len(mine)), ANYWHERE_UM2)
        of_anywhere = float(self._log_densities(np.zeros((1, len(mine))), none)[0, 0] @ mine)
        pair = (self._log_evidence(one, [share], held_out).item() for one in (terms, without))
        return next(pair) - next(pair) + of_anywhere

    def _moving(self, terms: Terms, share: float) -> tuple[Samples, list[dict[int, float]]]:
        """Which columns (runs, b) of the records most likely go on, beside the set as it is; and for each of its slow
        effects, by run, the log evidence of that above its being over."""
        moving, ratios = terms.moments.moving.copy(), [dict[int, float]() for _ in terms.entries]
        if not moving.size:
            return moving, []
        at = self.settled(terms, [share])
        every = (terms.moments.all_moving or terms.moments).integrated
        normal, right = every.normal(self.weights(at.power, at.variance), np.zeros(0))
        slopes = right.before[0, :, :, 0] - (normal.beside[0] @ at.amounts.common[0])[:, :, 0]
        for i, of_effects in enumerate(one.of_effects for one in self.simulated(terms)):
            if of_effects:
                information = normal.before[0, i] - np.eye(len(of_effects))
                moving[i], of_run = likeliest_moving(information, slopes[i], of_effects)
                for effect, ratio in of_run.items():
                    ratios[effect][i] = ratio
        return moving, [of_runs for of_runs in ratios if of_runs]

    def _log_evidence(self, terms: Terms, shares: Sequence[float], held_out: bool) -> Samples:
        normal, _ = self.information(terms, shares, held_out)
        volume = 0.5 * (len(terms.prior.centre) * np.log(2 * np.pi) - normal.log_determinant)
        return np.asarray(self.log_joint(terms, shares, held_out) + volume)


def _log_sum(logs: Samples) -> float:
    return float(logs.max() + np.log(np.sum(np.exp(logs - logs.max()))))


def _moved(entries: Sequence[SizedEffect], step: Samples) -> tuple[SizedEffect, ...]:
    """The entries after a step, at most a factor e in what is logarithmic."""
    logarithmic = [is_logarithmic(p) for _, p in parameters_of(entries)]
    own = step[: len(logarithmic)]  # behind them comes what is integrated out
    limited = np.where(logarithmic, np.clip(own, -1.0, 1.0), own)
    return entries_at(entries, internal(entries) + limited)
