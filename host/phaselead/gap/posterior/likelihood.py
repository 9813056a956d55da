"""How likely the records are under a set of effects, and how surely they tell its parameters.

In each block the residual's coefficients are normal of a variance

    v = noise + kappa^2 base + sum_j rho_j^2 signal_j

with ``base`` what the base is expected to leave (``expected``) and ``signal_j`` the power of what effect j adds: no
stage obeys an equation exactly, and what the equation of an effect misses is a share rho of it, one for all effects
but never less than what is left by the best equations of a material. Both shares are unknown and summed over. What a
model misses is smooth, so that all coefficients of a block say it once: they count as one. Where ``base`` was told by
few records, Student's t takes the place of the normal distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from phaselead.gap.posterior.before import as_fault, before_record
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.expected import Expected
from phaselead.gap.posterior.priors import Prior, prior_of
from phaselead.gap.refit import (
    SizedEffect,
    bounded,
    fresh_columns,
    from_internal,
    internal,
    is_logarithmic,
    parameters_of,
    to_internal,
)
from phaselead.model import Effect, Place
from phaselead.record import Samples

SHARES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0)
"""Of an effect that its equation may miss."""
LEAST_OF_MATERIAL = 0.05
"""Share that is missed at least by an equation of the ceramic itself, of its loops and its creep: published operators,
fitted to one stage, leave 1 to 3 % of the travel where loops are 10 to 20 % of it (Ge and Jouaneh 1995, Kuhnen
2003)."""
MOST_MISSED = 0.3
"""Share of an effect that may be missed by an equation which still bears its name: it then describes nine tenths of its
power."""
OUTSIDE = 0.1
"""Prior probability that more is missed: that the effect is none of the catalogue, and this one only the nearest."""
LIKE_RIVALS = 0.1
"""Share of an effect that its equation may miss and that looks like another which the catalogue says it is confused
with: published models of hysteresis, creep and modes leave 2 to 20 % of what they describe."""
TIMES_BASE = (1.0, 2.0, 4.0)
"""How much more than in the reference records the base may miss: all as likely."""
STEPS, LEAST_GAIN, DAMPINGS = 8, 0.05, 5
"""Of a fit at most, the gain in log units that ends it, and how many dampings a step tries."""

SETTLING, SETTLED = 30, 0.01
"""Steps at most in which what is integrated out settles, and the change in prior deviations that ends them."""
NEGLIGIBLE = 1e-3
"""Probability of scales below which they do not widen an interval."""

Names = tuple[str, ...]
"""Of a set of effects, sorted."""
Scales = tuple[float, float]
"""A share of equation misfit and a multiple of what the base misses."""


@dataclass(frozen=True)
class Terms:
    """A set of effects at some parameters, block by block."""

    entries: tuple[SizedEffect, ...]
    moments: Samples
    """(blocks, p + e + 1, ...) mean products of the tangents of the p parameters, of e columns that are integrated out
    with a deviation of 1, and of the residual."""
    signal: Samples
    """(blocks,) power of what the effects add, spread."""
    of_material: Samples
    """(blocks,) the part of it that is of the ceramic's loops and creep."""
    prior: Prior
    beside: tuple[Samples, ...]
    """Per run the coefficients (n - 1, b) of what slow effects had done before it began."""
    settled: dict[tuple[Scales, bool], Samples] = field(default_factory=dict)
    """Amounts of the columns that are integrated out, by scales and whether held-out records counted, once found."""

    @cached_property
    def precision(self) -> Samples:
        """(p + e,) of the priors."""
        p = len(self.prior.centre)
        return np.concatenate([self.prior.precision, np.ones(self.moments.shape[1] - 1 - p)])

    def power(self, amounts: Samples) -> Samples:
        """Mean power (blocks,) of the residual less amounts (p + e,) of the columns."""
        with_residual = np.append(-amounts, 1.0)
        return np.asarray(np.maximum((self.moments @ with_residual) @ with_residual, 0.0))


@dataclass(frozen=True)
class Fit:
    """A set of effects at its most likely parameters."""

    terms: Terms
    log_evidence: float
    """Of all records, over all shares."""
    log_evidence_fitted: float
    """Without the held-out records."""
    named: float
    """Probability that no more is missed than an equation of that name may miss."""
    scales: Scales
    """The most likely ones."""
    covariance: Samples
    """(parameters, parameters) in internal units."""

    @property
    def entries(self) -> tuple[SizedEffect, ...]:
        """The effects and their parameters."""
        return self.terms.entries

    @property
    def names(self) -> Names:
        """Of the effects, sorted."""
        return names_of(self.entries)


