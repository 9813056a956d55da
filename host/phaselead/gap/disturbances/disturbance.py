"""What a test for disturbances is given, and what it finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from phaselead.gap.findings import Estimate
from phaselead.gap.residual import RunResidual

NEW_FROM = 1.5
"""Times the amplitude (or step) in the reference records from which something is new."""


@dataclass(frozen=True)
class Disturbance:
    """A disturbance that was found: its parameters, its mean power and why it is believed."""

    name: str
    params: dict[str, Estimate]
    power_um2: float
    why: str


Residuals = Sequence[RunResidual]
