"""What remembers turning points, or forgets them: sliders on springs, and friction with a length of its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .parts import Part, Samples

LOOP = np.concatenate([np.linspace(-1, 1, 801), np.linspace(1, -1, 801)])
"""The full slow loop, of half the range."""


def stretches(v: Samples, least: float) -> Iterator[tuple[slice, int]]:
    """Rows in which v goes one way, and which; steps below ``least`` turn nothing round."""
    d = np.diff(v)
    at = np.flatnonzero(np.abs(d) >= least)
    signs = np.sign(d[at]).astype(int)
    turns = np.flatnonzero(signs[1:] != signs[:-1])
    cuts = [0, *(int(at[i + 1]) + 1 for i in turns), len(v)]
    ways = [int(signs[0]), *(int(signs[i + 1]) for i in turns)] if len(at) else [1]
    for a, b, way in zip(cuts[:-1], cuts[1:], ways, strict=True):
        yield slice(a, b), way


class Sliders(Part):
    """Coulomb sliders on springs of stiffness w, which break loose when stretched by r: the sum of their forces.

    Maxwell's slip model (Goldfarb and Celanovic 1997). Unstretched at ``start``. ``held`` is what stays where it is:
    the sum of w times the places of the sliders.
    """

    def __init__(self, r: Samples, w: Samples, start: float) -> None:
        self.r, self.w, self.last = r, w, start
        self.p = np.full(len(r), start)

    def held(self, v: Samples) -> Samples:
        """(n,) of v (n,)."""
        path, y = np.concatenate([[self.last], v]), np.empty(len(v) + 1)
        for rows, way in stretches(path, 1e-9 * float(self.r.max())):
            far = np.maximum.accumulate(way * path[rows])
            q = way * self.p
            order = np.argsort(q + self.r)
            loose, stuck = self.w[order], (self.w * q)[order]
            number = np.searchsorted((q + self.r)[order], far)
            sliding = np.concatenate([[0.0], np.cumsum(loose)])[number] * far
            stretched = np.concatenate([[0.0], np.cumsum(loose * self.r[order])])[number]
            staying = np.concatenate([np.cumsum(stuck[::-1])[::-1], [0.0]])[number]
            y[rows] = way * (sliding - stretched + staying)
            self.p = way * np.maximum(q, far[-1] - self.r)
        self.last = float(v[-1])
        return y[1:]

    def run(self, v: Samples) -> Samples:
        return float(self.w.sum()) * v - self.held(v)


class Friction(Part):
    """Dahl's friction of level 1 with an exponent: df/dv = (1 - f sign dv)^exponent / r, one for each r.

    Dahl 1968, eq. 9, in closed form along each stretch; the mean of them. It forgets turning points along the path.
    """

    def __init__(self, r: tuple[float, ...], exponent: float, start: float) -> None:
        self.r, self.exponent, self.last = r, exponent, start
        self.f = [0.0] * len(r)

    def run(self, v: Samples) -> Samples:
        path, y = np.concatenate([[self.last], v]), np.zeros(len(v) + 1)
        power = 1 - self.exponent
        for rows, way in stretches(path, 1e-10):
            far = np.maximum.accumulate(way * path[rows])
            way_done = far - way * path[max(rows.start - 1, 0)] if rows.start else far - far[0]
            for i, r in enumerate(self.r):
                left = max(1 - way * self.f[i], 1e-12) ** power - power * way_done / r
                f = way * (1 - np.maximum(left, 1e-12) ** (1 / power))
                y[rows] += f / len(self.r)
                self.f[i] = float(f[-1])
        self.last = float(v[-1])
        return y[1:]


def opening(loop: Samples) -> float:
    """Way down less way up at the middle, of an answer to ``LOOP``."""
    half = len(LOOP) // 2
    return float(loop[half + half // 2] - loop[half // 2])
