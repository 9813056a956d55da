"""Which way a sensor counts."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from phaselead.record.axis_record import Samples


def counts_backwards(pairs: Iterable[tuple[Samples, Samples]]) -> bool:
    """Whether the position falls where the voltage rises, slowly; voltages and positions (n,) of each record.

    Both are summed up first: every frequency then counts by one over its square, so that a resonance, behind which the
    position runs against the voltage, is not mistaken for the sensor's direction.
    """
    slow = 0.0
    for voltage, position in pairs:
        u, x = (np.cumsum(v - v.mean()) for v in (voltage, position))
        u, x = u - u.mean(), x - x.mean()
        slow += float(u @ x) / (float(u @ u) or 1.0)
    return slow < 0
