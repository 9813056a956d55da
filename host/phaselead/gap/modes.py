"""Modes in the search: where the refit of one starts, and which is none, or the base's own that has moved.

The groups of a scan are few and broad, so that neighbours overlap; a mode of 1 % damping that lies between two of
them, or near one of the base's own, leaves a refit from there in the wrong valley. So it starts on a finer grid.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from phaselead.gap.discrepancy import Discrepancy
from phaselead.gap.metric import Regressors
from phaselead.gap.problem import Problem
from phaselead.gap.refit import Fitted, SizedEffect, bounded, conditional_moments
from phaselead.gap.regressors import HIGHEST_OF_RATE
from phaselead.model import Effect

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
