"""How large: confidence intervals of named effects, and upper bounds of those that were not named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.gap.discrepancy import Discrepancy, residual_amounts
from phaselead.gap.findings import ONE_SIDED_95, Bound, Estimate, NamedEffect
from phaselead.gap.metric import Regressors
from phaselead.gap.refit import Fitted, from_internal, to_internal
from phaselead.gap.scan import ScannedShape, full_moments, projection, scan, with_free
from phaselead.gap.selection import Selection
from phaselead.model import Effect, Parameter, catalogue
from phaselead.record import Samples

BOOTSTRAP_DRAWS = 400
"""Of the bootstrap: its 2.5 % quantile is then the tenth from the end."""
EQUATION_MISFIT = 1.5
"""A stage's own effect has not quite the catalogue's equation, so that these records may show less of it than there is:
by up to a third on trials."""
HOPELESS = 20.0
"""An effect whose bound lies this many typical sizes up is not tested by these records."""
MANY_TIMES = 1000.0
"""Typical sizes from which a bound is not even worth saying."""


def confidence_intervals(
    fitted: Fitted, regressors: Regressors, discrepancy: Discrepancy, seed: int
) -> list[dict[str, Estimate]]:
    """Value, unit and 95 % interval of every parameter of every effect.

    ``regressors`` holds the common columns of the training records. A draw weighs the blocks of these records anew
    (Efron and Tibshirani 1993, section 9.4, on the scores: full refits give the same to first order). Never narrower
    than the white-noise interval.
    """
    if not fitted.entries:
        return []
    draws = _draws(full_moments(regressors, fitted), discrepancy, seed)
    found: list[dict[str, Estimate]] = [{} for _ in fitted.entries]
    for j, (i, p) in enumerate(fitted.free):
        value = float(fitted.entries[i][1][p.name])
        found[i][p.name] = (value, p.unit, _interval(p, value, draws[:, j]))
    return found


def _interval(p: Parameter, value: float, shifts: Samples) -> tuple[float, float]:
    """95 % interval of a value from draws (BOOTSTRAP_DRAWS,) of its shift in internal units; it holds the value."""
    low, high = np.quantile(shifts, [0.025, 0.975])
    at = to_internal(p, value)
    ends = sorted((from_internal(p, at + float(low)), from_internal(p, at + float(high))))
    return min(ends[0], value), max(ends[1], value)


def _draws(moments: Samples, discrepancy: Discrepancy, seed: int) -> Samples:
    """Draws (BOOTSTRAP_DRAWS, tangents) of the parameters' shifts in internal units, from the moments (blocks, k, k)
    of a fit."""
    k = len(discrepancy.index)
    target = moments.shape[-1] - 1
    tangents = np.arange(k, target)
    total = moments.sum(axis=0)
    projector = projection(total, discrepancy)
    information = (projector.T @ total)[np.ix_(tangents, tangents)]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-8, hermitian=True)
    left = residual_amounts(moments, with_free(discrepancy, tangents))
    scores = (moments @ left) @ projector[:, tangents] / scale
    rng = np.random.default_rng(seed)
    blocks = len(scores)
    weights = rng.multinomial(blocks, np.full(blocks, 1 / blocks), size=BOOTSTRAP_DRAWS) - 1.0
    shifts = np.asarray((weights @ scores) @ inverse / scale)
    white = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / scale
    spread = shifts.std(axis=0)
    return np.asarray(shifts * np.maximum(1.0, white / np.maximum(spread, 1e-300)))


def upper_bounds(
    selection: Selection, effects: Sequence[Effect], without: set[str], axis: str | None
) -> tuple[list[Bound], dict[str, str]]:
    """The largest size at 95 % of every effect that is not among ``without``, and why others have none, by name.

    ``axis`` is the axis in the result: None for single-axis data.
    """
    shapes = {s[0].effect.name: s for s in scan(selection.problem, selection.fitted, effects)}
    found, untestable = [], {}
    for effect in effects:
        if effect.name in without:
            continue
        if effect.name not in shapes:
            untestable[effect.name] = f"these records do not excite it; what would: {effect.reveals}"
            continue
        upper = max(*(_upper(s) for s in shapes[effect.name]), _in_place_of_a_named(selection, effect))
        size = effect.sizes[0]
        if upper > HOPELESS * size.typical or upper >= max(abs(size.low), size.high):
            untestable[effect.name] = f"{_hidden(upper / size.typical)}; what would show it: {effect.reveals}"
            continue
        found.append(Bound(effect.name, upper, size.unit, axis))
    return found, untestable


def raised_bounds(bounds: Sequence[Bound], provisional: Sequence[NamedEffect]) -> list[Bound]:
    """The bounds, none below the size, with its interval, at which an effect was adopted provisionally."""
    found = list(bounds)
    for i, bound in enumerate(bounds):
        for one in provisional:
            value = one.params.get(catalogue()[one.name].sizes[0].name) if one.name == bound.name else None
            if value is not None:
                at_most = float(np.max(np.abs([value[0], *value[2]])))
                found[i] = replace(bound, upper_95=max(bound.upper_95, at_most))
    return found


def _hidden(times: float) -> str:
    """How much could hide in these records, in typical sizes, for a person."""
    if not times < MANY_TIMES:
        return "any size could hide here"
    return f"{times:.0f} times its typical size could hide here"


def _in_place_of_a_named(selection: Selection, effect: Effect) -> float:
    """Its size where it stands in the place of an effect that is tied with it: should that be wrong, it may be that
    large. Otherwise 0."""
    sets = [rival for claim in selection.claims for rival in claim.rivals]
    sizes = [abs(params[effect.sizes[0].name]) for rival in sets for e, params in rival if e.name == effect.name]
    return max(sizes, default=0.0)


def _upper(scanned: ScannedShape) -> float:
    """Upper bound at 95 % of the first size parameter, from a scan: the estimate and its deviation."""
    amount, std = abs(scanned.amounts[0]), scanned.std[0] * np.sqrt(scanned.inflation)
    return float(EQUATION_MISFIT * (amount + ONE_SIDED_95 * std) * abs(scanned.group.steps[0]))
