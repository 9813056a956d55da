"""What the ceramic does beside its memory, in shares of the travel over the drive s in -1..1."""

from __future__ import annotations

from math import exp

import numpy as np
from scipy.optimize import nnls

from .memory import ColemanHodgdon
from .parts import Lag, Part, Samples, relax

CREEP_FROM_S, CREEP_TO_S = 0.1, 10.0
"""Between these times after a step, growth per decade is measured."""
FULL_SINE_RMS = 8**-0.5
"""Of the range: at this level the growth of the gain is measured."""


class Electrostriction(Part):
    """Strain that goes with the square of a polarisation which itself lags behind.

    Both branches sag by ``bend`` against the ends, and the loop opens at one end and closes at the other.
    """

    station = "ceramic"

    def __init__(self, bend: float, lag: float, s: float) -> None:
        self.bend, self.lag = bend, lag
        self.domains = ColemanHodgdon(2.0)
        self.domains.s = s
        self.scale = 1 / (1 - lag * np.tanh(self.domains.a))
        """Brings the ends of the full loop to -1 and 1."""
        self.rest = (self.scale * s) ** 2

    def run(self, s: Samples) -> Samples:
        polarisation = self.scale * (s - self.lag * self.domains.run(s))
        return self.bend * (polarisation**2 - self.rest)


class Friction(Part):
    """Bristles (as in LuGre) whose level follows the rate of motion: it weakens at first (Stribeck), then grows as the
    logarithm of the rate. Level 0 is the slow loop, 1 as much again.

    Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, Friction models and friction compensation.
    """

    station = "ceramic"
    dip = 0.2
    """Of the growth per decade: the Stribeck weakening at its deepest."""

    def __init__(
        self, per_decade: float, onset_per_s: float, bristle: float, loop: float, dt_s: float, s: float
    ) -> None:
        self.per_decade, self.onset_per_s, self.bristle, self.dt_s = per_decade, onset_per_s, bristle, dt_s
        self.gain = loop / 2
        self.s, self.z = s, 0.0

    def level(self, per_s: Samples) -> Samples:
        """At a rate in ranges per second."""
        weakest = per_s / (0.2 * self.onset_per_s)
        return self.per_decade * (np.log10(1 + per_s / self.onset_per_s) - self.dip * weakest * np.exp(1 - weakest))

    def run(self, s: Samples) -> Samples:
        ds = np.diff(s, prepend=self.s)
        target = np.sign(ds) * self.level(np.abs(ds) / (2 * self.dt_s))
        z = relax(self.z, np.exp(-np.abs(ds) / self.bristle), target)
        self.s, self.z = float(s[-1]), float(z[-1])
        return -self.gain * z


class Softening(Part):
    """A gain that follows the recent level with a state of its own, faster up than down, and levels off a little."""

    station = "slow"
    recovery = 2.0
    """Times slower down than up."""
    bent = 0.5
    followed = 1.217
    """Energy held under a sine, over the sine's mean: 2 E[max(q - e, 0)] = E[max(e - q, 0)] with q = sin^2."""

    def __init__(self, kappa: float, tau_s: float, about_mean: bool, dt_s: float, level: float) -> None:
        self.kappa, self.tau_s, self.about_mean, self.dt_s, self.rest = kappa, tau_s, about_mean, dt_s, level
        self.energy = 0.0
        self.mean = Lag("slow", 3 * tau_s, dt_s, 0.0)

    def growth(self, energy: Samples) -> Samples:
        """Of the gain: kappa times the level at that of a full sine."""
        level = np.sqrt(energy / self.followed)
        return self.kappa * level * (1 + self.bent * FULL_SINE_RMS) / (1 + self.bent * level)

    def run(self, x: Samples) -> Samples:
        z = x - self.rest
        if self.about_mean:
            z = z - self.mean.run(z)
        return x + z * self.growth(self._follow(z * z, self.dt_s))

    def _follow(self, square: Samples, step_s: float) -> Samples:
        up, down = step_s / self.tau_s, step_s / (self.tau_s * self.recovery)
        energy, out = self.energy, []
        for value in square.tolist():
            energy += (up if value > energy else down) * (value - energy)
            out.append(energy)
        self.energy = energy
        return np.array(out)

    def pause(self, level: float, seconds: float) -> float:
        z, steps = level - self.rest, 200
        if self.about_mean:
            z -= self.mean.pause(level - self.rest, seconds)
        value = z * z
        slower = 1.0 if value > self.energy else self.recovery
        self.energy = value + (self.energy - value) * exp(-seconds / (self.tau_s * slower))
        return float(level + z * self.growth(np.full(steps, self.energy))[-1])


class Kohlrausch(Part):
    """Creep as a stretched exponential: after a step the position grows by strength (1 - exp(-(t / tau_s)^beta)).

    Kohlrausch 1854; Williams and Watts 1970. Its spectrum of relaxation times is found by least squares.
    """

    station = "slow"

    def __init__(self, per_decade: float, tau_s: float, beta: float, dt_s: float, level: float) -> None:
        decades = np.log10(CREEP_TO_S / CREEP_FROM_S)
        grown = self.shape(np.array([CREEP_FROM_S, CREEP_TO_S]), tau_s, beta)
        self.strength, self.rest = per_decade * decades / float(grown[1] - grown[0]), level
        taus_s = np.geomspace(1e-3, 30 * tau_s, 22)
        t_s = np.geomspace(1e-3, 30 * tau_s, 300)
        shares, _ = nnls(1 - np.exp(-t_s[:, None] / taus_s), self.shape(t_s, tau_s, beta))
        self.shares = shares[shares > 1e-4]
        self.lags = [Lag("slow", float(tau), dt_s) for tau in taus_s[shares > 1e-4]]

    @staticmethod
    def shape(t_s: Samples, tau_s: float, beta: float) -> Samples:
        return 1 - np.exp(-((t_s / tau_s) ** beta))

    def run(self, x: Samples) -> Samples:
        z = x - self.rest
        return x + self.strength * sum(c * lag.run(z) for c, lag in zip(self.shares, self.lags, strict=True))

    def pause(self, level: float, seconds: float) -> float:
        slow = (c * lag.pause(level - self.rest, seconds) for c, lag in zip(self.shares, self.lags, strict=True))
        return level + self.strength * sum(slow)
