"""Confidence intervals of named effects: linearised block bootstrap."""

from __future__ import annotations

import numpy as np

from phaselead.gap.compare import residual_amounts
from phaselead.gap.correction import Correction
from phaselead.gap.panel import Panel
from phaselead.gap.refit import Fitted, inner, outer
from phaselead.gap.result import Value
from phaselead.gap.search import full_moments, projection, with_free
from phaselead.model import Parameter
from phaselead.record import Samples

DRAWS = 400


def intervals(fitted: Fitted, panel: Panel, correction: Correction, seed: int) -> list[dict[str, Value]]:
    """Value, unit and 95 % interval of every parameter of every effect.

    ``panel`` holds the common columns of the training records. A draw weighs the blocks of these records anew (Efron
    and Tibshirani 1993, section 9.4, on the scores: full refits give the same to first order). Never narrower than the
    white-noise interval.
    """
    if not fitted.entries:
        return []
    draws = _draws(full_moments(panel, fitted), correction, seed)
    found: list[dict[str, Value]] = [{} for _ in fitted.entries]
    for j, (i, p) in enumerate(fitted.free):
        value = float(fitted.entries[i][1][p.name])
        found[i][p.name] = (value, p.unit, _interval(p, value, draws[:, j]))
    return found


def _interval(p: Parameter, value: float, shifts: Samples) -> tuple[float, float]:
    low, high = np.quantile(shifts, [0.025, 0.975])
    at = inner(p, value)
    ends = sorted((outer(p, at + float(low)), outer(p, at + float(high))))
    return min(ends[0], value), max(ends[1], value)


def _draws(moments: Samples, correction: Correction, seed: int) -> Samples:
    """(DRAWS, tangents) shifts of the parameters in internal units."""
    k = len(correction.index)
    target = moments.shape[-1] - 1
    tangents = np.arange(k, target)
    total = moments.sum(axis=0)
    projector = projection(total, correction)
    information = (projector.T @ total)[np.ix_(tangents, tangents)]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-8, hermitian=True)
    left = residual_amounts(moments, with_free(correction, tangents))
    scores = (moments @ left) @ projector[:, tangents] / scale
    rng = np.random.default_rng(seed)
    blocks = len(scores)
    weights = rng.multinomial(blocks, np.full(blocks, 1 / blocks), size=DRAWS) - 1.0
    shifts = np.asarray((weights @ scores) @ inverse / scale)
    white = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
    spread = shifts.std(axis=0)
    return np.asarray(shifts * np.maximum(1.0, white / np.maximum(spread, 1e-300)))
