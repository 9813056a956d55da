"""Where to begin: which shapes of which effects explain most of a residual, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.parameters import SizedEffect, bounded
from phaselead.gap.posterior.beside import Beside, Histories, Left, histories_of
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.levels import about_their_sessions
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.missed import is_of_material, log_prior_of_share, shares_of
from phaselead.gap.posterior.priors import FLEXURE_ZETA, KNOWN_BEFORE, LARGEST, SIZES
from phaselead.gap.posterior.sets import Fit, Terms, has_history
from phaselead.gap.posterior.shapes import Shapes
from phaselead.gap.regressors import MODE_GRID_RATIO, RegressorGroup, regressor_groups, typical_sizes
from phaselead.model import Effect
from phaselead.record import Samples

APART = 2.0
"""Ratio of a size to that at which it was simulated, up to which another of ``SIZES`` is no nearer."""
DIFFERENT = 2
"""Shapes of one effect from which it is begun, of different forms where it has some."""
LEAST_POWER = 1e-6
"""Precision of a size, in squares of a typical one, below which the records say nothing of it."""
TAIL_STEPS = 5
"""In which the most likely amount in the tails of the prior is found."""
FINE_MODES = 9
"""Frequencies about each of the best on the coarse grid at which a mode is tried, damped as flexures are."""


@dataclass(frozen=True)
class Start:
    """An effect at a shape, with the sizes that explain most."""

    entry: SizedEffect
    gain: float
    """Log units that it is expected to bring."""
    of_size: bool
    """Whether it was simulated at about these sizes, as far as that matters."""


@dataclass(frozen=True)
class SizedGroup:
    """A shape with what the records say of its first size, in steps of it."""

    group: RegressorGroup
    amount: float
    deviation: float


class Starts:
    """Of all effects of a catalogue beside any set."""

    with_outliers = True
    """Whether records that are far off count for less, so that usual sizes may explain next to nothing of them."""

    def __init__(self, likelihood: Likelihood, effects: Sequence[Effect]) -> None:
        self.likelihood = likelihood
        self.effects = effects

    def of(self, likelihood: Likelihood) -> Starts:
        """The same under another likelihood of the same runs; what was simulated is kept."""
        other = copy(self)
        other.likelihood = likelihood
        return other

    @cached_property
    def shapes(self) -> Shapes:
        """That are looked at."""
        runs = [run.modelled.run for run in self.likelihood.runs]
        longest_s = max(float(run.t_s[-1] - run.t_s[0]) for run in runs)
        groups = at_all_sizes(regressor_groups(self.effects, self.likelihood.step_s, longest_s))
        return Shapes(groups, self._of(groups))

    @cached_property
    def _histories(self) -> Histories:
        """Of the shapes that are looked at."""
        return histories_of(self.likelihood.runs, self.shapes.groups)

    def _of(self, groups: Sequence[RegressorGroup]) -> list[NDArray[np.float32]]:
        """Per run the coefficients (n, k) of every group, their levels about those of the session."""
        runs, found, levels = self.likelihood.runs, [], []
        for run in runs:
            coefficients = self._of_run(run, groups)
            found.append(coefficients.astype(np.float32))
            levels.append(coefficients[0].copy())  # and not the whole of it
        for of_run, level in zip(found, about_their_sessions(runs, levels), strict=True):
            of_run[0] = level
        return found

    @staticmethod
    def _of_run(run: BlockedRun, groups: Sequence[RegressorGroup]) -> Samples:
        """(n, k) of every group in one run."""
        if not run.changed:
            return np.zeros((run.edges[-1], sum(len(group.steps) for group in groups)))
        base_um = run.modelled.answer()
        none = np.zeros((len(base_um), 0))
        columns = [group.columns(run.modelled, base_um) for group in groups]
        return run.coefficients(np.concatenate([none, *columns], axis=1))

    def beside(self, fit: Fit) -> dict[str, list[Start]]:
        """The best different shapes of every effect that is not in a set, the effect that explains most first."""
        found: dict[str, list[Start]] = {}
        for start in [
            *self._sized(fit, self.shapes.groups, self.shapes.columns, self._histories),
            *(self._as_if_explained(fit) if self.with_outliers else []),
        ]:
            name = start.entry[0].name
            if name not in fit.names:
                found.setdefault(name, []).append(start)
        chosen = {name: self._chosen(fit, starts) for name, starts in found.items()}
        return dict(sorted(chosen.items(), key=lambda item: -item[1][0].gain))

    def _chosen(self, fit: Fit, starts: Sequence[Start]) -> list[Start]:
        ranked = sorted(starts, key=_rank)
        effect = ranked[0].entry[0]
        if effect.peak is None:
            best_of_form = {_form_of(start): start for start in reversed(ranked)}.values()
            return sorted(ranked, key=lambda start: start not in best_of_form)[:DIFFERENT]
        peaks = _peaks(starts, effect.peak[0])[:DIFFERENT]
        fine = [max([start, *self._nearby(fit, start)], key=lambda one: one.gain) for start in peaks]
        return sorted(fine, key=lambda start: -start.gain)

    def _nearby(self, fit: Fit, start: Start) -> list[Start]:
        """A mode at frequencies near those of a start, damped as flexures are."""
        effect, params = start.entry
        assert effect.peak is not None
        frequency, damping = effect.peak
        near = np.geomspace(1 / MODE_GRID_RATIO, MODE_GRID_RATIO, FINE_MODES) * params[frequency]
        shapes = {p.name: params[p.name] for p in effect.shapes}
        groups = [
            RegressorGroup(effect, {**shapes, frequency: f, damping: FLEXURE_ZETA}, typical_sizes(effect)) for f in near
        ]
        return self._sized(fit, groups, self._of(groups))

    def sizes(self, fit: Fit) -> list[SizedGroup]:
        """What the records say of the first size of every shape beside a set, simulated at its typical size, and where
        it is not linear in it at each of the usual sizes. As in an interval, an octave says it once in however many
        records the stage moves there."""
        likelihood, found = self.likelihood, []
        moved = np.where(likelihood.changed, likelihood.base, 0.0)
        once = likelihood.independent(fit.terms, [fit.share], moved)[0]
        for group, slope, curvature in self.moments(fit, self.shapes.groups, self.shapes.columns, once):
            if group.effect.name in fit.names:
                continue
            prior = np.array([LEAST_POWER, *np.full(len(slope) - 1, 1 / LARGEST**2)])
            inverse = np.linalg.inv(curvature + np.diag(prior * _in_typical_sizes(group) ** 2))
            # What a set takes up to the last digit leaves a power that rounding may turn negative.
            told = inverse[0, 0] > 0
            amount, deviation = (float(inverse[0] @ slope), float(np.sqrt(inverse[0, 0]))) if told else (0.0, np.inf)
            found.append(SizedGroup(group, amount, deviation))
        return found

    def _sized(
        self,
        fit: Fit,
        groups: Sequence[RegressorGroup],
        columns: Sequence[NDArray[np.float32]],
        histories: Histories | None = None,
    ) -> list[Start]:
        """Every group with the sizes that explain most of what a set leaves."""
        told = self.moments(fit, groups, columns, histories=histories)
        return [self._likeliest_of(*one).start for one in told]

    def _likeliest_of(self, group: RegressorGroup, slope: Samples, curvature: Samples) -> _Amounts:
        """The sizes of a group that explain most, whether what its effect had done before the records still goes on or
        is over in all of them."""
        linear, sizes = group.effect.basis is not None, len(group.steps)
        unit, far_out = _in_typical_sizes(group), linear and self.with_outliers
        amounts, gain = _likeliest(slope[:sizes], curvature[:sizes, :sizes], unit, far_out)
        every, log_volume = np.append(amounts, np.zeros(len(slope) - sizes)), 0.0
        if len(slope) > sizes:
            history = _History.of(slope, curvature, sizes)
            going_on, more = _likeliest(history.slope, history.curvature, unit, far_out)
            if more + history.gain > gain:
                amounts, gain, log_volume = going_on, more + history.gain, history.log_volume
                every = np.append(amounts, history.amounts(amounts))
        params = bounded(group.effect, group.params(amounts.tolist()))
        of_size = linear or bool(1 / APART <= np.abs(amounts).max() <= APART)
        return _Amounts(Start((group.effect, params), gain, of_size), every, log_volume)

    def _as_if_explained(self, fit: Fit) -> list[Start]:
        """The best shape of every effect, but of modes, where it is taken to explain what the set leaves, and what that
        brings: what the set calls outliers, or puts down to what its equations miss, says little of an effect before
        that is there."""
        likelihood, terms = self.likelihood, fit.terms
        variance = likelihood.variance(terms, shares_of(fit.entries)[:1])
        weights = likelihood.weights(np.zeros_like(variance[:, 0]), variance)[0]
        beside = Beside(likelihood, terms, weights, self.shapes.groups, self.shapes.columns, self._histories)
        best: dict[str, tuple[int, _Amounts]] = {}
        for which, group in enumerate(self.shapes.groups):
            name = group.effect.name
            if name in fit.names or group.effect.peak is not None:
                continue
            one = self._likeliest_of(group, *beside.told(which))
            if name not in best or _rank(one.start) < _rank(best[name][1].start):
                best[name] = which, one
        levelled = likelihood.likeliest_share(terms, fit.share)[0]
        level_free = likelihood.likeliest_share(replace(terms, levels_say=False, settled={}), fit.share)[0]
        found = []
        for which, one in best.values():
            entries = (*fit.entries, one.start.entry)
            was = level_free if has_history(entries) else levelled
            gain = self._brought(terms, beside.left(which, one.every), one, entries) - (was - terms.prior.log_density)
            found.append(replace(one.start, gain=float(gain)))
        return found

    def _brought(self, terms: Terms, left: Left, one: _Amounts, entries: tuple[SizedEffect, ...]) -> float:
        """Log density of the records and of all amounts, under the likeliest share of what equations miss."""
        likelihood, shares = self.likelihood, shares_of(entries)
        material = terms.of_material + is_of_material(entries[-1:])[0] * left.added
        with_it = replace(terms, entries=entries, signal=terms.signal + left.added, of_material=material, settled={})
        power = np.tile(left.power, (len(shares), 1))
        logs = likelihood.log_density(power, likelihood.variance(with_it, shares))
        logs += [log_prior_of_share(entries, share) for share in shares]
        effect, params = entries[-1]
        typical = np.array([params[p.name] / p.typical for p in effect.sizes])
        of_sizes = -0.5 * float(np.minimum(typical**2 / LARGEST**2, 2 * np.log1p((typical / LARGEST) ** 2)).sum())
        return float(logs.max()) + left.log_prior + one.log_volume + of_sizes

    def moments(
        self,
        fit: Fit,
        groups: Sequence[RegressorGroup],
        columns: Sequence[NDArray[np.float32]],
        independent: Samples | float = 1.0,
        histories: Histories | None = None,
    ) -> list[tuple[RegressorGroup, Samples, Samples]]:
        """Per group the slope (sizes,) and curvature (sizes, sizes) of the log density, all parameters of the set
        moving along. Of what a block says only the share ``independent`` (blocks,) counts. Behind the sizes stand, with
        ``histories``, the amounts of what the effect had done before each record."""
        settled = self.likelihood.settled(fit.terms, [fit.share])
        weights = independent * self.likelihood.weights(settled.power, settled.variance)[0]
        beside = Beside(self.likelihood, fit.terms, weights, groups, columns, histories)
        return [(group, *beside.told(which)) for which, group in enumerate(groups)]


@dataclass(frozen=True)
class _Amounts:
    """A start, and the amounts of its columns."""

    start: Start
    every: Samples
    """(sizes and histories,)"""
    log_volume: float
    """Of its histories, where they go on."""


@dataclass(frozen=True)
class _History:
    """What is told of sizes where the amounts behind them, of a prior deviation of 1, are integrated out."""

    slope: Samples
    """(sizes,)"""
    curvature: Samples
    """(sizes, sizes)"""
    gain: float
    """Log units that the amounts bring by themselves."""
    log_volume: float
    by_themselves: Samples
    """(h,) amounts, and by how much they change with the sizes, (h, sizes)."""
    with_sizes: Samples

    @classmethod
    def of(cls, slope: Samples, curvature: Samples, sizes: int) -> _History:
        """From slope and curvature over the sizes and what is behind them."""
        precision = curvature[sizes:, sizes:] + np.eye(len(slope) - sizes)
        right = np.column_stack([slope[sizes:], curvature[sizes:, :sizes]])
        across: Samples = np.asarray(np.linalg.solve(precision, right), dtype=np.float64)
        log_volume = -0.5 * float(np.linalg.slogdet(precision)[1])
        left = curvature[:sizes, sizes:] @ across
        return cls(
            slope[:sizes] - left[:, 0], curvature[:sizes, :sizes] - left[:, 1:],
            0.5 * float(slope[sizes:] @ across[:, 0]) + log_volume, log_volume, across[:, 0], across[:, 1:],
        )  # fmt: skip

    def amounts(self, sizes: Samples) -> Samples:
        """(h,) where the sizes are these."""
        return np.asarray(self.by_themselves - self.with_sizes @ sizes)


def _rank(start: Start) -> tuple[bool, float]:
    """By which starts are taken, the lowest first."""
    return not start.of_size, -start.gain


def _likeliest(slope: Samples, curvature: Samples, unit: float, far_out: bool) -> tuple[Samples, float]:
    """Amounts (sizes,) in steps of so many typical sizes, and the log units that they bring: the most likely within the
    usual sizes or, if asked (``far_out``), in the tails of their prior, where that brings more: records that an effect
    of many times its size makes outliers say little of it."""
    diagonal = np.eye(len(slope)) * unit**2
    near: Samples = np.asarray(np.linalg.solve(curvature + diagonal / LARGEST**2, slope), np.float64)
    gain = 0.5 * float(slope @ near)
    if not far_out:
        return near, gain
    far: Samples = np.asarray(np.linalg.solve(curvature + diagonal * LEAST_POWER, slope), np.float64)
    for _ in range(TAIL_STEPS):
        far[:] = np.linalg.solve(curvature + 2 * diagonal / (LARGEST**2 + (far * unit) ** 2), slope)
    out = float(slope @ far - 0.5 * far @ curvature @ far - np.log1p((far * unit / LARGEST) ** 2).sum())
    return (far, out) if out > gain else (near, gain)


def _in_typical_sizes(group: RegressorGroup) -> float:
    """A step of a shape, which is as many typical sizes for each of its sizes."""
    return group.steps[0] / typical_sizes(group.effect)[0]


def _form_of(start: Start) -> tuple[float, ...]:
    """The shapes that choose between the forms of an effect: no fit goes from one form to another."""
    effect, params = start.entry
    return tuple(params[p.name] for p in effect.parameters if p.between_forms)


def _peaks(starts: Sequence[Start], frequency: str) -> list[Start]:
    """Modes that explain more than their neighbours in frequency, the one that explains most first."""
    in_order = sorted(starts, key=lambda start: start.entry[1][frequency])
    gains = [-np.inf, *(start.gain for start in in_order), -np.inf]
    found = [start for i, start in enumerate(in_order) if gains[i] <= start.gain >= gains[i + 2]]
    return sorted(found, key=lambda start: -start.gain)


def at_all_sizes(groups: Sequence[RegressorGroup]) -> list[RegressorGroup]:
    """The groups, and those of effects that are not linear in their sizes at each of the usual sizes, and at the
    largest for which a bound says anything: a rate limit shows nothing below the rates of a record, and more than in
    proportion above."""
    found = list(groups)
    for group in groups:
        if group.effect.basis is None:
            others = [times for times in (*SIZES, KNOWN_BEFORE) if times != 1.0]
            found += [replace(group, steps=tuple(times * one for one in group.steps)) for times in others]
    return found
