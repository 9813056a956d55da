"""One step of the search: scan the catalogue by sensitivities, then refit the most promising effects.

The groups of a scan are few and broad, so that neighbours overlap. A mode of 1 % damping that lies between two of
them, or near one of the base's own, leaves a refit from there in the wrong valley: its refit also starts on a finer
grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, pinvh

from phaselead.gap.discrepancy import Discrepancy, flexible_residual
from phaselead.gap.metric import LEAST_POWER, Regressors
from phaselead.gap.problem import Problem
from phaselead.gap.refit import Fitted, SizedEffect, bounded, conditional_moments, fresh_columns, refit, squares_left
from phaselead.gap.regressors import HIGHEST_OF_RATE, Index, RegressorGroup
from phaselead.model import Effect, Parameter
from phaselead.record import Samples

FULLY_REFITTED = 3
"""How many effects are refitted to the end; the others only roughly."""
ROUGH_STEPS = 2
"""Of a rough refit."""
SHAPE_STARTS = 2
"""From how many shapes each is refitted."""
START_FACTORS = (0.3, 1.0, 3.0)
"""Multiples of a linear estimate from which a refit may start: some effects are linear in their size only near 0."""
LEAST_REFIT_GAIN = 10.0
"""Gain worth a refit, where the penalty asks for less."""
LEAST_OVER_SCATTER, LEAST_OVER_SCATTER_WITH_REFERENCE = 0.1, 0.4
"""Of the penalty, gain worth a refit over how the residual scatters along an effect; more of it with reference records,
which say what the base leaves."""
FINE_GRID_SHARE = 0.05
"""Of the whitened squares: a mode that may take this much is worth a fine grid of starts."""
MOST_REFITTED = 7
"""Effects refitted in one step."""
FAR_APART = 1.0
"""Natural logarithm of the ratio from which two values of a shape are no neighbours."""
SECOND_START = 0.5
"""Of the best shape's score: what another shape needs to be a start as well."""
BOUND_SHARE = 0.001
"""Relative distance to a bound from which a parameter stands at it."""
FREE_PRECISION = 1e-9
"""Prior precision of a column that may take any amount."""
MODE_FINE_RATIO, MODE_FINE_ZETAS = 1.05, (0.01, 0.04)
"""Grid of starts: frequencies in this ratio, at these dampings."""
MODE_STARTS, MODES_APART = 2, 1.2
"""How many starts, and the least ratio of their frequencies."""
LOWEST_OF_RATE = 0.005
"""Of the sampling rate: below it a mode is no more than a slow bend."""
MOST_DAMPED = 0.25
"""Damping above which what looks like a mode is none: those of flexures lie below 0.1."""
SAME_MODE_RATIO, SAME_MODE_SHARE = 1.15, 0.3
"""A mode nearer than this ratio in frequency to one of the base's, and carrying less than this share of the motion, is
that one, moved."""


@dataclass(frozen=True)
class ScannedShape:
    """The best shape of one effect for the residual as it is. Squares are in units of the noise along the group."""

    effect: Effect
    group: RegressorGroup
    amounts: tuple[float, ...]
    """Least-squares amount of each column, in steps."""
    gain: float
    """Whitened squares that they explain."""
    score: float
    """The gain over the inflation, less the penalty."""
    inflation: float
    """By how much more than white noise the residual scatters along the columns, at least 1."""


@dataclass(frozen=True)
class Refitted:
    """An effect refitted together with those named before it."""

    effect: Effect
    fitted: Fitted


def scan(problem: Problem, fitted: Fitted, candidates: Sequence[Effect]) -> list[list[ScannedShape]]:
    """Score test of every candidate for the residual of a fit: per effect its shapes, the best first, and the effects
    by their best. Effects that these records cannot show at all are left out."""
    moments = _scan_moments(problem, fitted)
    names = {e.name for e in candidates}
    by_name: dict[str, list[ScannedShape]] = {}
    for i, group in enumerate(problem.layout.groups):
        if group.effect.name not in names:
            continue
        result = moments.estimate(problem.layout.columns_of(i))
        if result is None:
            continue
        amounts, gain, inflation = result
        inflation = max(inflation, problem.reference_inflation.get(group.effect.name, 1.0))
        score = gain / inflation - penalty(problem, group.effect)
        by_name.setdefault(group.effect.name, []).append(
            ScannedShape(group.effect, group, tuple(amounts.tolist()), gain, score, inflation)
        )
    found = [sorted(shapes, key=lambda s: -s.score) for shapes in by_name.values()]
    return sorted(found, key=lambda shapes: -shapes[0].score)


