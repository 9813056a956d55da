"""Hidden in the material: hysteresis and what goes with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .linear import Filter, Relaxations
from .memory import FrictionSet
from .stage import Effect, friction, held_back, preisach

Samples = NDArray[np.float64]


class Hysteresis(Effect):
    """The whole loop, a Preisach plane and some friction (the catalogue has linear plays), on a base that has next to
    none, as if the reference session had been driven by charge and the later ones by voltage."""

    name, unit, typical = "hysteresis", "of range", 0.12
    family = "a Lorentzian Preisach plane and friction elements"

    def prepare(self) -> None:
        span_V, opening_um = self.stage.span_V, self.value * self.stage.range_um
        share = self.rng.uniform(0.05, 0.2)
        self.memories = [
            preisach(span_V, (1 - share) * opening_um, self.rng),
            friction(span_V, share * opening_um, self.rng),
        ]
        self.rest_um = float(self._held(np.zeros(1))[0])

    def _held(self, v: Samples) -> Samples:
        return np.asarray(sum(held_back(memory, v) for memory in self.memories))

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        return x - self._held(v) + self.rest_um


def _elements(effect: Effect, opening: float) -> FrictionSet:
    return friction(effect.stage.span_V, opening * effect.stage.range_um, effect.rng)


class AsymmetricHysteresis(Effect):
    """A hyperbolic-cosine curve of the voltage, and friction that reaches further at the upper end than at the lower
    (the catalogue has a parabola and plays of the square). The size is the sag of the curve."""

    name, unit, typical = "asymmetric_hysteresis", "of range", 0.02
    family = "cosh curvature, and friction elements whose reach grows with the voltage"
    STRETCH = 0.6

    def prepare(self) -> None:
        state = self.rng.bit_generator.state
        self.stretched = _elements(self, self.value * 0.5 / self.STRETCH)
        self.rng.bit_generator.state = state
        self.even = _elements(self, self.value * 0.5 / self.STRETCH)

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        s = 2 * v / self.stage.span_V - 1
        bend = (np.cosh(1.5 * s) - np.cosh(1.5)) / (np.cosh(1.5) - 1)
        wider = self.stretched.step(v, 1 + self.STRETCH * np.clip(s, -1.2, 1.2)) - self.even.step(v)
        return x + self.value * self.stage.range_um * bend - wider


class RateDependence(Effect):
    """Friction whose reach grows with a power of the rate (the catalogue widens plays by its logarithm): the width of
    the base's loop times 1 + 0.2 size at ten times the rate where it sets in."""

    name, unit, typical = "rate_dependence", "per decade", 0.2
    family = "friction elements with a power law of the rate"
    ONSET_PER_S = 1.0

    def prepare(self) -> None:
        state = self.rng.bit_generator.state
        self.quick = _elements(self, self.stage.loop)
        self.rng.bit_generator.state = state
        self.slow = _elements(self, self.stage.loop)
        self.last_V = 0.0

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        rate = np.abs(np.diff(v, prepend=self.last_V)) * self.stage.rate_Hz / self.stage.span_V
        self.last_V = float(v[-1])
        stretch = (1 + rate / self.ONSET_PER_S) ** np.log10(1 + self.value)
        return x - self.quick.step(v, stretch) + self.slow.step(v)


class Softening(Effect):
    """Gain that grows with the mean modulus of the recent motion about its recent mean, through two lags (the catalogue
    has the root of one lagged square)."""

    name, unit, typical = "softening", "1", 0.15
    family = "gain that follows the twice-lagged modulus of the motion about its mean"
    LEVEL_S, MEAN_S = 0.2, 1.0

    def prepare(self) -> None:
        def lagged(tau_s: float) -> Filter:
            kept = np.exp(-1 / (tau_s * self.stage.rate_Hz))
            return Filter(np.array([1 - kept]), np.array([1.0, -kept]))

        self.mean, self.once, self.twice = lagged(self.MEAN_S), lagged(self.LEVEL_S), lagged(self.LEVEL_S)

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        z = x / self.stage.range_um
        z = z - self.mean.step(z)
        level = self.twice.step(self.once.step(np.abs(z)))
        return x + self.value * self.stage.range_um * z * level * np.pi / (2 * np.sqrt(2))

    def rest(self, seconds: float) -> None:
        for part in (self.mean, self.once, self.twice):
            part.settle(0.0)


class Creep(Effect):
    """Fractional creep, s^-0.07 by 27 time constants from 10 ms to 10^4 s (the catalogue has eight of equal weight)."""

    name, unit, typical = "creep", "per decade", 0.015
    family = "a fractional integrator: 27 time constants with weights that grow by a power law"

    def prepare(self) -> None:
        tau_s = np.logspace(-2, 4, 27)
        k = tau_s**0.07
        grown = k @ (np.exp(-0.1 / tau_s) - np.exp(-10 / tau_s))
        self.parts = Relaxations(tau_s, k * 2 * self.value / grown, 1 / self.stage.rate_Hz)

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        return x + self.parts.step(x)

    def rest(self, seconds: float) -> None:
        self.parts.rest(seconds)


EFFECTS = (Hysteresis, AsymmetricHysteresis, RateDependence, Softening, Creep)
