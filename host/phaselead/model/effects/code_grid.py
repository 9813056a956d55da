"""Which codes of the output converter the voltages of a record belong to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.model.axis import Actuator
from phaselead.record import Samples

ON_GRID = 0.05
"""Distance from a code, in LSB, that rounding in a file leaves at the most."""
FEWEST_VALUES = 64
"""Different voltages from which on their common step is taken for the converter's."""
FINEST_BITS = 24
"""Of any converter: a finer step is that of a file's digits."""
LARGEST_DIVISOR = 8
"""The closest two codes of a record that is long enough to count are not more LSB apart."""
REFINEMENTS = 24
"""Of the step, with ever more distant voltages: digits in the file make that of two neighbours inexact."""


@dataclass(frozen=True)
class CodeGrid:
    """Voltages ``low_V + code step_V`` for the codes 0 to 2^bits - 1."""

    low_V: float
    step_V: float
    bits: int

    def codes(self, u_V: Samples) -> Samples:
        """The nearest codes (n,), whole numbers."""
        return np.clip(np.rint((u_V - self.low_V) / self.step_V), 0, 2**self.bits - 1)

    def holds(self, u_V: Samples) -> bool:
        """Whether every voltage is that of a code."""
        return bool(np.all(np.abs(u_V - self.low_V - self.step_V * self.codes(u_V)) < ON_GRID * self.step_V))

    @property
    def volts(self) -> Samples:
        """(2^bits,): of every code, were the converter straight."""
        return self.low_V + self.step_V * np.arange(2**self.bits)


def calibrated(actuator: Actuator) -> CodeGrid:
    """The codes as the stage file says."""
    return CodeGrid(actuator.u_min_V, (actuator.u_max_V - actuator.u_min_V) / 2**actuator.bits, actuator.bits)


def code_grid(actuator: Actuator, u_V: Samples) -> CodeGrid:
    """The codes of the converter that put out ``u_V`` (n,).

    They are the stage file's where these voltages are among its codes or have no common step (they were computed, or
    measured). Otherwise the record's own step is the LSB: codes of as many bits as the stage file says, about 0 V, or
    from 0 V up where they would not reach.
    """
    told = calibrated(actuator)
    if told.holds(u_V):
        return told
    step_V = common_step(u_V)
    if step_V is None:
        return told
    span_V = step_V * 2**actuator.bits
    for low_V in (-span_V / 2, 0.0):
        seen = CodeGrid(low_V, step_V, actuator.bits)
        if seen.holds(u_V):
            return seen
    return told


def common_step(u_V: Samples) -> float | None:
    """The largest step in V of which all voltages (n,) are multiples; None where there is none, or where it is one of
    decimal digits."""
    values = np.unique(u_V)
    if len(values) < FEWEST_VALUES:
        return None
    apart = np.diff(values)
    finest = float(values[-1] - values[0]) / 2**FINEST_BITS
    apart[apart <= finest] = np.inf
    closest = int(np.argmin(apart))
    away = values - values[closest]
    away = away[np.argsort(np.abs(away), kind="stable")]
    for divisor in range(1, LARGEST_DIVISOR + 1):
        step = _refined(away, float(apart[closest]) / divisor)
        if (
            step is not None
            and step > finest
            and abs(values[closest] / step - np.rint(values[closest] / step)) < ON_GRID
        ):
            return None if _decimal(step) else step
    return None


def _refined(away: Samples, step: float) -> float | None:
    """The step near ``step`` of which all distances ``away`` (n,), rising in size, are multiples."""
    for count in np.unique(np.geomspace(2, len(away), REFINEMENTS).astype(int)):
        whole = np.rint(away[:count] / step)
        if not whole.any():
            return None
        step = float(away[:count] @ whole / (whole @ whole))
    return step if _among(away, step) else None


def _among(values: Samples, step: float) -> bool:
    """Whether all values (n,) are multiples of a step."""
    return bool(np.all(np.abs(values / step - np.rint(values / step)) < ON_GRID))


def _decimal(step_V: float) -> bool:
    """Whether it is 1, 2 or 5 in some decimal place: the digits of a file or of a generator's display."""
    lead = step_V / 10 ** np.floor(np.log10(step_V) + 1e-9)
    return bool(np.min(np.abs(lead - np.array([1.0, 2.0, 5.0]))) < 1e-4)
