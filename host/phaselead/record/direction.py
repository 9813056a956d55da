"""Which way a sensor counts, and how far it counts beside what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from phaselead.record.axis_record import Samples

MOSTLY = 0.5
"""Of the power of a position: what follows what was expected, before a factor between the two says anything."""
PREFIX = 1000.0
"""From one unit to the next: mV and V, nm and um, um and mm."""


def counts_backwards(pairs: Iterable[tuple[Samples, Samples]]) -> bool:
    """Whether the position falls where the voltage rises, slowly; voltages and positions (n,) of each record."""
    slow = 0.0
    for voltage, position in pairs:
        u, x = _slowly(voltage), _slowly(position)
        slow += float(u @ x) / (float(u @ u) or 1.0)
    return slow < 0


def slow_gain(pairs: Sequence[tuple[Samples, Samples]]) -> float | None:
    """By which factor positions follow what was expected of them, slowly; None where most of them does not.

    ``pairs`` are what was expected and the position, (n,), of each record.
    """
    slowly = [(_slowly(expected), _slowly(position)) for expected, position in pairs]
    own = sum(float(p @ p) for p, _ in slowly)
    common = sum(float(p @ x) for p, x in slowly)
    seen = sum(float(x @ x) for _, x in slowly)
    if not common**2 > MOSTLY * own * seen:
        return None
    return common / own


def in_another_unit(factor: float) -> bool:
    """Whether a factor is nearer to a prefix of a unit than to 1. One below 0 may be motion behind a resonance."""
    return factor > 0 and abs(np.log(factor)) > np.log(PREFIX) / 2


def _slowly(values: Samples) -> Samples:
    """Summed up: every frequency then counts by one over its square, so that a resonance, behind which the position
    runs against the voltage, is not mistaken for the sensor's direction."""
    summed = np.cumsum(values - values.mean())
    return np.asarray(summed - summed.mean())
