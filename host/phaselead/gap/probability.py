"""How probable it is that an effect that is named is there.

The one place where points become probabilities. The points of the search are twice a gain in log likelihood less a
price for each parameter, so that half of them stands for a log evidence (Schwarz 1978); rivals and the model without
the effect are equally probable beforehand. What else an equation may miss is not in it, so that these probabilities are
too sure of themselves: read 0.99 as "beats every rival", not as a frequency.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

NOTHING = 0.0
"""Points of the model without the effect, against which points are counted."""


def probability_from_points(points: float, of_rivals: Sequence[float] = ()) -> float:
    """Probability, 0 to 1, of an effect with these points beside those of its rivals and of the model without it."""
    log_evidence = np.array([points, NOTHING, *of_rivals]) / 2
    weights = np.exp(log_evidence - log_evidence.max())
    return float(weights[0] / weights.sum())


def probability_from_z(z: float) -> float:
    """The same where one test says by how many standard deviations held-out records show the effect."""
    return probability_from_points(z**2 if z > 0 else 0.0)


def probability_from_false_alarm(risk: float) -> float:
    """The same where a test with this probability of a false alarm has found it."""
    return 1.0 - risk
