"""Refitted effects compared with none and with each other, in the metric of the best one's residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.discrepancy import Discrepancy
from phaselead.gap.metric import Regressors, conditional_on, fair_weights, repetition
from phaselead.gap.problem import Problem
from phaselead.gap.refit import Fitted, SizedEffect, fresh_columns, refit
from phaselead.gap.residual import ModelledRun
from phaselead.gap.scan import Refitted, block_inflation, no_mode_of_its_own, penalty, projection
from phaselead.model import Effect
from phaselead.record import Samples

MARGIN = 10.0
"""Score by which an effect must beat none, and every rival it is not tied with."""
TIE = 37.0
"""Squared whitened distance below which two effects, each at its best, cannot be told apart: errors of 1 in 1000."""
ONE_LOOP_SHARE = 0.5
"""Where all records show the same loop, rivals with this share of the best one's score are tied with it."""
SAME_LOOP = 0.05
"""Largest relative difference of frequency, level and bias between records of one loop."""
MOST_RIVALS = 5
"""Effects that are compared, those of the best scores."""
PARAMETER_PRICE, PARAMETER_PRICE_WITH_REFERENCE = 0.001, 0.005
"""Of what is gained: the price of each parameter after an effect's first. No equation is the stage's own, and where
much is gained a richer one follows what a simpler one leaves of it; with reference records the more, since what a base
that was fitted to them misses is followed as well."""
SIMPLER_FROM_SCORE, SIMPLER_SHARE = 3000.0, 0.97
"""Score of a richer effect, and the share of it, from which a simpler one is believed instead."""
REFIT_STEPS = 5
"""Of a rival's refit in the metric of the best one's residual: it starts at its best in another metric."""
INFLATION_ROUNDS = 2
"""In which the best effect and the inflation along it are found in turn."""


@dataclass(frozen=True)
class Rival:
    """An effect beside the best one."""

    effect: Effect
    fitted: Fitted
    score: float
    """Whitened squares gained over the model without it, over the inflation, less the penalty."""
    distance: float
    """Squared whitened distance from what the best effect says to the nearest that this one could say."""

    def tied_with(self, best: Rival) -> bool:
        """Whether these records cannot tell it from the best.

        A richer effect that can imitate a simpler one lies at no distance from it whatever the truth: there the
        price of its parameters decides, which is in the score.
        """
        richer = len(self.effect.parameters) > len(best.effect.parameters)
        behind = best.score - self.score
        return behind < MARGIN or (self.distance < TIE and behind < TIE and not richer)

    def about_as_good_as(self, best: Rival) -> bool:
        """Whether it explains nearly as much as the best. That is all that can be asked on one loop, of one frequency
        and level: any closed curve can be the operator's own shape."""
        return self.score > ONE_LOOP_SHARE * best.score


@dataclass(frozen=True)
class Comparison:
    """The refitted effects, best first, in the metric of the best one's residual."""

    problem: Problem
    """With weights by what the best one leaves."""
    before: Fitted
    """What was fitted before."""
    rivals: tuple[Rival, ...]
    inflation: float
    """By how much more than white noise the residual scatters along the best one."""
    one_loop: bool = False
    """Whether all driven records go round one loop."""

    @property
    def best(self) -> Rival:
        """The one with the best score."""
        return self.rivals[0]

    def tied(self) -> list[Rival]:
        """The rivals that these records cannot tell from the best, itself first."""
        return [self.best, *(r for r in self.rivals[1:] if self.is_tied(r))]

    def is_tied(self, rival: Rival) -> bool:
        """Whether these records cannot tell it from the best."""
        beyond = self.one_loop and not self.best.effect.becomes_plays
        return rival.tied_with(self.best) or (beyond and rival.about_as_good_as(self.best))


def reweighed(problem: Problem, entries: Sequence[SizedEffect]) -> Problem:
    """The problem with blocks weighted by what the effects ``entries`` leave of them."""
    train = _weights(problem.train_common, problem.discrepancy, entries)
    return replace(
        problem,
        train=problem.train.reweighted(train),
        train_common=problem.train_common.reweighted(train),
        holdout=problem.holdout.reweighted(_weights(problem.holdout, problem.discrepancy, entries)),
    )


def _weights(regressors: Regressors, discrepancy: Discrepancy, entries: Sequence[SizedEffect]) -> list[Samples]:
    """Weights (blocks,) per run: 1 over the mean whitened square, and over how far the run only repeats itself."""
    errors = [t.error(entries)[:, None] for t in regressors.metric.modelled_runs]
    moments = regressors.with_columns(errors)
    amounts = residual_amounts(moments, discrepancy)
    left = regressors.unweighted(np.einsum("i,bij,j->b", amounts, moments, amounts))
    found = []
    for i, error in enumerate(errors):
        white = regressors.projected[i] @ amounts[regressors.live] + regressors.metric.project(i, error)[:, 0]
        repeated = repetition(white, regressors.metric.modelled_runs[i].period_rows)
        found.append(fair_weights(left[i], np.diff(regressors.metric.edges[i]).astype(np.float64), repeated))
    return found


