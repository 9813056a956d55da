"""The likeliest slopes of an operator: what its records hardly show is not guessed from a few of their rows.

A play whose threshold is half of the swing moves in the last rows of the largest record alone. Least squares gives it
whatever weight these ask for, ten times that of all others together, and beyond the records the stage would jump.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phaselead.identify.operator.regressors import FitRun
from phaselead.identify.operator.solution import Solution, moments, of_records, solve_slopes


def likeliest_slopes(fits: list[FitRun], found: Solution, offset_weight: float) -> Solution:
    """The same operator with the likeliest slopes, where the weight of a play has the mean slope as its deviation
    beforehand.

    What an operator misses is smooth, so that a record says it once. Plays of a symmetric fit, and how many plays there
    are, are chosen without this.
    """
    of_all = of_records(fits, moments(fits, found.basis, found.delay_s, found.rest_fraction, found.modes))
    noise = found.error / float(np.sqrt(len(fits)))
    slopes, at_rest_um, error = solve_slopes(of_all, found.basis.n_segments, offset_weight, noise)
    return replace(found, slopes=slopes, at_rest_um=at_rest_um, error=error)
