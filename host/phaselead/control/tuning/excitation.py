"""Random-phase multisines on an odd-random grid: what is excited, and what listens.

Schoukens, Pintelon and Rolain 2012, Mastering System Identification in 100 Exercises, chapters 3 and 6: only odd lines
are excited, and of every group of them one at random is not. What is heard at even lines is then even distortion, at
odd lines that were left out odd distortion, and what differs from period to period is noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phaselead.device import TICK_HZ
from phaselead.record import Samples
from phaselead.waveforms import POINTS, Sampled

Lines = NDArray[np.int_]

GROUP = 4
"""Odd lines of which one listens: the resolution falls by a quarter."""
FLAT_TO_Hz = 300.0
"""Above it amplitudes fall as 1/f: what is faster costs slew rate and is heard as well, since noise is white."""
STEP = {"V": 2.0**-24, "um": 2.0**-16}
"""Of what the device takes for a level."""


@dataclass(frozen=True)
class Grid:
    """Lines of a period of ``ticks``, up to ``highest_Hz``."""

    ticks: int
    excited: Lines
    odd: Lines
    """That are not excited."""
    even: Lines

    @classmethod
    def odd_random(cls, ticks: int, highest_Hz: float, seed: int = 0) -> Grid:
        last = int(highest_Hz * ticks / TICK_HZ)
        lines = np.arange(1, last + 1)
        odd = lines[lines % 2 == 1]
        drawn = np.random.default_rng(seed).integers(0, GROUP, len(odd) // GROUP)
        silent = odd[np.arange(len(drawn)) * GROUP + drawn]
        return cls(ticks, np.setdiff1d(odd, silent), silent, lines[lines % 2 == 0])

    @property
    def f_Hz(self) -> float:
        """Of line 1."""
        return TICK_HZ / self.ticks

    def frequencies(self, lines: Lines) -> Samples:
        return np.asarray(lines * self.f_Hz)


def multisine(grid: Grid, swing: float, middle: float, unit: Literal["V", "um"], seed: int) -> Sampled:
    """One period about ``middle`` with a peak-to-peak of ``swing`` and random phases, in 1024 points; where they are
    more than a tick apart straight lines join them."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(grid.excited))
    sizes = 1 / np.maximum(1.0, grid.frequencies(grid.excited) / FLAT_TO_Hz)
    turns = np.arange(POINTS) / POINTS
    values = (sizes * np.cos(2 * np.pi * np.outer(turns, grid.excited) + phases)).sum(axis=1)
    period = (values - values.min()) / np.ptp(values)
    lowest = round((middle - swing * float(period.mean())) / STEP[unit]) * STEP[unit]
    return Sampled(swing, lowest, unit, grid.f_Hz, np.clip(period, 0.0, 1.0))
