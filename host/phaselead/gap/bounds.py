"""How large what is absent may be: upper bounds of effects that were not named, from the posterior of their size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.gap.findings import ONE_SIDED_95, Bound, NamedEffect
from phaselead.gap.metric import LEAST_POWER
from phaselead.gap.posterior import KNOWN_BEFORE, Beside, beside
from phaselead.gap.regressors import Index, RegressorGroup
from phaselead.gap.selection import Selection
from phaselead.model import Effect, catalogue
from phaselead.record import Samples

ROUNDS = 3
"""In which a bound and what the equation of an effect of that size may miss are found in turn."""
MANY_TIMES = 1000.0
"""Typical sizes from which a bound is not even worth saying."""


def upper_bounds(
    selection: Selection, effects: Sequence[Effect], without: set[str], axis: str | None
) -> tuple[list[Bound], dict[str, str]]:
    """The largest size at 95 % of every effect that is not among ``without``, and why others have none, by name.

    ``axis`` is the axis in the result: None for single-axis data. An effect has no bound where the records leave its
    size as unknown as it was.
    """
    assert selection.contest is not None
    problem = selection.problem
    others = beside(selection.contest.solver, selection.fitted.entries)
    moments = others.moments(problem.train)
    found, untestable = [], {}
    for effect in effects:
        if effect.name in without:
            continue
        places = [
            (group, problem.layout.columns_of(i)) for i, group in enumerate(problem.layout.groups)
            if group.effect.name == effect.name
        ]  # fmt: skip
        shown = [(group, columns) for group, columns in places if moments[columns[0], columns[0]] > LEAST_POWER]
        if not shown:
            untestable[effect.name] = f"these records do not excite it; what would: {effect.reveals}"
            continue
        upper = max(_largest(others, moments, shown), _in_place_of_a_named(selection, effect))
        size = effect.sizes[0]
        if upper > KNOWN_BEFORE * size.typical or upper >= max(abs(size.low), size.high):
            untestable[effect.name] = f"{_hidden(upper / size.typical)}; what would show it: {effect.reveals}"
            continue
        found.append(Bound(effect.name, upper, size.unit, axis))
    return found, untestable


def _largest(others: Beside, moments: Samples, shown: Sequence[tuple[RegressorGroup, Index]]) -> float:
    """The largest bound of an effect's first size over its shapes, with what its own equation may miss at the shape
    that allows most. ``moments`` (k, k) are of all columns and, last, the residual."""
    of_shapes = [
        (_at_most(moments[np.ix_([*columns, -1], [*columns, -1])]) * abs(group.steps[0]), i)
        for i, (group, columns) in enumerate(shown)
    ]
    largest, i = max(of_shapes)
    group = shown[i][0]
    if largest > KNOWN_BEFORE * group.effect.sizes[0].typical:
        return largest
    own = others.own_moments(group)
    steps = largest / abs(group.steps[0])
    for _ in range(ROUNDS):
        steps = _at_most(others.with_own_misfit(own, len(group.steps), steps))
    return max(largest, steps * abs(group.steps[0]))


def _at_most(moments: Samples) -> float:
    """Upper bound at 95 %, in steps, of the first of some sizes from the moments (q + 1, q + 1) of their columns and
    the residual: the estimate and its deviation."""
    normal = moments[:-1, :-1] + KNOWN_BEFORE**-2 * np.diag([0.0, *np.ones(len(moments) - 2)])
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    deviation = float(np.sqrt(max(inverse[0, 0], 1 / normal[0, 0])))
    return abs(float(inverse[0] @ moments[:-1, -1])) + ONE_SIDED_95 * deviation


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
