"""Which way a sensor counts, and how far it counts beside what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from phaselead.record.axis_record import Samples

MOSTLY = 0.5
"""Of the power of a position: what follows what was expected, before a factor between the two says anything."""


def counts_backwards(pairs: Iterable[tuple[Samples, Samples]]) -> bool:
    """Whether the position falls where the voltage rises, slowly; voltages and positions (n,) of each record.

    Each counts by how far it was driven, and by its correlation: a small sweep, during which the stage creeps, says
    little.
    """
    slow = 0.0
    for voltage, position in pairs:
        u, x = summed(voltage), summed(position)
        slow += float(u @ x) / (float(np.linalg.norm(x)) or 1.0)
    return slow < 0


def slow_gain(pairs: Sequence[tuple[Samples, Samples]]) -> float | None:
    """By which factor positions follow what was expected of them, slowly; None where most of them does not.

    ``pairs`` are what was expected and the position, (n,), of each record.
    """
    slowly = [(summed(expected), summed(position)) for expected, position in pairs]
    own = sum(float(p @ p) for p, _ in slowly)
    common = sum(float(p @ x) for p, x in slowly)
    seen = sum(float(x @ x) for _, x in slowly)
    if not common**2 > MOSTLY * own * seen:
        return None
    return common / own


def summed(values: Samples) -> Samples:
    """Values (n,) summed up: every frequency then counts by one over its square, so that a resonance, behind which the
    position runs against the voltage, is not mistaken for the sensor's direction."""
    total = np.cumsum(values - values.mean())
    return np.asarray(total - total.mean())
