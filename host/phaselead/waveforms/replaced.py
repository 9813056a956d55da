"""A path that the device plays in place of the one that was asked for, so that the stage follows that one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from phaselead.waveforms.waveform import POINTS, Sampled, Shares, Waveform

FINE = 65536
"""Points of one period in which a lag is worked out: 64 for each that the device plays."""
STEP = 2.0**-16
"""Of the device's micrometres: what it is given for a level is a multiple, since less than one is refused."""


@dataclass(frozen=True, eq=False)
class Replaced(Sampled):
    """``period`` is played, ``wanted`` was asked for, and judged is the measured position against ``value``: what a
    sensor late by ``lag_s`` (first order) shows of a stage that is where it was asked to be. What the device cannot
    play is no later there, so that all of it counts as error."""

    jumps = True
    wanted: Waveform
    lag_s: float = 0.0
    rounding_s: float = 0.0
    """Its corners are rounded by two means over so long."""
    trial_s: float | None = None
    """How long it is driven when nobody says; None: as long as the path that was asked for."""

    @classmethod
    def of(
        cls,
        wanted: Waveform,
        values: Shares,
        *,
        lag_s: float = 0.0,
        rounding_s: float = 0.0,
        trial_s: float | None = None,
    ) -> Self:
        """``values`` (1024,), in the unit of ``wanted``, are what the device plays of one period."""
        lowest = math.floor(values.min() / STEP) * STEP
        swing = math.ceil((values.max() - lowest) / STEP) * STEP
        period = np.clip((values - lowest) / swing, 0.0, 1.0)
        return cls(swing, lowest, wanted.unit, wanted.f_Hz, period, wanted, lag_s, rounding_s, trial_s)

    @classmethod
    def as_sensed(cls, wanted: Waveform, lag_s: float, rounding_s: float = 0.0) -> Self:
        """The device is asked for what the sensor is to show, so that the stage itself is where it was asked to be, but
        for corners."""
        values = played_values(wanted, lag_s, rounding_s)[:: FINE // POINTS]
        return cls.of(wanted, values, lag_s=lag_s, rounding_s=rounding_s)

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        wanted = self.wanted.scaled(swing=swing, time=time)
        if not self.learned:
            return self.as_sensed(wanted, self.lag_s, self.rounding_s)
        about = wanted.offset + (self.offset - wanted.offset) * swing
        return replace(super().scaled(swing=swing, time=time), offset=about, wanted=wanted)

    def share(self, turns: Shares) -> Shares:
        asked = self.wanted.value(turns / self.f_Hz)
        late = np.interp(turns % 1.0 * FINE, np.arange(FINE + 1), self._late) if self.lag_s > 0 else 0.0
        return np.asarray((asked + late - self.offset) / self.swing)

    @cached_property
    def _late(self) -> Shares:
        """What the lag adds to one period, and the first value again, (FINE + 1,)."""
        at_once, later = (played_values(self.wanted, lag_s, self.rounding_s) for lag_s in (0.0, self.lag_s))
        return np.append(later - at_once, later[0] - at_once[0])

    @property
    def _asked(self) -> Shares:
        """One period as it was asked for, (FINE,)."""
        return self.wanted.value(np.arange(FINE) / FINE / self.f_Hz)

    @property
    def played(self) -> Shares:
        """One period as the device plays it, in ``unit``, (1024,)."""
        return self.offset + self.swing * self.period

    @property
    def as_asked(self) -> Waveform:
        return self.wanted

    @property
    def judged_apart(self) -> bool:
        """What is late as the sensor is may be judged by what is played, what was learned may not."""
        return self.learned or self.rounding_s > 0 or self.wanted.judged_apart

    @property
    def learned(self) -> bool:
        """What is played was learned, so it is for one model, mode and path."""
        return self.trial_s is not None

    @property
    def unplayed(self) -> float:
        if self.rounding_s == 0:
            return self.wanted.unplayed
        rounded = played_values(self.wanted, 0.0, self.rounding_s)
        return max(self.wanted.unplayed, float(np.abs(rounded - self._asked).max()))

    @property
    def default_duration_s(self) -> float:
        return self.wanted.default_duration_s if self.trial_s is None else self.trial_s


def mean_twice(f_Hz: Shares, over_s: float) -> Shares:
    """What two means over so long, one after the other, leave of each frequency (m,)."""
    return np.asarray(np.sinc(over_s * f_Hz) ** 2)


def played_values(wanted: Waveform, lag_s: float, rounding_s: float = 0.0) -> Shares:
    """One period of what the device can play of a periodic path, its corners rounded, behind a first-order lag, in its
    unit, (FINE,)."""
    values = wanted.playable(np.arange(FINE) / FINE / wanted.f_Hz)
    spectrum = np.fft.rfft(values)
    f_Hz = np.arange(len(spectrum), dtype=np.float64) * wanted.f_Hz
    spectrum *= mean_twice(f_Hz, rounding_s) / (1 + 2j * np.pi * f_Hz * lag_s)
    return np.fft.irfft(spectrum, FINE)
