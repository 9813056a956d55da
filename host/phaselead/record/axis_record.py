"""One axis of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]


@dataclass(frozen=True)
class AxisRecord:
    """One axis of a recording. All arrays have shape (n,)."""

    u_V: Samples | None
    """Applied control voltage; None in a record of positions alone."""
    x_um: Samples | None
    """Measured position; None when only the voltage is known."""
    r_um: Samples | None = None
    """Reference position, closed loop only."""
