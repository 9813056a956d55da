"""What the final model leaves of a run, and a disturbance that was found in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from phaselead.gap.records import Run
from phaselead.gap.result import Value
from phaselead.record import Samples

SURE, AGAIN = 1e-6, 1e-3
"""Chance of a disturbance in the training records, and in the held-out ones."""
MORE = 1.5
"""Times the reference's amplitude (or step) from which something is new."""


@dataclass(frozen=True)
class Left:
    """The residual (n,) of one run under the final model, about its own offset."""

    run: Run
    error_um: Samples

    @property
    def rate_Hz(self) -> float:
        return 1 / self.run.step_s

    @cached_property
    def speed_um_per_s(self) -> Samples:
        """(n,) of the model, which is free of noise, between its rows as smooth as it is."""
        t_s = np.arange(len(self.error_um)) * self.run.step_s
        return np.asarray(CubicSpline(t_s, self.run.x_um[self.run.rows] - self.error_um)(t_s, 1))


@dataclass(frozen=True)
class Found:
    """A disturbance with its parameters and mean power."""

    name: str
    params: dict[str, Value]
    power_um2: float
    why: str


Parts = tuple[Sequence[Left], Sequence[Left], Sequence[Left]]
"""Of training, held-out and reference records."""
