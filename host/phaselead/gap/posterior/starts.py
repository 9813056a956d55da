"""Where to begin: which shapes of which effects explain most of a residual, to first order."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.first_order import FirstOrder, Histories, histories_of
from phaselead.gap.posterior.if_explained import IfExplained, if_explained_of
from phaselead.gap.posterior.levels import about_their_sessions
from phaselead.gap.posterior.likeliest import APART, LEAST_POWER, Start, in_typical_sizes, likeliest_amounts
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.priors import FLEXURE_ZETA, KNOWN_BEFORE, LARGEST, SIZES
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.posterior.shapes import Shapes
from phaselead.gap.regressors import MODE_GRID_RATIO, RegressorGroup, regressor_groups, typical_sizes
from phaselead.model import Effect
from phaselead.record import Samples

DIFFERENT = 2
"""Shapes of one effect from which it is begun, of different forms where it has some."""
FINE_MODES = 9
"""Frequencies about each of the best on the coarse grid at which a mode is tried, damped as flexures are."""


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
        return self._of(groups)

    @cached_property
    def _histories(self) -> Histories:
        """Of the shapes that are looked at."""
        return histories_of(self.likelihood.runs, self.shapes.groups)

    def _of(self, groups: Sequence[RegressorGroup]) -> Shapes:
        """With the coefficients of every group, their levels about those of the session."""
        runs, found, levels = self.likelihood.runs, [], []
        for run in runs:
            coefficients = self._of_run(run, groups)
            found.append(coefficients.astype(np.float32))
            levels.append(coefficients[0].copy())  # and not the whole of it
        for of_run, level in zip(found, about_their_sessions(runs, levels), strict=True):
            of_run[0] = level
        return Shapes(groups, found)

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
        histories = self._histories if self.with_outliers else None
        every = self._sized(fit, self.shapes, histories)
        if self.with_outliers:
            every += [start for shapes in self._if_explained for start in shapes.beside(self.likelihood, fit)]
        found: dict[str, list[Start]] = {}
        for start in every:
            name = start.entry[0].name
            if name not in fit.names:
                found.setdefault(name, []).append(start)
        chosen = {name: self._chosen(fit, starts) for name, starts in found.items()}
        return dict(sorted(chosen.items(), key=lambda item: -item[1][0].gain))

    @cached_property
    def _if_explained(self) -> list[IfExplained]:
        """The shapes, to be asked what each effect would bring if it explained all that a set leaves."""
        return if_explained_of(self.shapes, self._histories)

    def _chosen(self, fit: Fit, starts: Sequence[Start]) -> list[Start]:
        ranked = sorted(starts, key=lambda start: (not start.of_size, -start.gain))
        effect = ranked[0].entry[0]
        if effect.peak is None:
            different = {_place_of(start): start for start in reversed(ranked)}.values()
            ranked = [start for start in ranked if start in different]
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
        return self._sized(fit, self._of(groups))

    def sizes(self, fit: Fit) -> list[SizedGroup]:
        """What the records say of the first size of every shape beside a set, simulated at its typical size, and where
        it is not linear in it at each of the usual sizes. As in an interval, an octave says it once in however many
        records the stage moves there."""
        likelihood, found = self.likelihood, []
        moved = np.where(likelihood.changed, likelihood.base, 0.0)
        once = likelihood.independent(fit.terms, [fit.share], moved)[0]
        for group, slope, curvature in self.moments(fit, self.shapes, once):
            if group.effect.name in fit.names:
                continue
            prior = np.array([LEAST_POWER, *np.full(len(slope) - 1, 1 / LARGEST**2)])
            inverse = np.linalg.inv(curvature + np.diag(prior * in_typical_sizes(group) ** 2))
            # What a set takes up to the last digit leaves a power that rounding may turn negative.
            told = inverse[0, 0] > 0
            amount, deviation = (float(inverse[0] @ slope), float(np.sqrt(inverse[0, 0]))) if told else (0.0, np.inf)
            found.append(SizedGroup(group, amount, deviation))
        return found

    def _sized(self, fit: Fit, shapes: Shapes, histories: Histories | None = None) -> list[Start]:
        """Every shape with the sizes that explain most of what a set leaves."""
        found = []
        for group, slope, curvature in self.moments(fit, shapes, histories=histories):
            found.append(max(likeliest_amounts(group, slope, curvature, self.with_outliers), key=lambda one: one.gain))
        return found

    def moments(
        self,
        fit: Fit,
        shapes: Shapes,
        independent: Samples | float = 1.0,
        histories: Histories | None = None,
    ) -> list[tuple[RegressorGroup, Samples, Samples]]:
        """Per shape the slope (sizes,) and curvature (sizes, sizes) of the log density, all parameters of the set
        moving along. Of what a block says only the share ``independent`` (blocks,) counts. Behind the sizes stand, with
        ``histories``, the amounts of what the effect had done before each record."""
        settled = self.likelihood.settled(fit.terms, [fit.share])
        weights = independent * self.likelihood.weights(settled.power, settled.variance)[0]
        beside = FirstOrder(self.likelihood, fit.terms, weights, shapes, histories)
        return [(group, *beside.slope_and_curvature(which)) for which, group in enumerate(shapes.groups)]


def _place_of(start: Start) -> tuple[float, ...]:
    """Where a start begins: at its shapes; of an effect without, at its first size to a factor of ``APART``."""
    effect, params = start.entry
    if effect.shapes:
        return tuple(params[p.name] for p in effect.shapes)
    size = params[effect.sizes[0].name] / effect.sizes[0].typical
    return (float(np.round(np.log(abs(size) or LEAST_POWER) / np.log(APART))),)


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
