"""In which records what slow effects had done before still goes on: a mode rings, a lag relaxes.

Most records begin when all of that is over, and a normal prior as wide as what a stage can have done would charge every
record for finding nothing. So each effect in each record has a chance of either, and the sum over all of them counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from phaselead.record import Samples

STILL_MOVING = 0.5
"""Prior probability that what an effect had done before a record still goes on in it: nobody says when the stage last
moved."""


def still_moving(information: Samples, slope: Samples, of_effects: Sequence[int]) -> tuple[NDArray[np.bool_], float]:
    """Which of b columns of a record, each of an effect, most likely belong to what still goes on; and by how much the
    log evidence of all possibilities together is above that of this one.

    ``information`` (b, b) and ``slope`` (b,) are of their amounts, whose prior deviation is 1.
    """
    of = np.asarray(of_effects)
    effects = np.unique(of)
    chances = [effects[list(on)] for on in product((True, False), repeat=len(effects))]
    kept = [np.isin(of, moving) for moving in chances]
    gains = np.array([_log_gain(information, slope, one) for one in kept])
    log_prior = [
        len(moving) * np.log(STILL_MOVING) + (len(effects) - len(moving)) * np.log(1 - STILL_MOVING)
        for moving in chances
    ]
    best = int(np.argmax(gains))
    return kept[best], float(logsumexp(gains + np.array(log_prior)) - gains[best])


def _log_gain(information: Samples, slope: Samples, kept: NDArray[np.bool_]) -> float:
    """Log evidence of the amounts that are kept, above that of none."""
    if not kept.any():
        return 0.0
    normal = information[np.ix_(kept, kept)] + np.eye(int(kept.sum()))
    return float(0.5 * slope[kept] @ np.linalg.solve(normal, slope[kept]) - 0.5 * np.linalg.slogdet(normal)[1])
