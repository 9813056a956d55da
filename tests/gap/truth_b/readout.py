"""Mechanics beyond the stage's own modes, the sensor and its clock, and the room around them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import signal

from .parts import Part, Samples

if TYPE_CHECKING:
    from .bench import Bench


class Slack(Part):
    """A follower in a slot: it stands still until the driver has crossed the ``width``."""

    station = "mechanics"

    def __init__(self, width: float, level: float) -> None:
        self.half, self.at = width / 2, level

    def run(self, x: Samples) -> Samples:
        at, half, out = self.at, self.half, []
        for driver in x.tolist():
            if driver - half > at:
                at = driver - half
            elif driver + half < at:
                at = driver + half
            out.append(at)
        self.at = at
        return np.array(out)

    def attach(self, bench: Bench) -> None:
        bench.parts[self.station].insert(0, self)


class Load:
    """More mass on every mode of the stage."""

    def __init__(self, mass: float) -> None:
        self.mass = mass

    def attach(self, bench: Bench) -> None:
        bench.modes.load(self.mass)


class Scale(Part):
    """A sensor of another scale, about its reading at rest."""

    station = "sensor"

    def __init__(self, gain: float, rest_um: float) -> None:
        self.gain, self.rest_um = gain, rest_um

    def run(self, x: Samples) -> Samples:
        return x + self.gain * (x - self.rest_um)


class Zero(Part):
    """A sensor whose zero has moved."""

    station = "sensor"

    def __init__(self, offset_um: float) -> None:
        self.offset_um = offset_um

    def run(self, x: Samples) -> Samples:
        return x + self.offset_um


class RationalCurve(Part):
    """A sensor whose reading is a quotient, as of two capacitances: (s + e)/(1 + e s), then s (1 + c)/(1 + c s^2).

    Both keep the ends s = -1 and 1. The first departs by ``bow`` of the travel, the second by ``wave``.
    """

    station = "sensor"

    def __init__(self, bow: float, wave: float, middle_um: float, travel_um: float) -> None:
        self.e, self.c, self.middle_um, self.half_um = 2 * bow, 2 * wave / 0.385, middle_um, travel_um / 2

    def run(self, x: Samples) -> Samples:
        s = (x - self.middle_um) / self.half_um
        s = (s + self.e) / (1 + self.e * s)
        return self.middle_um + self.half_um * s * (1 + self.c) / (1 + self.c * s * s)


class Jitter:
    """Samples that are taken too early or too late, by times spread evenly."""

    def __init__(self, rms_s: float, rng: np.random.Generator) -> None:
        self.most_s, self.rng = np.sqrt(3) * rms_s, rng

    def attach(self, bench: Bench) -> None:
        bench.jitter = self

    def errors_s(self, n: int) -> Samples:
        return self.rng.uniform(-self.most_s, self.most_s, n)


class Grid(Part):
    """A sensor converter that cuts down to whole steps."""

    station = "grid"

    def __init__(self, step_um: float) -> None:
        self.step_um = step_um

    def run(self, x: Samples) -> Samples:
        return self.step_um * np.floor(x / self.step_um)


class Room:
    """What comes from outside, in um: added to what the sensor says, whatever the voltage."""

    def attach(self, bench: Bench) -> None:
        bench.room.append(self)

    def at(self, t_s: Samples) -> Samples:
        """Of one record, at absolute times (n,)."""
        raise NotImplementedError


class Warming(Room):
    """Newton's law: from ``start_s`` on an exponential approach; its mean rate over ``seconds`` is given."""

    def __init__(self, mean_um_per_s: float, tau_s: float, start_s: float, seconds: float) -> None:
        self.tau_s, self.start_s = tau_s, start_s
        self.rise_um = mean_um_per_s * seconds / (1 - np.exp(-seconds / tau_s))

    def at(self, t_s: Samples) -> Samples:
        return self.rise_um * (1 - np.exp(-(t_s - self.start_s) / self.tau_s))


class Hum(Room):
    """Mains with second and third harmonics; frequency and the harmonics' amplitudes drift a little."""

    def __init__(self, amplitude_um: float, rng: np.random.Generator) -> None:
        self.amplitude_um = amplitude_um
        self.f_Hz = rng.choice([50.0, 60.0]) + rng.uniform(-0.03, 0.03)
        self.phases = rng.uniform(0, 2 * np.pi, 3)
        self.shares = np.array([1.0, *rng.uniform(0.1, 0.4, 2)])
        self.wander = rng.uniform(0, 2 * np.pi, 3)

    def at(self, t_s: Samples) -> Samples:
        turn = 2 * np.pi * self.f_Hz * t_s + 0.5 * np.sin(2 * np.pi * t_s / 170 + self.wander[0])
        swell = [np.ones_like(t_s), *(1 + 0.2 * np.sin(2 * np.pi * t_s / 90 + w) for w in self.wander[1:])]
        waves = (
            share * grown * np.sin(h * turn + phase)
            for h, share, grown, phase in zip((1, 2, 3), self.shares, swell, self.phases, strict=True)
        )
        return self.amplitude_um * sum(waves)


class Rumble(Room):
    """A floor that swings: noise in a narrow band, as a carrier whose complex amplitude wanders."""

    def __init__(self, rms_um: float, f_Hz: float, width_Hz: float, rng: np.random.Generator) -> None:
        self.rms_um, self.f_Hz, self.width_Hz, self.rng = rms_um, f_Hz, width_Hz, rng

    def at(self, t_s: Samples) -> Samples:
        pole = np.exp(-np.pi * self.width_Hz * (t_s[1] - t_s[0]))
        kicks = self.rng.standard_normal((2, len(t_s)))
        kicks[:, 1:] *= np.sqrt(1 - pole**2)
        real, imaginary = signal.lfilter([1.0], [1.0, -pole], kicks)
        turn = 2 * np.pi * self.f_Hz * t_s
        return self.rms_um * (real * np.cos(turn) - imaginary * np.sin(turn))