@dataclass
class Likelihood:
    """Of sets of effects beside one base."""

    runs: tuple[BlockedRun, ...]
    expected: Expected
    shared: tuple[Samples, ...]
    """Per run the coefficients (n - 1, k) of what the base may miss in all records alike, one prior deviation each."""
    known: tuple[SizedEffect, ...] = ()
    """Effects that explain much, by themselves or beside others: what may be taken for one another."""

    def __post_init__(self) -> None:
        parts = [self.expected.of(run, run.spread(run.power(run.modelled.answer()))) for run in self.runs]
        self.noise, self.base = (np.concatenate(of) for of in zip(*parts, strict=True))
        held = [np.full(len(run.sizes), run.modelled.run.role == "holdout") for run in self.runs]
        self.fitted = ~np.concatenate(held)
        self.every = np.ones(len(self.fitted), dtype=bool)
        self._octaves = np.unique(np.concatenate([run.octaves for run in self.runs]), return_inverse=True)[1]
        pairs = zip(self.runs, self.shared, strict=True)
        self._among_shared = np.concatenate([run.products(one, one) for run, one in pairs])

    @property
    def step_s(self) -> float:
        """Between rows of the first record."""
        return self.runs[0].modelled.run.step_s

    def knowing(self, effects: Sequence[SizedEffect]) -> Likelihood:
        """The same, where further effects may be taken for others. Where reference records can tell, the base may lack
        any of them in all records."""
        known = (*self.known, *effects)
        if all(run.changed for run in self.runs):
            return replace(self, known=known)
        faults = [run.coefficients(as_fault(run.modelled, effects)) for run in self.runs]
        pairs = zip(self.shared, faults, strict=True)
        shared = tuple(np.concatenate(pair, axis=1) for pair in pairs)
        return replace(self, shared=shared, known=known)

    def without_held_out(self) -> Likelihood:
        """Of the other records alone: what is fitted to them may be judged on the held-out ones."""
        kept = [i for i, run in enumerate(self.runs) if run.modelled.run.role != "holdout"]
        return replace(self, runs=tuple(self.runs[i] for i in kept), shared=tuple(self.shared[i] for i in kept))

    def with_misfit_of(self, entries: Sequence[SizedEffect]) -> Likelihood:
        """The same, where what the equations of some effects miss may look like the known ones that they are confused
        with."""
        shared = list(self.shared)
        for i, (effect, _) in enumerate(entries):
            size = np.sqrt(_squares([self._signal(run, entries, i) for run in self.runs]))
            for rival in self.known:
                if not confused(effect, rival[0]):
                    continue
                squares = _squares([self._signal(run, [rival], 0) for run in self.runs])
                share = LIKE_RIVALS * size / np.sqrt(squares) if squares > 0 else 0.0
                for j, run in enumerate(self.runs):
                    near = run.coefficients(as_fault(run.modelled, [rival]) * (share * run.changed))
                    shared[j] = np.concatenate([shared[j], near], axis=1)
        return replace(self, shared=tuple(shared))

    def _signal(self, run: BlockedRun, entries: Sequence[SizedEffect], index: int) -> Samples:
        """Coefficients (n - 1, 1) of what one effect adds to the others."""
        if not run.changed:
            return np.zeros((run.edges[-1], 1))
        rest = [*entries[:index], *entries[index + 1 :]]
        return run.coefficients((run.modelled.answer(entries) - run.modelled.answer(rest))[:, None])

    def fresh(self, run: int, entries: Sequence[SizedEffect]) -> Samples:
        """Coefficients (n - 1, p + 1) of one run: the tangents of all parameters, and the residual. Effects do nothing
        in a reference record."""
        blocks, free = self.runs[run], parameters_of(entries)
        if not blocks.changed:
            residual = blocks.base_error
            return np.concatenate([np.zeros((len(residual), len(free))), residual], axis=1)
        return blocks.coefficients(fresh_columns(blocks.modelled, entries, free))

    def _before(self, entries: Sequence[SizedEffect]) -> tuple[Samples, ...]:
        """What slow effects had done before each record began: columns of its own for each record."""
        of_runs = [before_record(r.modelled, entries) if r.changed else None for r in self.runs]
        ends = np.cumsum([0, *(0 if one is None else one.shape[1] for one in of_runs)])
        found = []
        for run, mine, first in zip(self.runs, of_runs, ends[:-1], strict=True):
            wide = np.zeros((run.edges[-1], ends[-1]))
            if mine is not None:
                wide[:, first : first + mine.shape[1]] = run.coefficients(mine)
            found.append(wide)
        return tuple(found)

    def terms(self, entries: Sequence[SizedEffect]) -> Terms:
        """A set of effects at its parameters."""
        entries = tuple(entries)
        signals = [[self._signal(run, entries, i) for run in self.runs] for i in range(len(entries))]
        added = np.stack([self._powers(of) for of in signals]) if signals else np.zeros((0, len(self.every)))
        material = is_of_material(entries)
        beside = self._before(entries)
        moments = self._moments([self.fresh(i, entries) for i in range(len(self.runs))], beside)
        return Terms(
            entries, moments, added.sum(axis=0), added[material].sum(axis=0), prior_of(entries, self.step_s), beside
        )

    def _powers(self, signals: Sequence[Samples]) -> Samples:
        """Power (blocks,), spread, of coefficients (n - 1, 1) per run."""
        pairs = zip(self.runs, signals, strict=True)
        return np.concatenate([run.spread(run.products(one, one)[:, 0, 0]) for run, one in pairs])

    def _near(self, terms: Terms, entries: tuple[SizedEffect, ...]) -> Terms:
        """A set at parameters near those of ``terms``, without tangents, for their likelihood alone."""
        fresh = [r.coefficients(r.modelled.error(entries)[:, None]) if r.changed else r.base_error for r in self.runs]
        prior = prior_of(entries, self.step_s)
        none = Prior(prior.log_density, np.zeros(0), np.zeros(0))
        return Terms(entries, self._moments(fresh, terms.beside), terms.signal, terms.of_material, none, terms.beside)

    def _moments(self, fresh: Sequence[Samples], beside: Sequence[Samples]) -> Samples:
        """Products (blocks, ...) of tangents, of what is integrated out, and of the residual."""
        p, k, b = fresh[0].shape[1] - 1, self.shared[0].shape[1], beside[0].shape[1]
        places = np.array([*range(p), *range(p + k, p + k + b), p + k + b])
        known = np.arange(p, p + k)
        found = []
        for run, shared, new, more in zip(self.runs, self.shared, fresh, beside, strict=True):
            columns = np.concatenate([new[:, :-1], more, new[:, -1:]], axis=1)
            moments = np.zeros((len(run.sizes), p + k + b + 1, p + k + b + 1))
            moments[:, places[:, None], places] = run.products(columns, columns)
            cross = run.products(columns, shared)
            moments[:, places[:, None], known] = cross
            moments[:, known[:, None], places] = cross.transpose(0, 2, 1)
            found.append(moments)
        every = np.concatenate(found)
        every[:, known[:, None], known] = self._among_shared
        return every

    def variance(self, terms: Terms, scales: Scales) -> Samples:
        """v (blocks,) in um^2."""
        share, times = scales
        return np.asarray(self.noise + times**2 * self.base + missed_um2(share, terms.signal, terms.of_material))

    def log_density(self, power: Samples, variance: Samples, which: Samples) -> float:
        """Of the residual's power (blocks,), one coefficient for each block."""
        t = self.expected.told
        one = gammaln((t + 1) / 2) - gammaln(t / 2) - 0.5 * np.log(t * np.pi * variance)
        return float(np.sum((one - (t + 1) / 2 * np.log1p(power / (t * variance)))[which]))

    def weights(self, power: Samples, variance: Samples) -> Samples:
        """By which squares (blocks,) count near a residual of this power."""
        t = self.expected.told
        return np.asarray((t + 1) / (t * variance + power))

    def settled(self, terms: Terms, scales: Scales, which: Samples) -> Samples:
        """Amounts (p + e,) of the columns, 0 of the tangents, at which what is integrated out is most likely."""
        key = scales, which is self.every
        if key not in terms.settled:
            terms.settled[key] = self._settled(terms, scales, which)
        return terms.settled[key]

    def _settled(self, terms: Terms, scales: Scales, which: Samples) -> Samples:
        p, amounts = len(terms.prior.centre), np.zeros(len(terms.precision))
        if len(amounts) == p:
            return amounts
        # The first step is taken as if they explained everything: from nothing it would begin by calling an outlier
        # what they explain.
        variance, power = self.variance(terms, scales), np.zeros(len(which))
        for _ in range(SETTLING):
            w = np.where(which, self.weights(power, variance), 0.0)
            normal = np.tensordot(w, terms.moments, 1)
            found = np.linalg.solve(normal[p:-1, p:-1] + np.diag(terms.precision[p:]), normal[p:-1, -1])
            moved = float(np.abs(found - amounts[p:]).max())
            amounts[p:] = found
            if moved < SETTLED:
                break
            power = terms.power(amounts)
        return amounts

    def log_joint(self, terms: Terms, scales: Scales, which: Samples) -> float:
        """Log density of the records and of all parameters."""
        amounts = self.settled(terms, scales, which)
        density = self.log_density(terms.power(amounts), self.variance(terms, scales), which)
        return density + terms.prior.log_density - 0.5 * float(amounts @ amounts)

    def information(
        self, terms: Terms, scales: Scales, which: Samples, independent: Samples | float = 1.0
    ) -> tuple[Samples, Samples]:
        """(p + e, p + e) of the records and the priors together, and the slope (p + e,) of the log density. Of what a
        block says only the share ``independent`` (blocks,) counts."""
        amounts = self.settled(terms, scales, which)
        w = independent * np.where(which, self.weights(terms.power(amounts), self.variance(terms, scales)), 0.0)
        normal = np.tensordot(w, terms.moments, 1)
        slope = normal[:-1, -1] - normal[:-1, :-1] @ amounts
        off = internal(terms.entries) - terms.prior.centre
        slope -= np.concatenate([terms.prior.precision * off, amounts[len(off) :]])
        return normal[:-1, :-1] + np.diag(terms.precision), slope

    def _covariance(self, terms: Terms, scales: Scales) -> Samples:
        """(p, p) of the parameters in internal units. What the base and the equations miss is the stage's, and the same
        in every record: an octave tells a parameter past it once, however many records there are."""
        variance = self.variance(terms, scales)
        told = terms.signal / variance
        of_octave = np.bincount(self._octaves, told) ** 2 / np.maximum(np.bincount(self._octaves, told**2), 1e-300)
        records = np.maximum(of_octave, 1.0)[self._octaves]
        independent = variance / (self.noise + records * (variance - self.noise))
        p = len(terms.prior.centre)
        return np.asarray(np.linalg.inv(self.information(terms, scales, self.every, independent)[0])[:p, :p])

    def likeliest_scales(self, terms: Terms, near: Scales | None = None) -> tuple[float, Scales]:
        """The most likely scales, after the log density there: of all, or by steps from those of a set like it."""
        grid = _grid(terms)
        found = {one: self._log_joint_at(terms, one) for one in (grid if near is None else [near])}
        while near is not None:
            best = max(found, key=lambda one: found[one])
            beside = [one for one in grid if one not in found and _beside(one, best)]
            found |= {one: self._log_joint_at(terms, one) for one in beside}
            if max(found, key=lambda one: found[one]) == best:
                break
        return max((density, one) for one, density in found.items())

    def _log_joint_at(self, terms: Terms, scales: Scales) -> float:
        return self.log_joint(terms, scales, self.every) + _log_prior(terms, scales)

    def fit(self, start: Sequence[SizedEffect], steps: int = STEPS) -> Fit:
        """The most likely parameters near those of ``start``."""
        terms, scales, _ = self.fitted_terms(start, steps)
        return self.judged(terms, scales)

    def fitted_terms(self, start: Sequence[SizedEffect], steps: int = STEPS) -> tuple[Terms, Scales, float]:
        """A set at its most likely parameters near those of ``start``, the scales there and the log density."""
        terms = self.terms(start)
        best, scales = self.likeliest_scales(terms)
        damping = 1e-3
        for _ in range(steps if len(start) else 0):
            information, slope = self.information(terms, scales, self.every)
            gained = 0.0
            for _ in range(DAMPINGS):
                step = np.asarray(np.linalg.solve(information + damping * np.diag(np.diag(information)), slope))
                entries = _moved(terms.entries, step)
                near = self._near(terms, entries)
                gained = self._log_joint_at(near, scales) - best
                if gained > 0:
                    terms, damping = self.terms(entries), max(damping / 5, 1e-6)
                    best, scales = self.likeliest_scales(terms, scales)
                    break
                damping = max(damping, 1e-3) * 10
            if gained < LEAST_GAIN:
                break
        return terms, scales, best

    def judged(self, terms: Terms, scales: Scales) -> Fit:
        """Evidence and covariance of a set at its most likely parameters."""
        grid = _grid(terms)
        prior = np.array([_log_prior(terms, one) for one in grid])
        every = prior + np.array([self._log_evidence(terms, one, self.every) for one in grid])
        fitted = prior + np.array([self._log_evidence(terms, one, self.fitted) for one in grid])
        likely = np.exp(every - every.max())
        named = float(likely[[share <= MOST_MISSED for share, _ in grid]].sum() / likely.sum())
        p = len(terms.prior.centre)
        covariance = np.zeros((p, p))
        for probability, one in zip(likely / likely.sum(), grid, strict=True):
            if p and probability > NEGLIGIBLE:
                covariance += probability * self._covariance(terms, one)
        return Fit(terms, _log_sum(every), _log_sum(fitted), named, scales, covariance)

    def _log_evidence(self, terms: Terms, scales: Scales, which: Samples) -> float:
        information, _ = self.information(terms, scales, which)
        p = len(terms.prior.centre)
        volume = 0.5 * p * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(information)[1]
        return self.log_joint(terms, scales, which) + float(volume)


