"""A section that makes the way through an axis and what undoes it level: a delay and no more, to near the first mode.

What undoes a mode or a low-pass rolls off itself, and the converter holds each value for a tick. Beside a delay, which
is looked ahead by, that leaves a gain that falls with f^2 and a phase that falls with f^3: on a move an error like its
acceleration and one like its jerk, which feedback takes for the stage's own and passes on to the loop's ringing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.model.sections import TICK_S, Section
from phaselead.record import Samples

LOOKED_AT = 0.1
"""Of the lowest corner: where the two are measured, low enough for the next orders to be a hundredth of them."""
HIGHEST_Hz = 200.0
"""Where they are measured when all corners are higher."""
MOST_LIFT = 0.25
"""Of what lifts the gain: it makes the fastest part of a path half as large again at most."""
LEVEL = 0.01
"""What the two are below of a way that is level, in ticks: an error of 1e-4 at 200 Hz."""


def hold(f_Hz: Samples) -> NDArray[np.complex128]:
    """Of a converter that holds its value for a tick, beside its delay of half a tick."""
    return np.asarray(np.sinc(np.asarray(f_Hz) * TICK_S), dtype=complex)


def level(response: NDArray[np.complex128], f_Hz: float) -> Section | None:
    """What makes a way level whose ``response`` at ``f_Hz`` (1,), beside its delay, is given; None for a level one.

    (1 + p - p/z) lifts the gain by p (1 + p) (w T)^2 / 2. An all-pass (a + 1/z)/(1 + a/z), g = (1 - a)/(1 + a), turns
    the phase by (g^3 - g) (w T)^3 / 12 beside its delay of g ticks.
    """
    w = 2 * np.pi * f_Hz * TICK_S
    fallen = -float(np.log(np.abs(response[0]))) / w**2
    p = min((float(np.sqrt(max(1 + 8 * fallen, 0.0))) - 1) / 2, MOST_LIFT)
    lift = 1 + p - p * np.exp(-1j * w)
    late = -float(np.angle(response[0] * lift * np.exp(-1j * w * p))) / w**3
    if late <= LEVEL:
        return None if abs(p) < LEVEL else Section((1 + p, -p, 0.0), (0.0, 0.0))
    g = float(np.max(np.real(np.roots([1.0, 0.0, -1.0, -12 * late]))))
    a = (1 - g) / (1 + g)
    return Section((a * (1 + p), 1 + p - a * p, -p), (a, 0.0))


def looked_at_Hz(corners_Hz: Sequence[float]) -> float:
    """Where ``level`` is to be asked of an axis with these modes and low-passes."""
    return LOOKED_AT * min((*corners_Hz, HIGHEST_Hz))
