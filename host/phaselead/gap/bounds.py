"""What is not there: the largest size of every effect not named, and which these records cannot test at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.grow import Growth
from phaselead.gap.result import Bound
from phaselead.gap.search import Scanned, scan
from phaselead.model import Effect

ONE_SIDED = 1.645
UNLIKE = 1.5
"""A stage's own effect has not quite the catalogue's equation, so that these records may show less of it than there is:
by up to a third on trials."""
NEAR = 0.5
"""Share of the score of a named effect from which a rival came near it."""
MANY = 1000.0
HOPELESS = 20.0
"""An effect whose bound lies this many typical sizes up is not tested by these records."""


def bounds(
    growth: Growth, effects: Sequence[Effect], without: set[str], axis: str | None
) -> tuple[list[Bound], dict[str, str]]:
    """Bounds of the effects not in ``without``, and why others cannot be bounded, by name."""
    shapes = {s[0].effect.name: s for s in scan(growth.bench, growth.fitted, effects)}
    found, untestable = [], {}
    for effect in effects:
        if effect.name in without:
            continue
        if effect.name not in shapes:
            untestable[effect.name] = f"these records do not excite it; what would: {effect.reveals}"
            continue
        upper = max(*(_upper(s) for s in shapes[effect.name]), _in_place_of_a_named(growth, effect))
        size = effect.sizes[0]
        if upper > HOPELESS * size.typical or upper >= max(abs(size.low), size.high):
            untestable[effect.name] = f"{_hidden(upper / size.typical)}; what would show it: {effect.reveals}"
            continue
        found.append(Bound(effect.name, upper, size.unit, axis))
    return found, untestable


def _hidden(times: float) -> str:
    if not times < MANY:
        return "any size could hide here"
    return f"{times:.0f} times its typical size could hide here"


def _in_place_of_a_named(growth: Growth, effect: Effect) -> float:
    """How large it was when it was fitted in the place of an effect that was named, where it came near: should the name
    be wrong, it may be that large."""
    near = [
        rival.fitted.entries[-1][1]
        for one in growth.named
        for rival in one.rivals
        if rival.effect.name == effect.name and rival.score > NEAR * one.score
    ]
    return max((abs(params[effect.sizes[0].name]) for params in near), default=0.0)


def _upper(scanned: Scanned) -> float:
    """Of the first size parameter: how far its estimate and 1.645 of its deviations reach."""
    amount, std = abs(scanned.amounts[0]), scanned.std[0] * np.sqrt(scanned.inflation)
    return float(UNLIKE * (amount + ONE_SIDED * std) * abs(scanned.atom.steps[0]))
