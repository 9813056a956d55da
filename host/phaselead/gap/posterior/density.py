"""How likely records are in which a set of effects leaves so much, octave by octave.

In each block the residual's coefficients are normal of a variance

    v = noise + kappa^2 (base + share * before) + sum_j rho_j^2 signal_j

with ``base`` what the base is expected to leave, a share of its motion (``noise_and_base_share``), ``before`` how what
a set had done before a record moves it as a voltage, and ``signal_j`` the power of what effect j adds: no stage obeys
an equation exactly, and what the equation of an effect misses is a share rho of it, one for all effects but never less
than what is left by the best equations of a material. What the base misses differs from record to record, by kappa.
Both are unknown and summed over. What a model misses is smooth, so that all coefficients of a block say it once, where
noise says something new in each: ``counted`` says as how many a block counts. Where few told the variance, Student's t
takes the place of the normal distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, logsumexp, softmax

from phaselead.gap.parameters import internal
from phaselead.gap.posterior.blocks import OF_LEVEL, BlockedRun
from phaselead.gap.posterior.equation_misfit import (
    TIMES_BASE,
    beside_one_another,
    log_prior_of_share,
    may_be_missed_um2,
    missed_um2,
    shares_of,
)
from phaselead.gap.posterior.moments import Amounts, Normal, together
from phaselead.gap.posterior.noise_and_base_share import NoiseAndBaseShare
from phaselead.gap.posterior.sets import Settled, Terms, has_history
from phaselead.record import Samples

SETTLING, SETTLED = 30, 0.01
"""Steps at most in which what is integrated out settles, and the change in prior deviations that ends them."""
LEAST_GAIN = 0.05
"""In log units, that ends a search."""
ANYWHERE_UM2 = 1e12
"""Variance of levels that say nothing, (1 m)^2."""


@dataclass
class Density:
    """Of records beside one base."""

    runs: tuple[BlockedRun, ...]
    expected: NoiseAndBaseShare

    def __post_init__(self) -> None:
        parts = [self.expected.of(run, run.motion) for run in self.runs]
        self.noise, self.base, self.told = (np.concatenate(of) for of in zip(*parts, strict=True))
        self.base_share = np.concatenate([self.expected.base_share_of(run) for run in self.runs])
        held = [np.full(len(run.sizes), run.modelled.run.role == "holdout") for run in self.runs]
        self.fitted = ~np.concatenate(held)
        self.changed = np.concatenate([np.full(len(run.sizes), run.changed) for run in self.runs])
        self._octaves = np.concatenate([run.octaves for run in self.runs])
        self._is_level = self._octaves == OF_LEVEL
        self._in_octave = (self._octaves[:, None] == np.unique(self._octaves)).astype(float)
        self._blocks = [0, *np.cumsum([len(run.sizes) for run in self.runs]).tolist()]
        self._sizes = np.concatenate([run.sizes for run in self.runs])
        # What the equations may miss of whatever is there, the same for all sets: they are compared on the same data.
        left = np.concatenate([run.spread(run.base_left_um2) for run in self.runs])
        gap = np.where(self.changed, np.maximum(left - self.noise - self.base, 0.0), 0.0)
        self.counted = self.counted_beside(may_be_missed_um2(self.base, gap))

    def counted_beside(self, missed: Samples) -> Samples:
        """As how many coefficients (..., blocks) a block counts beside the noise and something missed of this power."""
        return self.expected.counted(self._octaves, self._sizes, self.noise, missed)

    @property
    def step_s(self) -> float:
        """Between rows of the first record."""
        return self.runs[0].modelled.run.step_s

    def variance(self, terms: Terms, shares: Sequence[float]) -> Samples:
        """v (s, k, blocks) in um^2, for each multiple of what the base misses in a record."""
        missed = missed_um2(np.array(shares)[:, None], terms.signal, terms.of_material)
        moved_before = np.array(TIMES_BASE)[:, None] ** 2 * self.base_share * terms.moved_before
        found = np.asarray(self._without_effects + moved_before + missed[:, None])
        if has_history(terms.entries) or not terms.levels_say:
            found[..., self._is_level] = ANYWHERE_UM2
        return found

    @cached_property
    def _without_effects(self) -> Samples:
        """v (k, blocks) in um^2 of noise and base alone, for each multiple of what the base misses in a record."""
        return np.asarray(self.noise + np.array(TIMES_BASE)[:, None] ** 2 * self.base)

    def _log_densities(self, power: Samples, variance: Samples) -> Samples:
        """(s, k, blocks) of the residual's power (s, blocks), as many coefficients of each block as count."""
        t, n = self.told, self.counted
        one = gammaln((t + n) / 2) - gammaln(t / 2) - n / 2 * np.log(t * np.pi * variance)
        return np.asarray(one - (t + n) / 2 * np.log1p(n * power[:, None] / (t * variance)))

    def _of_records(self, power: Samples, variance: Samples, held_out: bool) -> Samples:
        """Log density (s, k, records) of the residual's power (s, blocks); 0 of the held-out records without
        ``held_out``."""
        each = np.where(held_out | self.fitted, self._log_densities(power, variance), 0.0)
        return np.asarray(np.add.reduceat(each, self._blocks[:-1], axis=-1))

    def log_density(self, power: Samples, variance: Samples, held_out: bool = True) -> Samples:
        """(s,) of the residual's power (s, blocks)."""
        of_records = self._of_records(power, variance, held_out)
        return np.asarray(np.sum(logsumexp(of_records, axis=1) - np.log(len(TIMES_BASE)), axis=-1))

    def weights(self, power: Samples, variance: Samples, held_out: bool = True) -> Samples:
        """By which squares (s, blocks) count near a residual of this power."""
        t, n = self.told, self.counted
        of_records = softmax(self._of_records(power, variance, held_out), axis=1)
        likely = np.repeat(of_records, np.diff(self._blocks), axis=-1)
        each = n * (t + n) / (t * variance + n * power[:, None])
        return np.where(held_out | self.fitted, np.sum(likely * each, axis=1), 0.0)

    def settled(self, terms: Terms, shares: Sequence[float], held_out: bool = True) -> Settled:
        """Where what is integrated out is most likely."""
        keys = [(one, held_out) for one in shares]
        missing = [key for key in keys if key not in terms.settled]
        if missing:
            found = self._settled(terms, [one for one, _ in missing], held_out)
            terms.settled.update({key: found[i] for i, key in enumerate(missing)})
        parts = [terms.settled[key] for key in keys]
        power, variance = (np.concatenate(of) for of in zip(*((one.power, one.variance) for one in parts), strict=True))
        return Settled(together([one.amounts for one in parts]), power, variance)

    def _settled(self, terms: Terms, shares: Sequence[float], held_out: bool) -> Settled:
        """Iterated. The weights of the first step are those of a zero residual: from the real one, records that these
        amounts would explain would first count as outliers. Where the end is less likely than no amounts at all, the
        iteration starts again from the real residual."""
        none = terms.moments.integrated.none(len(shares))
        variance = self.variance(terms, shares)
        found = self._settled_from(np.zeros_like(variance[:, 0]), terms, variance, held_out)
        nothing = Settled(none, terms.moments.integrated.power(none), variance)
        worse = np.flatnonzero(self._log_settled(found, held_out) < self._log_settled(nothing, held_out) - LEAST_GAIN)
        if len(worse):
            again = self._settled_from(nothing.power[worse], terms, variance[worse], held_out)
            found.amounts.put(worse, again.amounts)
            found.power[worse] = again.power
        return found

    def explaining(self, terms: Terms, share: float) -> Amounts:
        """The likeliest amounts of what is integrated out if it explained everything, so that no record is an
        outlier."""
        variance = self.variance(terms, [share])
        normal, right = terms.moments.integrated.normal(
            self.weights(np.zeros_like(variance[:, 0]), variance), np.zeros(0)
        )
        return normal.solve(right)

    def _log_settled(self, at: Settled, held_out: bool) -> Samples:
        """Log density (s,) of the records and of what is integrated out, but for what all have in common."""
        squares = at.amounts.along(at.amounts)[:, 0, 0]
        return np.asarray(self.log_density(at.power, at.variance, held_out) - 0.5 * squares)

    def _settled_from(self, power: Samples, terms: Terms, variance: Samples, held_out: bool) -> Settled:
        """Where it settles from a power (s, blocks) of what is left."""
        moments = terms.moments.integrated
        amounts, unsettled = moments.none(len(power)), np.arange(len(power) if moments.columns else 0)
        for _ in range(SETTLING):
            if not len(unsettled):
                break
            w = self.weights(power[unsettled], variance[unsettled], held_out)
            normal, right = moments.normal(w, np.zeros(0))
            found = normal.solve(right)
            moved = (found - amounts[unsettled]).largest()
            amounts.put(unsettled, found)
            was, power[unsettled] = power[unsettled], moments.power(found)
            # A deviation of a zero is many of a level: by how far that moves tells nothing of how likely levels are.
            changed = np.abs(power[unsettled] - was)[:, self._is_level] / variance[unsettled, 0][:, self._is_level]
            unsettled = unsettled[(moved >= SETTLED) | (changed.max(axis=1, initial=0.0) / 2 >= LEAST_GAIN)]
        return Settled(amounts, moments.power(amounts), variance)

    def log_joint(self, terms: Terms, shares: Sequence[float], held_out: bool = True) -> Samples:
        """Log density (s,) of the records, the held-out ones or not, and of all parameters."""
        at = self.settled(terms, shares, held_out)
        return np.asarray(self._log_settled(at, held_out) + terms.prior.log_density)

    def information(
        self, terms: Terms, shares: Sequence[float], held_out: bool = True, independent: Samples | float = 1.0
    ) -> tuple[Normal, Amounts]:
        """Of the parameters and of what is integrated out, by the records and the priors together, and the slope of the
        log density. Of what a block says only the share ``independent`` (s, blocks) counts."""
        at = self.settled(terms, shares, held_out)
        w = independent * self.weights(at.power, at.variance, held_out)
        normal, right = terms.moments.normal(w, terms.prior.precision)
        p = len(terms.prior.centre)
        slope = right - normal.times(at.amounts.behind(p))
        off = terms.prior.precision * (internal(terms.entries) - terms.prior.centre)
        slope.common[:, :p, 0] -= off
        return normal, slope

    def independent(self, terms: Terms, shares: Sequence[float], signal: Samples) -> Samples:
        """Share (s, blocks) of what a block says of the size of something with this power (blocks,) that other records
        do not say too. What the base and the equations miss is the stage's, and the same in every record: an octave
        tells a size past it once, however many records there are. A level tells a size of what moves the zero, in
        each record: that of others depends on a past that nobody knows."""
        at = self.settled(terms, shares)
        variance = 1 / self.weights(at.power, at.variance)
        told = signal / variance
        of_octave = (told @ self._in_octave) ** 2 / np.maximum(told**2 @ self._in_octave, 1e-300)
        records = np.maximum(of_octave, 1.0) @ self._in_octave.T
        noise = self.noise / self.counted_beside(np.zeros_like(self.noise))
        told_once = variance / (noise + records * np.maximum(variance - noise, 0.0))
        moves_zero = any(effect.moves_zero is not None for effect, _ in terms.entries)
        return np.where(self._is_level, float(moves_zero), told_once)

    def likeliest_share(self, terms: Terms, near: float | None = None) -> tuple[float, float]:
        """The most likely share and the log density there: of all, or by steps from that of a set like it."""
        grid = shares_of(terms.entries)
        found = self._log_joints(terms, grid if near is None else [near])
        while near is not None:
            best = max(found, key=lambda one: found[one])
            found |= self._log_joints(
                terms, [one for one in grid if one not in found and beside_one_another(one, best)]
            )
            if max(found, key=lambda one: found[one]) == best:
                break
        return max(found.items(), key=lambda one: (one[1], one[0]))

    def _log_joints(self, terms: Terms, shares: Sequence[float]) -> dict[float, float]:
        """Log density of the records, of all parameters and of the share, under each of these."""
        if not shares:
            return {}
        found = self.log_joint(terms, shares).tolist()
        return {one: log + log_prior_of_share(terms.entries, one) for one, log in zip(shares, found, strict=True)}
