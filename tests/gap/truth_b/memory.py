"""Memory of the ceramic: Bouc-Wen and Coleman-Hodgdon elements, scaled by the loop that they make.

Bouc 1967 and Wen 1976; Coleman and Hodgdon 1986. The drive s runs from -1 to 1 over the voltages of the lab.
"""

from __future__ import annotations

import numpy as np

from .parts import Part, Samples, relax

STEEPEST_LOSS = 0.85
"""A loop may take so much of the slope right after a reversal; with more of it a ceramic would move backwards."""


class BoucWen:
    """dz/ds = 1 - abs(z/limit)^n (1 - loading + loading sgn(ds z)), by the midpoint rule."""

    def __init__(self, limit: float, n: float, loading: float) -> None:
        self.limit, self.n, self.loading = limit, n, loading
        self.s = self.z = 0.0

    def run(self, s: Samples) -> Samples:
        z, limit, n, b = self.z, self.limit, self.n, self.loading
        same, other = 1.0, 1 - 2 * b
        out = []
        for d in np.diff(s, prepend=self.s).tolist():
            if d:
                middle = z + 0.5 * d * (1 - abs(z / limit) ** n * (same if z * d > 0 else other))
                z += d * (1 - abs(middle / limit) ** n * (same if middle * d > 0 else other))
            out.append(z)
        self.s, self.z = float(s[-1]), z
        return np.array(out)


class ColemanHodgdon:
    """dz = a (ds - abs(ds) z), solved exactly over each step: z tends to the sign of the motion."""

    def __init__(self, a: float) -> None:
        self.a = a
        self.s = self.z = 0.0

    def run(self, s: Samples) -> Samples:
        ds = np.diff(s, prepend=self.s)
        z = relax(self.z, np.exp(-self.a * np.abs(ds)), np.sign(ds))
        self.s, self.z = float(s[-1]), float(z[-1])
        return z


Memory = BoucWen | ColemanHodgdon


class Loop(Part):
    """A memory that opens the full loop by ``width`` of the travel at its middle, and takes as much of the travel."""

    station = "ceramic"

    def __init__(self, memory: Memory, width: float, s: float = 0.0) -> None:
        self.memory, self.width = memory, width
        branch = np.linspace(-1, 1, 401)
        path = np.concatenate([branch[200:], *[branch[::-1], branch] * 3])
        z = memory.run(path)
        down, up = z[-802:-401], z[-401:]
        opening, lost = up[200] - down[200], up[-1] - up[0]
        self.gain = width / opening
        self.back = 0.5 * (self.gain * lost - width)
        self.loss_of_slope = float(np.max(self.gain * np.diff(up) / np.diff(branch)) - self.back) / 0.5
        memory.s, memory.z = s, 0.0

    def run(self, s: Samples) -> Samples:
        return self.back * s - self.gain * self.memory.run(s)


def draw_loop(rng: np.random.Generator, width: float, s: float = 0.0) -> Loop:
    """A loop of either kind. One that would turn the motion round gives way to a squarer one."""
    for _ in range(20):
        if rng.random() < 0.5:
            memory: Memory = BoucWen(rng.uniform(0.25, 0.6), rng.choice([1.0, 1.4, 2.0, 3.0]), rng.uniform(0.5, 0.7))
        else:
            memory = ColemanHodgdon(rng.uniform(1.0, 3.0))
        loop = Loop(memory, width, s)
        if loop.loss_of_slope < STEEPEST_LOSS:
            return loop
    return Loop(BoucWen(0.48, 5.0, 0.5), width, s)
