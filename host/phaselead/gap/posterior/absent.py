"""How large what is absent may be: the posterior of an effect's size beside a set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.findings import ONE_SIDED_95
from phaselead.gap.posterior.likelihood import MOST_MISSED, Fit, Likelihood
from phaselead.gap.posterior.starts import Starts
from phaselead.model import Effect


def largest_sizes(likelihood: Likelihood, fit: Fit, effects: Sequence[Effect]) -> Mapping[str, float]:
    """Upper bound at 95 %, in its unit, of the first size of every effect beside a set, at the shape that allows most;
    infinite where the records do not show it. Its equation may miss a share of it."""
    found: dict[str, float] = {}
    for sized in Starts(likelihood, effects).sizes(fit):
        step = abs(sized.group.steps[0])
        deviation = float(np.hypot(sized.deviation, MOST_MISSED * sized.amount))
        at_most = (abs(sized.amount) + ONE_SIDED_95 * deviation) * step
        name = sized.group.effect.name
        found[name] = max(found.get(name, 0.0), at_most)
    return found