@dataclass(frozen=True)
class _ConditionalMoments:
    """Moments (k, k) of the training runs conditional on what is fitted already."""

    total: Samples
    inflation: Samples
    """(k,) by how much more than white noise the residual scatters from block to block along each column."""
    target: int
    """Column of the residual."""

    def estimate(self, columns: Index) -> tuple[Samples, float, float] | None:
        """Amounts of ``columns``, gain in squares and inflation; None where no column has power."""
        power = np.diag(self.total)[columns]
        seen = power > LEAST_POWER
        if not seen.any():
            return None
        live = columns[seen]
        normal = self.total[np.ix_(live, live)] + 1e-9 * np.diag(power[seen])
        amounts = np.zeros(len(columns))
        amounts[seen] = _inverse(normal) @ self.total[live, self.target]
        return amounts, float(self.total[columns, self.target] @ amounts), float(self.inflation[live].max())


def _inverse(normal: Samples) -> Samples:
    """Inverse of a normal matrix (k, k); a pseudo-inverse where two columns are the same once nuisances are taken
    out."""
    try:
        return np.asarray(cho_solve(cho_factor(normal), np.eye(len(normal))))
    except LinAlgError:
        return np.asarray(pinvh(normal, rtol=1e-9))


def _scan_moments(problem: Problem, fitted: Fitted) -> _ConditionalMoments:
    """Everything fitted so far becomes a nuisance: common columns shrunk, tangents free."""
    moments = full_moments(problem.train, fitted)
    target = moments.shape[-1] - 1
    tangents = np.arange(problem.layout.size, target)
    nuisances = with_free(problem.common, tangents)
    shifted = nuisances.mean_removed(moments, target)
    total = shifted.sum(axis=0)
    projector = projection(total, nuisances)
    conditional = projector.T @ total
    amounts = flexible_residual(moments, nuisances, np.arange(target), target)
    amounts[nuisances.index] += nuisances.mean  # shifted moments have the mean taken out already
    return _ConditionalMoments(conditional, block_inflation(shifted, projector, amounts), target)


def full_moments(regressors: Regressors, fitted: Fitted) -> Samples:
    """Moments (blocks, k, k) of [regressors, tangents, residual] at a fit."""
    return regressors.with_columns(
        [fresh_columns(t, fitted.entries, fitted.free) for t in regressors.metric.modelled_runs]
    )


def with_free(discrepancy: Discrepancy, tangents: Index) -> Discrepancy:
    """The discrepancy with further columns ``tangents`` that may take any amount."""
    k, n = len(discrepancy.index), len(tangents)
    precision = np.zeros((k + n, k + n))
    precision[:k, :k] = discrepancy.precision
    precision[k:, k:] = FREE_PRECISION * np.eye(n)
    return Discrepancy(
        np.concatenate([discrepancy.index, tangents]).astype(np.intp),
        np.concatenate([discrepancy.mean, np.zeros(n)]),
        precision,
    )


def projection(total: Samples, nuisances: Discrepancy) -> Samples:
    """Matrix P (k, k) for which ``columns @ P`` is what is left of each column after the nuisances were fitted to it.

    ``total`` (k, k) are moments of all blocks, with the mean of the nuisances taken out."""
    index = nuisances.index
    matrix = np.eye(len(total))
    if len(index):
        inner = total[np.ix_(index, index)] + nuisances.precision
        inner += 1e-10 * (np.trace(inner) / len(inner)) * np.eye(len(inner))
        matrix[index] -= cho_solve(cho_factor(inner), total[index])
    return matrix


def block_inflation(moments: Samples, projector: Samples, left: Samples) -> Samples:
    """Mean square (k,) of the blocks' scores over what white noise of unit variance would give, at least 1.

    ``moments`` (blocks, k, k), ``projector`` as ``projection`` gives it, ``left`` (k,) the amounts of the residual.
    """
    scores = (moments @ left) @ projector
    information = np.einsum("kp,bkl,lp->bp", projector, moments, projector, optimize=True).sum(axis=0)
    squares = (scores**2).sum(axis=0)
    blocks = len(moments)
    return np.asarray(np.maximum(1.0, squares / np.maximum(information, 1e-300) * blocks / max(blocks - 1, 1)))


