"""How large what is absent may be: upper bounds of effects that were not named.

Of responses they are from the posterior of their size, of disturbances from all that is left of the records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.disturbances import Residuals
from phaselead.gap.error_rates import ONE_SIDED_95
from phaselead.gap.findings import Bound
from phaselead.gap.posterior import KNOWN_BEFORE, MOST_MISSED, Contest, Fit, SizedGroup
from phaselead.gap.residual import power_um2
from phaselead.gap.selection import Selection
from phaselead.model import Effect

MANY_TIMES = 1000.0
"""Typical sizes from which the records do not excite an effect."""


def upper_bounds(
    selection: Selection, effects: Sequence[Effect], without: set[str]
) -> tuple[list[Bound], dict[str, str]]:
    """The largest size at 95 % of every effect that is not among ``without``, and why others have none, by name.

    An effect has no bound where the records leave its size as unknown as it was.
    """
    others = selection.contest.likelihood.fit(selection.entries, steps=0)
    absent = [effect for effect in effects if effect.name not in without]
    sizes = largest_sizes(selection.contest, others, absent)
    uppers = {e.name: max(sizes.get(e.name, np.inf), _in_place_of_a_named(selection, e)) for e in absent}
    return _told(absent, uppers)


def disturbance_bounds(
    train: Residuals, holdout: Residuals, effects: Sequence[Effect], without: set[str]
) -> tuple[list[Bound], dict[str, str]]:
    """The same of the disturbances among the effects that have a test of their own and were not found by it."""
    uppers = largest_disturbances(train, holdout)
    absent = [effect for effect in effects if effect.seen_as in uppers and effect.name not in without]
    return _told(absent, {e.name: uppers[e.seen_as] for e in absent if e.seen_as is not None})


def _told(absent: Sequence[Effect], uppers: Mapping[str, float]) -> tuple[list[Bound], dict[str, str]]:
    """The bounds that say anything, and why the others do not, by name."""
    found, untestable = [], {}
    for effect in absent:
        size, upper = effect.sizes[0], uppers[effect.name]
        if upper > MANY_TIMES * size.typical:
            untestable[effect.name] = f"these records do not excite it; what would: {effect.reveals}"
        elif upper > KNOWN_BEFORE * size.typical or upper >= max(abs(size.low), size.high):
            hides = f"{upper / size.typical:.0f} times its typical size could hide here"
            untestable[effect.name] = f"{hides}; what would show it: {effect.reveals}"
        else:
            found.append(Bound(effect.name, upper, size.unit))
    return found, untestable


def _in_place_of_a_named(selection: Selection, effect: Effect) -> float:
    """Its size where it stands in the place of an effect that is tied with it: should that be wrong, it may be that
    large. Otherwise 0."""
    sets = [rival for claim in selection.claims for rival in claim.rivals]
    sizes = [abs(params[effect.sizes[0].name]) for rival in sets for e, params in rival if e.name == effect.name]
    return max(sizes, default=0.0)


def largest_sizes(contest: Contest, fit: Fit, effects: Sequence[Effect]) -> Mapping[str, float]:
    """Upper bound at 95 %, in its unit, of the first size of each of some effects beside a set, at the shape that
    allows most; infinite where the records do not show it. Its equation may miss a share of it."""
    starts = contest.starts.of(contest.likelihood)
    asked = {effect.name for effect in effects}
    of_shapes: dict[tuple[str, tuple[float, ...]], list[SizedGroup]] = {}
    for sized in starts.sizes(fit):
        if (name := sized.group.effect.name) in asked:
            of_shapes.setdefault((name, tuple(sized.group.shapes.values())), []).append(sized)
    found: dict[str, float] = {}
    for (name, _), at_sizes in of_shapes.items():
        found[name] = max(found.get(name, 0.0), _largest(at_sizes))
    return found


def _largest(at_sizes: Sequence[SizedGroup]) -> float:
    """Upper bound of a size that was simulated at some values.

    They are tried from the largest down. While the bound found at a value lies below it, that value is ruled out and
    caps all that follow, since a smaller simulation may show nothing. The first that is not ruled out decides. For a
    linear effect its bound equals the one before. Where the larger simulation gave a smaller bound, the bound is raised
    by their ratio, because sizes in between show less than in proportion.
    """
    found, of_larger, cannot_be = np.inf, 0.0, np.inf
    for sized in sorted(at_sizes, key=lambda one: -one.group.steps[0]):
        deviation = float(np.hypot(sized.deviation, MOST_MISSED * sized.amount))
        step = sized.group.steps[0]
        said = (abs(sized.amount) + ONE_SIDED_95 * deviation) * step
        if said >= step:
            raised = said * said / of_larger if of_larger else said
            return min(max(said, raised, of_larger), cannot_be)
        found = min(said, cannot_be)
        of_larger, cannot_be = said, step
    return found


def largest_disturbances(train: Residuals, holdout: Residuals) -> dict[str, float]:
    """By ``Effect.seen_as`` the size, in its unit, beyond which the residuals would be larger than they are. What needs
    records at rest, or in motion, is left out where there are none.

    These are no fits: what is left holds the sensor's noise and what the model misses as well.
    """
    every = [*train, *holdout]
    at_rest = [r for r in every if r.run.idle]
    moving = [r for r in every if r.run.driven]
    found = {}
    if at_rest:
        found["lines"], found["band"] = math.sqrt(2) * _rms_um(at_rest), _rms_um(at_rest)
    if moving:
        # At rest all rows may lie on one step.
        found["grid"] = math.sqrt(12) * _rms_um(moving)
        speed = math.sqrt(np.mean(np.concatenate([r.speed_um_per_s**2 for r in moving])))
        if speed > 0:
            found["speed"] = _rms_um(moving) / speed
    return found


def _rms_um(residuals: Residuals) -> float:
    return math.sqrt(power_um2([r.error_um - r.error_um.mean() for r in residuals]))
