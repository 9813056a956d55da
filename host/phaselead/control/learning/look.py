"""One trial and what it shows; how long one is, and how many lines of a period it tells."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phaselead.control.learning.lines import MOST_LINES, Amplitudes, Lines
from phaselead.device import TICK_HZ
from phaselead.model import Gains
from phaselead.record import Samples
from phaselead.waveforms import Waveform

SETTLE_S = 0.5
"""Before a trial is looked at: a mode of 100 Hz and a damping of 0.02 has decayed to a five-hundredth."""
LEAST_S, LEAST_PERIODS = 1.0, 4
"""Looked at, at least: the noise of one line, 2 / sqrt(n) of that of n samples, is then 35 times below it."""


@dataclass(frozen=True)
class Look:
    """One trial's outcome: lines of the error by axis, what was added to the path, and one figure for all axes."""

    correction: dict[str, Amplitudes]
    error: dict[str, Lines]
    rest_um: dict[str, Samples]
    """What of the error does not repeat."""
    gains: dict[str, Gains]
    modes: dict[str, float]
    """The modes of the inverse, as times those of the model that was given."""
    worth: float
    """Mean square of the error as a share of the swing, over all axes."""

    @property
    def mostly_repeats(self) -> bool:
        """Whether on any axis more of the error repeats than does not."""
        return any(one.power > float(np.mean(self.rest_um[axis] ** 2)) for axis, one in self.error.items())

    def rests_less_than(self, other: Look) -> bool:
        """Whether on all axes together less of the error does not repeat, each by its share of the other's."""
        shares = [np.mean(one**2) / np.mean(other.rest_um[axis] ** 2) for axis, one in self.rest_um.items()]
        return bool(np.mean(shares) < 1)


@dataclass(frozen=True)
class End:
    """Why trials ended, and with which one; None where a fault of the device ended it. ``refused``: the next was."""

    reason: str
    look: Look | None
    refused: bool = False


def trial_seconds(waveforms: Mapping[str, Waveform]) -> float:
    """Of one trial: as it is driven when nobody says, and long enough to settle and to hear what repeats."""
    each = [
        max(one.default_duration_s, SETTLE_S + max(LEAST_S, LEAST_PERIODS / one.f_Hz)) for one in waveforms.values()
    ]
    return max(
        math.ceil(seconds * one.f_Hz - 1e-9) / one.f_Hz for seconds, one in zip(each, waveforms.values(), strict=True)
    )


def line_count(waveform: Waveform) -> int:
    """Lines of a period below half the tick rate, as many as points can play."""
    return max(1, min(MOST_LINES, math.ceil(TICK_HZ / 2 / waveform.f_Hz) - 1))