def residual_amounts(moments: Samples, discrepancy: Discrepancy) -> Samples:
    """Amounts (k,) of all columns whose sum is what the discrepancy's columns leave of the last one, the residual."""
    target, index = moments.shape[-1] - 1, discrepancy.index
    shifted = discrepancy.mean_removed(moments, target).sum(axis=0)
    amounts = np.zeros(len(shifted))
    amounts[target] = 1.0
    inner = shifted[np.ix_(index, index)] + discrepancy.precision
    amounts[index] = -np.linalg.solve(inner, shifted[index, target]) - discrepancy.mean
    return amounts


def compare(problem: Problem, fitted: Fitted, tried: Sequence[Refitted]) -> Comparison:
    """Refit the best few of ``tried``, which is not empty, once more in the metric of the best and compare them there.

    ``fitted`` are the effects that were named before.
    """
    closest = sorted(tried, key=lambda t: t.fitted.squares + penalty(problem, t.effect))[:MOST_RIVALS]
    problem = reweighed(problem, closest[0].fitted.entries)
    before = refit(problem.train_common, problem.discrepancy, fitted.entries)
    again = [
        (t.effect, refit(problem.train_common, problem.discrepancy, t.fitted.entries, REFIT_STEPS)) for t in closest
    ]
    best, inflation = min(again, key=lambda pair: pair[1].squares), 1.0
    for _ in range(INFLATION_ROUNDS):
        inflation = max(_inflation(problem, before, best[1]), problem.reference_inflation.get(best[0].name, 1.0))
        best = min(again, key=lambda pair: pair[1].squares / inflation + penalty(problem, pair[0]))
    rivals = []
    richer = PARAMETER_PRICE if problem.reference is None else PARAMETER_PRICE_WITH_REFERENCE
    most = max(before.squares - result.squares for _, result in again) / inflation
    for effect, result in again:
        score = (before.squares - result.squares) / inflation - penalty(problem, effect)
        score -= richer * max(most, 0.0) * (len(effect.parameters) - 1)
        distance = 0.0 if effect is best[0] else _distance(problem, best[1], result) / inflation
        rivals.append(Rival(effect, result, score, distance))
    rivals.sort(key=lambda rival: -rival.score)
    rivals = [r for r in rivals if not no_mode_of_its_own(problem, r.fitted.entries[-1])] or rivals
    if problem.reference is not None:
        rivals = _simple_first(rivals)
    return Comparison(problem, before, tuple(rivals), inflation, one_loop(problem.train_runs()))


def _simple_first(rivals: list[Rival]) -> list[Rival]:
    """The rivals with a simpler effect put first where it gains nearly as much as the best, is confused with it, and
    much is gained: a heavier stage is not quite the base's mode moved, and a mode of its own follows the rest."""
    best = rivals[0]
    for rival in rivals[1:]:
        simpler = len(rival.effect.parameters) < len(best.effect.parameters)
        near = best.effect.name in rival.effect.confused_with or rival.effect.name in best.effect.confused_with
        if simpler and near and best.score > SIMPLER_FROM_SCORE and rival.score > SIMPLER_SHARE * best.score:
            return [rival, *(r for r in rivals if r is not rival and r is not best)]
    return rivals


def one_loop(modelled_runs: Sequence[ModelledRun]) -> bool:
    """Whether all driven records go round one loop: one frequency, one level, one bias."""
    sines = [t.run.sine for t in modelled_runs if t.run.driven]
    kinds = [(sine.f_Hz, sine.swing_V, sine.mean_V + sine.swing_V) for sine in sines if sine is not None]
    if not kinds or len(kinds) < len(sines):
        return False
    return bool((np.ptp(kinds, axis=0) <= SAME_LOOP * np.abs(kinds).max(axis=0)).all())


def _inflation(problem: Problem, before: Fitted, best: Fitted) -> float:
    """By how much more than white noise the residual scatters along what the best effect says, at least 1."""
    fresh = []
    for modelled in problem.train_common.metric.modelled_runs:
        after = modelled.answer(best.entries)
        fresh.append(
            np.stack([after - modelled.answer(before.entries), modelled.run.x_um[modelled.run.rows] - after], axis=1)
        )
    moments = problem.train_common.with_columns(fresh)
    left = residual_amounts(moments, problem.discrepancy)
    total = moments.sum(axis=0)
    along = block_inflation(moments, projection(total, problem.discrepancy), left)[-2]
    rows = problem.train_common.metric.rows
    return max(1.0, best.squares / rows, float(along))


def _distance(problem: Problem, best: Fitted, other: Fitted) -> float:
    """Squared whitened distance from what the best says to the nearest that the other could say."""
    fresh = []
    for modelled in problem.train_common.metric.modelled_runs:
        columns = fresh_columns(modelled, other.entries, other.free)
        columns[:, -1] = modelled.answer(best.entries) - modelled.answer(other.entries)
        fresh.append(columns)
    moment = problem.train_common.with_columns(fresh).sum(axis=0)
    index = problem.discrepancy.index
    moment = conditional_on(moment, index, problem.discrepancy.precision)
    tangents = np.arange(len(index), len(moment) - 1)
    return float(max(conditional_on(moment, tangents)[-1, -1], 0.0))