def names_of(entries: Sequence[SizedEffect]) -> Names:
    """Names of some effects, sorted."""
    return tuple(sorted(effect.name for effect, _ in entries))


def confused(one: Effect, other: Effect) -> bool:
    """Whether two effects are hard to tell apart by what the catalogue says of either."""
    mine, theirs = ({*e.confused_with, *e.hard_to_tell_from} for e in (one, other))
    return one.name != other.name and (other.name in mine or one.name in theirs)


def is_of_material(entries: Sequence[SizedEffect]) -> NDArray[np.bool_]:
    """Of each of some effects whether it is of the ceramic's loops or creep."""
    return np.array([effect.place in (Place.HYSTERESIS, Place.CREEP) for effect, _ in entries], dtype=bool)


def missed_um2(share: float, signal: Samples, of_material: Samples) -> Samples:
    """Power (blocks,) that the equations miss of what effects add, of which a part is of the ceramic."""
    return np.asarray(share**2 * signal + max(LEAST_OF_MATERIAL**2 - share**2, 0.0) * of_material)


def _grid(terms: Terms) -> list[Scales]:
    """The scales that a set may have."""
    return list(product(SHARES if terms.entries else SHARES[:1], TIMES_BASE))


def _beside(one: Scales, other: Scales) -> bool:
    """Whether scales are next to others on the grid."""
    apart = [abs(of.index(a) - of.index(b)) for of, a, b in zip((SHARES, TIMES_BASE), one, other, strict=True)]
    return sum(apart) == 1


def _log_prior(terms: Terms, scales: Scales) -> float:
    """Of the scales of a set."""
    within = sum(share <= MOST_MISSED for share in SHARES)
    of_share = (1 - OUTSIDE) / within if scales[0] <= MOST_MISSED else OUTSIDE / (len(SHARES) - within)
    return float(np.log(of_share if terms.entries else 1.0) - np.log(len(TIMES_BASE)))


def _squares(parts: Sequence[Samples]) -> float:
    return sum(float(np.sum(part**2)) for part in parts)


def _log_sum(logs: Samples) -> float:
    return float(logs.max() + np.log(np.sum(np.exp(logs - logs.max()))))


def _moved(entries: Sequence[SizedEffect], step: Samples) -> tuple[SizedEffect, ...]:
    """The entries after a step, at most a factor e in what is logarithmic."""
    moved = [(effect, dict(params)) for effect, params in entries]
    for (i, p), change in zip(parameters_of(entries), step, strict=False):
        limited = float(np.clip(change, -1.0, 1.0)) if is_logarithmic(p) else float(change)
        moved[i][1][p.name] = from_internal(p, to_internal(p, moved[i][1][p.name]) + limited)
    return tuple((effect, bounded(effect, params)) for effect, params in moved)
