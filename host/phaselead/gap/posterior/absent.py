"""How large what is absent may be: the posterior of an effect's size beside a set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.error_rates import ONE_SIDED_95
from phaselead.gap.posterior.missed import MOST_MISSED
from phaselead.gap.posterior.search import Contest
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.posterior.starts import SizedGroup, Starts
from phaselead.model import Effect


def largest_sizes(contest: Contest, fit: Fit, effects: Sequence[Effect]) -> Mapping[str, float]:
    """Upper bound at 95 %, in its unit, of the first size of each of some effects beside a set, at the shape that
    allows most; infinite where the records do not show it. Its equation may miss a share of it."""
    starts = Starts(contest.likelihood, effects) if contest.starts is None else contest.starts.of(contest.likelihood)
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
    """Upper bound of a size that was simulated at some values. Each gives a bound of its own, from the largest on, and
    one that the records rule out caps those of the smaller ones, which may show nothing. Where an effect is linear, the
    smallest that is ruled out and the largest that is not give the same bound. Where the first gives a smaller one, the
    bound of the second is raised by their ratio: what is between shows less than in proportion."""
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
