"""Effects of the ceramic. Those that the voltage drives stand beside the memory and add micrometres to it."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from .memory import LEAST_SLOPE
from .parts import Lag, Part, Samples
from .sliders import LOOP, Friction, Sliders, opening

FULL_SINE = math.sqrt(1 / 8)
"""Root mean square of a sine over the whole range, of that range."""


class Beside(Part):
    """A loop beside that of the ceramic: k (gained (s - s_rest) - force(s)), open by ``opening_um`` at its middle.

    What domain walls add to the motion or take off it does not follow from their loop (Zhang, Wang, Kim and Cross
    1994): ``gained``, of the force's slope just after a turning point, is at least what keeps the motion from turning
    round, where the rest of the ceramic has a slope of ``least_um`` for each half range there.
    """

    def __init__(
        self, test: Part, force: Part, opening_um: float, gained: float, least_um: float, travel_um: float, rest: float
    ) -> None:
        for _ in range(3):
            loop = test.run(LOOP)
        self.force, self.rest_s = force, rest
        self.k_um = -opening_um / opening(loop)
        steepest = float(np.max(np.diff(loop)[801:] / np.diff(LOOP)[801:]))
        needed = steepest - (least_um - 0.5 * LEAST_SLOPE * travel_um / 2) / self.k_um
        self.gained = max(gained * steepest, needed)

    def run(self, v: Samples) -> Samples:
        return self.k_um * (self.gained * (v - self.rest_s) - self.force.run(v))


def more_sliders(mean: float, start: float) -> Sliders:
    """Sliders that break loose at exponentially distributed stretches, up to 0.95 half ranges."""
    q = (np.arange(120) + 0.5) / 120
    r = -mean * np.log(1 - q * (1 - math.exp(-0.95 / mean)))
    return Sliders(r, np.full(120, 1 / 120), start)


def forgetful(reach: float, exponent: float, start: float) -> Friction:
    """Two frictions, one with a path half as long again as the other."""
    return Friction((reach, 1.5 * reach), exponent, start)


class Electrostriction(Part):
    """The square of a polarisation that lags behind and levels off (Damjanovic 1998): p^2 / (1 + level p^2).

    Its mean over both branches sags by ``bend_um`` at mid-range from a line between the ends.
    """

    def __init__(self, bend_um: float, lag: float, level: float, start: float) -> None:
        self.lag, self.level = lag, level
        self.sliders = self._made(-1.0)
        for _ in range(2):
            loop = self._square(LOOP)
        sag = (loop[0] + loop[800]) / 2 - (loop[400] + loop[1201]) / 2
        self.k_um = bend_um / float(sag)
        self.sliders = self._made(start)

    def _made(self, start: float) -> Sliders:
        q = (np.arange(40) + 0.5) / 40
        return Sliders(0.5 * q, np.full(40, self.lag / 40), start)

    def _square(self, s: Samples) -> Samples:
        square = (s - self.sliders.run(s)) ** 2
        return square / (1 + self.level * square)

    def run(self, v: Samples) -> Samples:
        return self.k_um * self._square(v)


class SpeedFriction(Part):
    """A slider whose level follows the speed as thermal activation has it: Eyring 1936, asinh(rate / 2 onset).

    The loop that it opens, ``growth`` of the range, grows by that for each decade of rate far above the onset, from
    ``coulomb`` at rest. Rates are in ranges per second, ``reach`` is the path of the range over which it turns at its
    level of one decade. At a stand-still its spring stays stretched.
    """

    SPEED_S = 0.002
    """Time over which the speed is felt."""

    def __init__(
        self, growth: float, coulomb: float, onset: float, reach: float, travel_um: float, dt_s: float, start: float
    ) -> None:
        self.growth, self.coulomb, self.onset = growth, coulomb, onset
        self.stiffness = 0.5 * (growth + coulomb) / reach
        self.travel_um, self.dt_s, self.x = travel_um, dt_s, start
        self.force, self.speed = 0.0, 0.0

    def run(self, x: Samples) -> Samples:
        step = np.diff(x, prepend=self.x) / self.travel_um
        keep = math.exp(-self.dt_s / self.SPEED_S)
        rate, _ = lfilter([1 - keep], [1, -keep], step / self.dt_s, zi=[keep * self.speed])
        decades = np.arcsinh(np.abs(rate) / (2 * self.onset)) / math.log(10)
        force, y = self.force, []
        for pull, level in zip(
            (self.stiffness * step).tolist(), (0.5 * (self.coulomb + self.growth * decades)).tolist(), strict=True
        ):
            stretched = force + pull
            if stretched > level:
                stretched = max(level, force - abs(pull))
            elif stretched < -level:
                stretched = min(-level, force + abs(pull))
            force = stretched
            y.append(force)
        self.force, self.x, self.speed = force, float(x[-1]), float(rate[-1])
        return x - self.travel_um * np.array(y)

    def rest(self, seconds: float, x: float) -> float:
        self.x, self.speed = x, 0.0
        return x - self.travel_um * self.force


class Level(Part):
    """Gain that grows with a recent level of the motion (Damjanovic 1998, the Rayleigh law) and levels off.

    The level is the root of a running mean square of the displacement from ``start``, less ``about_mean`` of its slow
    mean; it is followed faster up than down. At a full sine the gain has grown by ``kappa`` times that sine's rms.
    """

    BENDS = 0.4
    DOWN = 1.3
    SLOW = 3.0

    def __init__(
        self, kappa: float, tau_s: float, about_mean: float, travel_um: float, fine: int, dt_s: float, start: float
    ) -> None:
        self.k = kappa * (1 + self.BENDS * FULL_SINE)
        self.travel_um, self.start, self.fine, self.tau_s = travel_um, start, fine, tau_s
        self.row_s, self.about_mean, self.square = fine * dt_s, about_mean, 0.0
        self.mean = Lag(self.SLOW * tau_s, dt_s, start)

    def _gain(self, square: Samples) -> Samples:
        level = np.sqrt(square)
        return self.k * level / (1 + self.BENDS * level)

    def run(self, x: Samples) -> Samples:
        if len(x) % self.fine:
            raise ValueError(f"{len(x)} points are no whole number of rows")
        z = (x - self.start) / self.travel_um
        moved = z - self.about_mean * (self.mean.run(x) - self.start) / self.travel_um
        up, down = (1 - math.exp(-self.row_s / tau_s) for tau_s in (self.tau_s, self.DOWN * self.tau_s))
        square, found = self.square, [self.square]
        for now in np.mean(np.reshape(moved**2, (-1, self.fine)), axis=1).tolist():
            square += (up if now > square else down) * (now - square)
            found.append(square)
        self.square = square
        at = np.arange(1, len(x) + 1) / self.fine
        return x + self._gain(np.interp(at, np.arange(len(found)), found)) * (x - self.start)

    def rest(self, seconds: float, x: float) -> float:
        mean = self.mean.rest(seconds, x)
        now = ((x - self.start) - self.about_mean * (mean - self.start)) ** 2 / self.travel_um**2
        self.square = now + (self.square - now) * math.exp(-seconds / (self.DOWN * self.tau_s))
        return x + float(self._gain(np.array(self.square))) * (x - self.start)


class Creep(Part):
    """A continuous spectrum of relaxation times with soft ends (Findley, Lai and Onaran 1976, section 5.7).

    Between ``first_s`` and ``last_s`` the position goes on by ``gamma`` of a step per decade of time. Times are longer
    than rows, between which it goes straight; displacements count from ``rest_um``, and it stands at ``start``.
    """

    SPACING = 0.2
    EDGE = 0.15

    def __init__(
        self, gamma: float, first_s: float, last_s: float, fine: int, dt_s: float, rest_um: float, start: float
    ) -> None:
        first, last = math.log10(first_s), math.log10(last_s)
        logs = np.arange(first - 0.6, last + 0.6, self.SPACING)
        density = 0.5 * (np.tanh((logs - first) / self.EDGE) - np.tanh((logs - last) / self.EDGE))
        self.lags = [
            (gamma * self.SPACING * d, Lag(10.0**g, fine * dt_s, start)) for g, d in zip(logs, density, strict=True)
        ]
        self.fine, self.rest_um = fine, rest_um
        self.crept = sum(k for k, _ in self.lags) * (start - rest_um)

    def run(self, x: Samples) -> Samples:
        if len(x) % self.fine:
            raise ValueError(f"{len(x)} points are no whole number of rows")
        rows = x[self.fine - 1 :: self.fine]
        crept = sum((k * (lag.run(rows) - self.rest_um) for k, lag in self.lags), np.zeros(len(rows)))
        at = np.arange(1, len(x) + 1) / self.fine
        y = x + np.interp(at, np.arange(len(rows) + 1), np.concatenate([[self.crept], crept]))
        self.crept = float(crept[-1])
        return np.asarray(y)

    def rest(self, seconds: float, x: float) -> float:
        self.crept = sum(k * (lag.rest(seconds, x) - self.rest_um) for k, lag in self.lags)
        return float(x + self.crept)
