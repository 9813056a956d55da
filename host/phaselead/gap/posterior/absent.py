"""How large what is absent may be: the posterior of an effect's size beside a set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.error_rates import ONE_SIDED_95
from phaselead.gap.posterior.missed import MOST_MISSED
from phaselead.gap.posterior.search import Contest
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.posterior.starts import Starts
from phaselead.model import Effect


def largest_sizes(contest: Contest, fit: Fit, effects: Sequence[Effect]) -> Mapping[str, float]:
    """Upper bound at 95 %, in its unit, of the first size of each of some effects beside a set, at the shape that
    allows most; infinite where the records do not show it. Its equation may miss a share of it."""
    starts = Starts(contest.likelihood, effects) if contest.starts is None else contest.starts.of(contest.likelihood)
    asked = {effect.name for effect in effects}
    found: dict[str, float] = {}
    for sized in starts.sizes(fit):
        if sized.group.effect.name not in asked:
            continue
        step = sized.group.steps[0]
        deviation = float(np.hypot(sized.deviation, MOST_MISSED * sized.amount))
        at_most = (abs(sized.amount) + ONE_SIDED_95 * deviation) * step
        name = sized.group.effect.name
        found[name] = max(found.get(name, 0.0), at_most)
    return found
