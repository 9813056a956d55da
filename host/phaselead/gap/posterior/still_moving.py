"""In which records what slow effects had done before still goes on: a mode rings, a lag relaxes.

Most records begin when all of that is over, and a normal prior as wide as what a stage can have done would charge every
record for finding nothing. So in each record it goes on or is over, and any number of records in which it does is as
likely (Scott and Berger 2010, on sets of regressors): nobody says when the stage last moved. The sum over all of that
counts. What one record says of it is taken as normal, with the weights that its blocks have.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from phaselead.record import Samples


def likeliest_moving(
    information: Samples, slope: Samples, of_effects: Sequence[int]
) -> tuple[NDArray[np.bool_], dict[int, float]]:
    """Which of b columns of a record, each of an effect, most likely belong to what still goes on; and the log evidence
    of each effect going on, above that of its being over.

    ``information`` (b, b) and ``slope`` (b,) are of their amounts, whose prior deviation is 1.
    """
    of = np.asarray(of_effects)
    effects = np.unique(of).tolist()
    gains = {}
    for on in product((True, False), repeat=len(effects)):
        moving = frozenset(effect for effect, goes_on in zip(effects, on, strict=True) if goes_on)
        gains[moving] = _log_gain(information, slope, np.isin(of, list(moving)))
    best = max(gains, key=lambda moving: gains[moving])
    return np.isin(of, list(best)), {e: gains[best | {e}] - gains[best - {e}] for e in effects}


def log_sum_over_records(log_ratios: Sequence[float]) -> float:
    """Log evidence of an effect going on in any of some records, above that of the likeliest ones; ``log_ratios`` are
    of each record alone."""
    n = len(log_ratios)
    of_number: Samples = np.full(n + 1, -np.inf)  # of all choices of so many records
    of_number[0] = 0.0
    for ratio in log_ratios:
        of_number[1:] = np.logaddexp(of_number[1:], of_number[:-1] + ratio)
    k = np.arange(n + 1)
    log_choices = gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)
    return float(logsumexp(of_number - log_choices) - np.log(n + 1) - np.maximum(log_ratios, 0.0).sum())


def _log_gain(information: Samples, slope: Samples, kept: NDArray[np.bool_]) -> float:
    """Log evidence of the amounts that are kept, above that of none."""
    if not kept.any():
        return 0.0
    normal = information[np.ix_(kept, kept)] + np.eye(int(kept.sum()))
    return float(0.5 * slope[kept] @ np.linalg.solve(normal, slope[kept]) - 0.5 * np.linalg.slogdet(normal)[1])
