"""The sensor's curve and converter, the room it stands in, and its noise: what is added to a motion, in micrometres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from .parts import Oscillator, Part, Samples


class Curve(Part):
    """What is left of a capacitive sensor's 1 / distance after a linear scale: a logarithm less a line.

    0 at both ends ``low_um`` and ``high_um`` of the range, ``peak_um`` at its largest; ``bent`` is the relative change
    of the slope (Fleming 2013, section 2).
    """

    def __init__(self, peak_um: float, bent: float, low_um: float, high_um: float) -> None:
        self.bent, self.low_um, self.span_um = bent, low_um, high_um - low_um
        self.k_um = peak_um / float(np.max(self._shape(np.linspace(0, 1, 2001))))

    def _shape(self, s: Samples) -> Samples:
        s = np.clip(s, -0.5, 1.5)
        return np.asarray(np.log1p(self.bent * s) / math.log1p(self.bent) - s)

    def run(self, x: Samples) -> Samples:
        return x + self.k_um * self._shape((x - self.low_um) / self.span_um)


def quantised(y_um: Samples, step_um: float) -> Samples:
    """Multiples of a step, between thresholds that are off by up to 0.04 of it."""
    nearest = np.floor(y_um / step_um + 0.5)
    return np.asarray(step_um * np.floor(y_um / step_um + 0.5 + 0.04 * np.sin(2.39996 * nearest)))


@dataclass(frozen=True)
class Drift:
    """A room that warms now faster, now slower: ``rate_um_per_s`` is the mean over ``length_s`` from ``begin_s``."""

    rate_um_per_s: float
    wave: float
    begin_s: float
    length_s: float

    def um(self, t_s: Samples, seed: int) -> Samples:
        s = t_s - self.begin_s
        turn = 2 * np.pi / self.length_s
        return np.asarray(self.rate_um_per_s * (s - self.wave / turn * np.sin(turn * s)))


@dataclass(frozen=True)
class Hum:
    """Lines at the mains frequency, of ``amplitude_um``, and at two and three times it; the grid's phase wanders."""

    amplitude_um: float
    f_Hz: float
    shares: tuple[float, float]
    phases: tuple[float, float, float]
    wander: float

    def um(self, t_s: Samples, seed: int) -> Samples:
        phase = 2 * np.pi * self.f_Hz * t_s + self.wander * np.sin(2 * np.pi * t_s / 37.0)
        lines = [np.sin(k * phase + p) for k, p in enumerate(self.phases, start=1)]
        return np.asarray(self.amplitude_um * (lines[0] + self.shares[0] * lines[1] + self.shares[1] * lines[2]))


@dataclass(frozen=True)
class Vibration:
    """A floor that rings to white forces, of ``rms_um`` and a width of ``bandwidth_Hz``, and swells and fades."""

    rms_um: float
    f_Hz: float
    bandwidth_Hz: float
    swell_s: float
    phase: float

    SWELLS = 0.2

    def um(self, t_s: Samples, seed: int) -> Samples:
        rate_Hz = 1 / float(t_s[1] - t_s[0])
        floor = Oscillator(self.f_Hz, self.bandwidth_Hz / (2 * self.f_Hz), 1 / rate_Hz, 0.0)
        before = int(3 / self.bandwidth_Hz * rate_Hz)
        impulse = np.zeros(before + int(5 / self.bandwidth_Hz * rate_Hz))
        impulse[0] = 1.0
        power = np.sum(floor.run(impulse) ** 2)
        floor.stand(0.0)
        ringing = floor.run(np.random.default_rng(seed).standard_normal(len(t_s) + before))[before:] / math.sqrt(power)
        swell = (1 + self.SWELLS * np.sin(2 * np.pi * t_s / self.swell_s + self.phase)) / math.sqrt(
            1 + self.SWELLS**2 / 2
        )
        return np.asarray(self.rms_um * ringing * swell)


Room = Drift | Hum | Vibration


def noise(rng: np.random.Generator, n: int, rate_Hz: float, pink: float) -> Samples:
    """(n,) of variance 1, the share ``pink`` of it 1/f from 0.05 Hz to a third of the sampling rate."""
    corners = np.geomspace(0.05, rate_Hz / 3, 9)
    flicker = np.zeros(n)
    for f_Hz in corners:
        keep = math.exp(-2 * math.pi * f_Hz / rate_Hz)
        drive = rng.standard_normal(n)
        flicker += lfilter([math.sqrt(1 - keep * keep)], [1, -keep], drive, zi=[keep * rng.standard_normal()])[0]
    return math.sqrt(1 - pink) * rng.standard_normal(n) + math.sqrt(pink / len(corners)) * flicker