def refit_best(problem: Problem, fitted: Fitted, scanned: Sequence[list[ScannedShape]]) -> list[Refitted]:
    """Refit what a scan found worth it jointly with what is fitted, the most promising to the end; best first."""
    rough = [_roughly_refitted(problem, fitted, shapes) for shapes in _promising(problem, scanned)]
    rough.sort(key=lambda t: t.fitted.squares + penalty(problem, t.effect))
    best, others = rough[:FULLY_REFITTED], rough[FULLY_REFITTED:]
    best = [replace(t, fitted=refit(problem.train_common, problem.discrepancy, t.fitted.entries)) for t in best]
    kept = [
        t
        for t in [*best, *others]
        if not at_a_bound(problem, t) and not no_mode_of_its_own(problem, t.fitted.entries[-1])
    ]
    return sorted(kept, key=lambda t: t.fitted.squares + penalty(problem, t.effect))


def at_a_bound(problem: Problem, tried: Refitted) -> bool:
    """Whether one of its sizes ran as far as the catalogue allows, or, where reference records hold the base, a shape
    to where no stage is: then it imitates something else."""
    effect, params = tried.fitted.entries[-1]
    far = [*effect.sizes, *(p for p in effect.shapes if p.extreme and problem.reference is not None)]
    return any(_at(p, params[p.name]) for p in far)


def _at(p: Parameter, value: float) -> bool:
    """Whether a value stands at a bound of its parameter; a lower bound of 0 or more is none."""
    return value >= (1 - BOUND_SHARE) * p.high or value <= p.low + BOUND_SHARE * abs(p.low) < 0


def _promising(problem: Problem, scanned: Sequence[list[ScannedShape]]) -> list[list[ScannedShape]]:
    """Effects that gain their penalty by their sensitivities, those with the largest gain first.

    How the residual scatters along an effect counts only against those that gain little: while something large is
    missing, it is what scatters.
    """
    scattered = LEAST_OVER_SCATTER if problem.reference is None else LEAST_OVER_SCATTER_WITH_REFERENCE
    worth = [
        shapes
        for shapes in scanned
        if max(s.gain for s in shapes) > max(penalty(problem, shapes[0].effect), LEAST_REFIT_GAIN)
        and max(s.gain / s.inflation for s in shapes) > scattered * penalty(problem, shapes[0].effect)
    ]
    return sorted(worth, key=lambda shapes: -max(s.gain for s in shapes))[:MOST_REFITTED]


def penalty(problem: Problem, effect: Effect) -> float:
    """What an effect must gain to be even: ln n for each of its parameters (Schwarz 1978, BIC)."""
    return float(np.log(max(problem.train.metric.rows, 2))) * len(effect.parameters)


def _roughly_refitted(problem: Problem, fitted: Fitted, shapes: list[ScannedShape]) -> Refitted:
    """The best of refits in a few steps from different shapes."""
    best: Fitted | None = None
    starts = [linear_start(problem, fitted, start) for start in different_shapes(shapes)]
    if is_mode(shapes[0].effect) and max(s.gain for s in shapes) > FINE_GRID_SHARE * fitted.squares:
        starts += mode_starts(problem.train_common, problem.discrepancy, fitted, shapes[0].effect)
    for start in starts:
        result = refit(problem.train_common, problem.discrepancy, start, ROUGH_STEPS)
        if best is None or result.squares < best.squares:
            best = result
    assert best is not None
    return Refitted(shapes[0].effect, best)


def linear_start(problem: Problem, fitted: Fitted, scanned: ScannedShape) -> list[SizedEffect]:
    """A start for a refit: the fitted effects, and the new one at the multiple of its linear estimate that leaves
    least."""
    effect = scanned.effect
    tries = [
        [*fitted.entries, (effect, bounded(effect, scanned.group.params([factor * a for a in scanned.amounts])))]
        for factor in START_FACTORS
    ]
    return min(tries, key=lambda entries: squares_left(problem.train_common, problem.discrepancy, entries))


