"""A recording: what was applied, what was measured and, in closed loop, what was asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

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


@dataclass(frozen=True)
class Recording:
    """A uniformly sampled recording of one or three axes.

    ``axes`` is keyed "x", "y", "z"; a single-axis file without a note of its axis is "x".
    ``scored`` are the samples to judge: all of them unless the argument carried a window, in which case the
    rows before it only warm the model's memory (and rows after it have been cut off).
    """

    t_s: Samples
    axes: dict[str, AxisRecord]
    scored: slice = field(default_factory=lambda: slice(None))
    source: str = ""
    """The argument it was read from, for messages."""
    sha256: str = ""
    """Of the file's bytes."""
    meta: dict[str, Any] = field(default_factory=dict)
    """Attributes of the file: stage file text, device, gaps ..."""

    @property
    def rate_Hz(self) -> float:
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])

    @property
    def from_rest(self) -> bool:
        """Whether the memory starts from rest: no warm-up rows precede the scored ones."""
        return (self.scored.start or 0) == 0
