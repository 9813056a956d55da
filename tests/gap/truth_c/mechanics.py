"""What moves: a mode whose spring bends, and a mass that is put on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete

from .parts import Mode, Modes, Oscillator, Part, Samples


def loaded(modes: Sequence[Mode], mass: float, others: float) -> list[Mode]:
    """The modes with a mass on the stage, a share of what the first one moves; the others feel ``others`` of it."""
    return [
        (share, f_Hz / math.sqrt(1 + mass * felt), zeta / math.sqrt(1 + mass * felt))
        for (share, f_Hz, zeta), felt in zip(modes, [1.0] + [others] * (len(modes) - 1), strict=True)
    ]


def spring(square: float, cube: float) -> tuple[float, float]:
    """(a, b) of a force z + a z^2 + b z^3 under which 1 and -1 deflect by 1 + square + cube and -1 + square - cube."""
    up, down = 1 + square + cube, 1 - square + cube
    a, b = np.linalg.solve([[up**2, up**3], [down**2, -(down**3)]], [1 - up, down - 1])
    return float(a), float(b)


class BendingSpring(Part):
    """Modes side by side, the first of which has a spring that bends (Duffing 1918; Nayfeh and Mook 1979, ch. 2).

    Static: y = x + X (square z^2 + cube z^3) at the whole range X either way from ``rest_um``, z = (x - rest) / X. What
    a straight spring does is exact as everywhere; what its bend adds solves the same oscillator with the bend's force
    as input, straight between points, predicted and corrected once. With both sizes 0 it is ``Modes``.
    """

    def __init__(
        self,
        modes: Sequence[Mode],
        square: float,
        cube: float,
        travel_um: float,
        rest_um: float,
        dt_s: float,
        start: float,
    ) -> None:
        (self.share, f_Hz, zeta), *others = modes
        self.straight = Oscillator(f_Hz, zeta, dt_s, start)
        self.stiff, self.others = 1 - self.share - sum(m[0] for m in others), Modes(others, dt_s, start)
        self.carried = sum(m[0] for m in others)
        self.a, self.b = spring(square / self.share, cube / self.share)
        self.travel_um, self.rest_um, self.dt_s = travel_um, rest_um, dt_s
        w = 2 * math.pi * f_Hz
        matrices = (
            np.array([[0, 1], [-w * w, -2 * zeta * w]]),
            np.array([[0.0], [w * w]]),
            np.eye(2),
            np.zeros((2, 1)),
        )
        self.free, *_ = cont2discrete(matrices, dt_s, method="zoh")
        self.before, self.now = straight_force(*matrices[:2], dt_s)
        self.state = (0.0, 0.0, 0.0)
        self.rest(1.0, start)

    def run(self, x: Samples) -> Samples:
        (a, b), (c, d) = self.free.tolist()
        (p, q), (r, s) = self.before.tolist(), self.now.tolist()
        bow, cube, dt_s = self.a, self.b, self.dt_s
        added, speed, force = self.state
        straight = self.straight.run(x)
        found = []
        for z in ((straight - self.rest_um) / self.travel_um).tolist():
            fixed, fast = a * added + b * speed + p * force, c * added + d * speed + q * force
            guess = z + added + dt_s * speed
            guess = z + fixed - r * guess * guess * (bow + cube * guess)
            new = -guess * guess * (bow + cube * guess)
            added, speed, force = fixed + r * new, fast + s * new, new
            found.append(added)
        self.state = (added, speed, force)
        y = self.share * (straight + self.travel_um * np.array(found))
        return y + self.stiff * x + (self.others.run(x) - (1 - self.carried) * x)

    def rest(self, seconds: float, x: float) -> float:
        self.straight.stand(x)
        self.others.rest(seconds, x)
        z, added = (x - self.rest_um) / self.travel_um, 0.0
        for _ in range(50):
            y = z + added
            added = -y * y * (self.a + self.b * y)
        self.state = (added, 0.0, added)
        return x + self.share * self.travel_um * added


def straight_force(A: Samples, B: Samples, dt_s: float) -> tuple[Samples, Samples]:
    """(2,) and (2,): weights of a force at the beginning and at the end of a step in which it goes straight."""
    wide = np.zeros((4, 4))
    wide[:2, :2], wide[:2, 2:3], wide[2, 3] = A, B, 1 / dt_s
    step = expm(wide * dt_s)
    ramp = step[:2, 3]
    return step[:2, 2] - ramp, ramp