def different_shapes(shapes: Sequence[ScannedShape]) -> list[ScannedShape]:
    """The best shape, and the best that is not its neighbour."""
    chosen = list(shapes[:1])
    for other in shapes[1:]:
        if len(chosen) == SHAPE_STARTS:
            break
        if other.score > SECOND_START * chosen[0].score and _apart(other, chosen[0]):
            chosen.append(other)
    return chosen


def _apart(a: ScannedShape, b: ScannedShape) -> bool:
    """Whether two shapes of one effect are no neighbours."""
    return any(
        abs(np.log(max(a.group.shapes[n], 1e-12) / max(b.group.shapes[n], 1e-12))) > FAR_APART for n in a.group.shapes
    )


def is_mode(effect: Effect) -> bool:
    """Whether it is a single mode, which a sharp frequency gives away."""
    return effect.peak is not None


def mode_starts(
    regressors: Regressors, discrepancy: Discrepancy, fitted: Fitted, effect: Effect
) -> list[list[SizedEffect]]:
    """Starts for a refit: the fitted effects and a mode at each of the frequencies of a fine grid that leave least,
    with the share that fits there; none where the sampling shows no such frequency. ``effect`` is a mode."""
    assert effect.peak is not None
    f, zeta = (effect.parameter(name) for name in effect.peak)
    size = effect.sizes[0]
    step_s = regressors.metric.modelled_runs[0].run.step_s
    low, high = max(f.low, LOWEST_OF_RATE / step_s), min(f.high, HIGHEST_OF_RATE / step_s)
    if low >= high:
        return []
    grid_Hz = np.geomspace(low, high, max(2, round(np.log(high / low) / np.log(MODE_FINE_RATIO))))
    points = [{f.name: float(f_Hz), zeta.name: damping} for f_Hz, damping in product(grid_Hz, MODE_FINE_ZETAS)]
    columns = []
    for modelled in regressors.metric.modelled_runs:
        answer = modelled.answer(fitted.entries)
        one = [modelled.answer([*fitted.entries, (effect, {**at, size.name: size.typical})]) - answer for at in points]
        columns.append(np.stack([*one, modelled.run.x_um[modelled.run.rows] - answer], axis=1))
    left = conditional_moments(regressors, discrepancy, columns)
    power, along = np.diag(left)[:-1], left[:-1, -1]
    amounts = np.divide(along, power, out=np.zeros_like(along), where=power > 0)
    found: list[dict[str, float]] = []
    for i in np.argsort(-along * amounts):
        if all(abs(np.log(points[i][f.name] / other[f.name])) > np.log(MODES_APART) for other in found):
            found.append({**points[i], size.name: float(amounts[i]) * size.typical})
        if len(found) == MODE_STARTS:
            break
    return [[*fitted.entries, (effect, bounded(effect, params))] for params in found]


def without_peak(problem: Problem, entry: SizedEffect) -> bool:
    """Whether it is a mode so strongly damped that it has no peak: then it imitates a lag.

    Not asked while a base is made from nothing: there a jump's lag and ringing are found one after the other, and the
    mode sharpens once the lag is in the model too.
    """
    effect, params = entry
    if problem.reference is None or effect.peak is None:
        return False
    return params[effect.peak[1]] > MOST_DAMPED


def no_mode_of_its_own(problem: Problem, entry: SizedEffect) -> bool:
    """Whether it is a mode without a peak, or one where the base has one: then that one has moved."""
    return without_peak(problem, entry) or is_own_mode_moved(problem, entry)


def is_own_mode_moved(problem: Problem, entry: SizedEffect) -> bool:
    """Whether a small mode lies so close to one of the base's that both are one. Asked where there are reference
    records, to which the base was fitted."""
    effect, params = entry
    if problem.reference is None or effect.peak is None:
        return False
    name = effect.peak[0]
    own = [adopted.params[name] for adopted in problem.axis.effects if adopted.name == effect.name]
    own_Hz = np.concatenate([np.zeros(0), *(np.atleast_1d(np.asarray(f_Hz, dtype=np.float64)) for f_Hz in own)])
    small = abs(params[effect.sizes[0].name]) < SAME_MODE_SHARE
    return small and bool(np.any(np.abs(np.log(params[name] / own_Hz)) < np.log(SAME_MODE_RATIO)))
