"""What a bench is made of: parts that turn one signal into the next and keep their state between records."""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import signal

if TYPE_CHECKING:
    from .bench import Bench

Samples = NDArray[np.float64]


class Part:
    """One part. ``station`` is the place on the bench where it acts; see ``bench.STATIONS``."""

    station: str

    def run(self, x: Samples) -> Samples:
        """The output (n,) for an input (n,) on the fine grid, from the kept state on."""
        raise NotImplementedError

    def pause(self, level: float, seconds: float) -> float:
        """The output at the end of a stand-still at ``level``, with the state brought there."""
        return float(self.run(np.array([level, level]))[-1])

    def attach(self, bench: Bench) -> None:
        """Mount it behind what is there already."""
        bench.parts[self.station].append(self)


class Lag(Part):
    """First-order lag; the input runs straight between samples. Exact at any step."""

    def __init__(self, station: str, tau_s: float, dt_s: float, level: float = 0.0) -> None:
        self.station, self.tau_s, self.dt_s = station, tau_s, dt_s
        self.last_in = self.last_out = level

    def run(self, x: Samples) -> Samples:
        pole = exp(-self.dt_s / self.tau_s)
        mean = self.tau_s / self.dt_s * (1 - pole)
        b = np.array([1 - mean, mean - pole])
        y, _ = signal.lfilter(b, [1, -pole], x, zi=[pole * self.last_out + b[1] * self.last_in])
        self.last_in, self.last_out = float(x[-1]), float(y[-1])
        return y

    def pause(self, level: float, seconds: float) -> float:
        self.last_out = level + (self.last_out - level) * exp(-seconds / self.tau_s)
        self.last_in = level
        return self.last_out


class Modes(Part):
    """Spring-mass modes in parallel, beside a share that follows at once; all shares sum to 1.

    m x'' + d x' + k x = k (input), each in its own state space, with an input that runs straight between samples.
    """

    station = "mechanics"

    def __init__(self, modes: tuple[tuple[float, float, float], ...], dt_s: float, level: float = 0.0) -> None:
        self.modes, self.dt_s, self.added_mass = modes, dt_s, 0.0
        self._level = level
        self._build()

    def _build(self) -> None:
        self._filters = []
        for _, f_Hz, zeta in self.modes:
            stiffness, damping = (2 * np.pi * f_Hz) ** 2, 4 * np.pi * zeta * f_Hz
            mass = 1 + self.added_mass
            a = np.array([[0, 1], [-stiffness / mass, -damping / mass]])
            space = (a, np.array([[0], [stiffness / mass]]), np.array([[1, 0]]), np.array([[0]]))
            discrete = signal.cont2discrete(space, self.dt_s, method="foh")
            num, den = signal.ss2tf(*discrete[:4])
            self._filters.append((num[0], den, signal.lfilter_zi(num[0], den)))
        self._settle()

    def _settle(self) -> None:
        self._state = [at_rest * self._level for *_, at_rest in self._filters]

    def load(self, mass: float) -> None:
        """Put ``mass``, a share of what moves, on top."""
        self.added_mass = mass
        self._build()

    def run(self, x: Samples) -> Samples:
        y = (1 - sum(share for share, *_ in self.modes)) * x
        for i, ((share, *_), (num, den, _)) in enumerate(zip(self.modes, self._filters, strict=True)):
            moved, self._state[i] = signal.lfilter(num, den, x, zi=self._state[i])
            y = y + share * moved
        self._level = float(x[-1])
        return y

    def pause(self, level: float, seconds: float) -> float:
        """Ringing dies within any pause."""
        self._level = level
        self._settle()
        return level


def relax(start: float, decay: Samples, target: Samples) -> Samples:
    """y[k] = target[k] + decay[k] (y[k-1] - target[k]), all (n,)."""
    out, y = [], start
    for e, pull in zip(decay.tolist(), (target * (1 - decay)).tolist(), strict=True):
        y = y * e + pull
        out.append(y)
    return np.array(out)
