"""How large what is absent may be: upper bounds of effects that were not named.

Of responses they are from the posterior of their size, of disturbances from all that is left of the records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.disturbances import Residuals, largest
from phaselead.gap.findings import Bound
from phaselead.gap.posterior import KNOWN_BEFORE, largest_sizes
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
    uppers = largest(train, holdout)
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
            untestable[effect.name] = f"{_hidden(upper / size.typical)}; what would show it: {effect.reveals}"
        else:
            found.append(Bound(effect.name, upper, size.unit))
    return found, untestable


def _hidden(times: float) -> str:
    """How much could hide in these records, in typical sizes, for a person."""
    return f"{times:.0f} times its typical size could hide here"


def _in_place_of_a_named(selection: Selection, effect: Effect) -> float:
    """Its size where it stands in the place of an effect that is tied with it: should that be wrong, it may be that
    large. Otherwise 0."""
    sets = [rival for claim in selection.claims for rival in claim.rivals]
    sizes = [abs(params[effect.sizes[0].name]) for rival in sets for e, params in rival if e.name == effect.name]
    return max(sizes, default=0.0)
