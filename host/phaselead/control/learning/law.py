"""One step of iterative learning, line by line of the period.

The reference changes by alpha E / G, with the error E and the response G of each line; what is left of the error is
|1 - alpha G_true / G|. Bristow, Tharayil and Alleyne 2006, IEEE Control Systems Magazine 26(3), 96; the gain by
coherence is Wiener's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.control.learning.lines import Amplitudes, Lines
from phaselead.control.learning.response import LEAST_GAIN, Response

MARGIN = 0.3
"""A line is learned where its error is sure to shrink by this share a trial: |1 - G_true / G| is below 1 - MARGIN."""
PROBE_NOISE, PROBE_SHARE = 10.0, 0.1
"""A probe of a line whose response is in doubt: ten deviations of its noise, which tells the response to 10 %, or a
tenth of its error, whichever is more."""


@dataclass(frozen=True)
class Step:
    """What to add to the reference, (m,), and the lines (m,) that are learned and that are only probed."""

    change: Amplitudes
    learned: NDArray[np.bool_]
    probed: NDArray[np.bool_]


def next_step(error: Lines, response: Response, share: float = 1.0) -> Step:
    """``share`` of the step that the responses allow."""
    alpha = error.coherence / (1 + (response.doubt / 2) ** 2)
    sure = response.doubt <= 1 - MARGIN
    reaches = (error.heard != 0) & reached(response)
    step = error.amplitude / np.where(reaches, response.gain, 1)
    learned = reaches & sure
    probed = reaches & ~sure
    size = np.abs(error.amplitude)
    probe = np.maximum(PROBE_NOISE * np.sqrt(error.variance), PROBE_SHARE * size) / np.maximum(size, 1e-30)
    change = np.where(learned, share * alpha * step, 0) + np.where(probed, np.minimum(probe, 1.0) * step, 0)
    return Step(np.asarray(change), learned, probed)


def reached(response: Response) -> NDArray[np.bool_]:
    """Lines (m,) that the stage follows as the model has it, and not surely less as the trials show it."""
    return np.asarray(response.followed & (np.abs(response.gain) * (1 + response.doubt) >= LEAST_GAIN))
