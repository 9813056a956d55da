"""Where to begin: which shapes of which effects explain most of a residual, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.parameters import SizedEffect, bounded
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.levels import about_their_sessions
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.moments import Amounts
from phaselead.gap.posterior.priors import FLEXURE_ZETA, KNOWN_BEFORE, LARGEST, SIZES
from phaselead.gap.posterior.sets import Fit
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
        for start in self._sized(fit, self.shapes.groups, self.shapes.columns):
            name = start.entry[0].name
            if name not in fit.names:
                found.setdefault(name, []).append(start)
        chosen = {name: self._chosen(fit, starts) for name, starts in found.items()}
        return dict(sorted(chosen.items(), key=lambda item: -item[1][0].gain))

    def _chosen(self, fit: Fit, starts: Sequence[Start]) -> list[Start]:
        ranked = sorted(starts, key=lambda start: (not start.of_size, -start.gain))
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

    def _sized(self, fit: Fit, groups: Sequence[RegressorGroup], columns: Sequence[NDArray[np.float32]]) -> list[Start]:
        """Every group with the sizes that explain most of what a set leaves."""
        found = []
        for group, slope, curvature in self.moments(fit, groups, columns):
            linear = group.effect.basis is not None
            amounts, gain = _likeliest(slope, curvature, _in_typical_sizes(group), linear and self.with_outliers)
            params = bounded(group.effect, group.params(amounts.tolist()))
            of_size = linear or bool(1 / APART <= np.abs(amounts).max() <= APART)
            found.append(Start((group.effect, params), gain, of_size))
        return found

    def moments(
        self,
        fit: Fit,
        groups: Sequence[RegressorGroup],
        columns: Sequence[NDArray[np.float32]],
        independent: Samples | float = 1.0,
    ) -> list[tuple[RegressorGroup, Samples, Samples]]:
        """Per group the slope (sizes,) and curvature (sizes, sizes) of the log density, all parameters of the set
        moving along. Of what a block says only the share ``independent`` (blocks,) counts."""
        likelihood, terms = self.likelihood, fit.terms
        settled = likelihood.settled(terms, [fit.share])
        w = independent * likelihood.weights(settled.power, settled.variance)[0]
        normal, right = terms.moments.normal(w[None], terms.prior.precision)
        p, c, k = terms.moments.tangents, normal.common.shape[1], columns[0].shape[1]
        common, before = np.zeros((c + 1, k)), np.zeros((*normal.before.shape[1:3], k))
        own = [np.zeros((len(group.steps),) * 2) for group in groups]
        places = np.split(np.arange(k), np.cumsum([len(group.steps) for group in groups])[:-1])
        of_runs = np.split(w, terms.moments.runs[1:-1])
        simulated = likelihood.simulated(fit.terms)
        parts = zip(likelihood.runs, of_runs, simulated, likelihood.first_rows(simulated), strict=True)
        for i, (run, mine, of_run, first) in enumerate(parts):
            if not run.changed:
                continue
            roots = np.repeat(np.sqrt(mine / run.sizes), run.sizes)[:, None].astype(np.float32)
            tangents, residual = of_run.columns[:, :p], of_run.columns[:, -1:]
            of_set = np.concatenate([tangents, likelihood.shared[i], residual, of_run.before], axis=1)
            of_set[0] = np.concatenate([first[:p], likelihood.shared[i][0], first[-1:], first[p:-1]])
            weighed = columns[i] * roots
            cross = (of_set.astype(np.float32) * roots).T @ weighed
            common += cross[: c + 1]
            before[i] = cross[c + 1 :] * terms.moments.moving[i][:, None]
            for at, products in zip(places, own, strict=True):
                products += weighed[:, at].T @ weighed[:, at]
        with_set = Amounts(common[None, :-1], before[None])
        slopes = common[-1] - with_set.along(normal.solve(right))[0, :, 0]
        taken = with_set.along(normal.solve(with_set))[0]
        return [
            (group, slopes[at], products - taken[np.ix_(at, at)])
            for group, at, products in zip(groups, places, own, strict=True)
        ]


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
