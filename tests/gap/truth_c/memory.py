"""The memory of the bare ceramic: Maxwell's sliders, or domain walls as Jiles and Atherton describe them.

Arguments are s = -1..1 over the working range; a memory is scaled to micrometres by its travel over the full loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .parts import Part, Samples
from .sliders import LOOP, Sliders, opening

LEAST_SLOPE = 0.5
"""Of the mean one: the gain just after a turning point of a ceramic is some half of that over the range."""


@dataclass(frozen=True)
class Maxwell:
    """Sliders that break loose at a Weibull distribution of stretches; the field acts as s + bow s^2."""

    reach: float
    shape: float
    bow: float

    def virgin(self, s: float) -> Walls:
        q = (np.arange(200) + 0.5) / 200
        r = self.reach * (-np.log(1 - 0.98 * q)) ** (1 / self.shape)
        return MaxwellWalls(Sliders(r, np.full(200, 1 / 200), s + self.bow * (s * s - 1)), self.bow)


@dataclass(frozen=True)
class JilesAtherton:
    """Jiles and Atherton 1986, eqs. 9-12, for polarisation; Smith and Ounaies 2000 use it for piezo ceramics.

    ``a`` is the width of the anhysteretic tanh, ``k`` the pinning, ``c`` the reversible share, ``alpha`` the coupling,
    ``bias`` the internal field, all in half ranges.
    """

    a: float
    k: float
    c: float
    alpha: float
    bias: float

    def virgin(self, s: float) -> Walls:
        return PinnedWalls(self, s)


class Walls:
    """What gives, of s, an elastic part and one that remembers."""

    def run(self, s: Samples) -> tuple[Samples, Samples]:
        raise NotImplementedError


class MaxwellWalls(Walls):
    def __init__(self, sliders: Sliders, bow: float) -> None:
        self.sliders, self.bow = sliders, bow

    def run(self, s: Samples) -> tuple[Samples, Samples]:
        field = s + self.bow * (s * s - 1)
        return field, -self.sliders.run(field)


class PinnedWalls(Walls):
    STEP = 0.005
    """Longest step of the field; each is exact for an anhysteretic value that is that of its middle."""

    def __init__(self, traits: JilesAtherton, s: float) -> None:
        self.traits, self.m, self.s = traits, 0.0, s

    def run(self, s: Samples) -> tuple[Samples, Samples]:
        t = self.traits
        a, k, c, alpha, bias = t.a, t.k, t.c, t.alpha, t.bias
        m, e, tanh, exp, step = self.m, self.s, math.tanh, math.exp, self.STEP
        y = []
        for x in s.tolist():
            d = x - e
            if d > 1e-12 or d < -1e-12:
                n = 1 + int(abs(d) / step)
                d /= n
                for _ in range(n):
                    missing = tanh((e + 0.5 * d + bias + alpha * m) / a) - m
                    if missing * d > 0:  # walls do not move against the field
                        m += missing * (1 - exp(-abs(d) / k))
                    e += d
                e = x
            y.append(c * tanh((x + bias + alpha * m) / a) + (1 - c) * m)
        self.m, self.s = m, e
        return s, np.array(y)


Recipe = Maxwell | JilesAtherton


class Memory(Part):
    """Volts to micrometres: ``travel_um`` over the full loop, open by ``width`` of it at its middle, virgin at
    ``start_V``."""

    def __init__(
        self, recipe: Recipe, width: float, low_V: float, high_V: float, travel_um: float, start_V: float
    ) -> None:
        self.mid_V, self.half_V = (low_V + high_V) / 2, (high_V - low_V) / 2
        elastic, walls = steady(recipe)
        reach = [float(part[800] - part[0]) for part in (elastic, walls)]
        self.share = width * reach[0] / (opening(walls) - width * reach[1])
        self.scale_um = travel_um / (reach[0] + self.share * reach[1])
        loop = self.scale_um * (elastic + self.share * walls)
        self.least_um = float(np.min(np.diff(loop)[np.diff(LOOP) != 0] / np.diff(LOOP)[np.diff(LOOP) != 0]))
        """Least slope of the full loop, um for each half range."""
        self.walls = recipe.virgin((start_V - self.mid_V) / self.half_V)

    def run(self, v: Samples) -> Samples:
        elastic, walls = self.walls.run((v - self.mid_V) / self.half_V)
        return self.scale_um * (elastic + self.share * walls)


def steady(recipe: Recipe) -> tuple[Samples, Samples]:
    """Elastic part and the other over ``LOOP``, once it repeats."""
    made = recipe.virgin(-1.0)
    for _ in range(2):
        made.run(LOOP)
    return made.run(LOOP)


def draw(rng: np.random.Generator) -> tuple[Recipe, float]:
    """A memory and the opening of its full loop, 6 to 16 % of the travel, that never turns the motion round."""
    while True:
        width = rng.uniform(0.06, 0.16)
        recipe: Recipe
        if rng.random() < 0.6:
            recipe = Maxwell(rng.uniform(0.15, 0.5), rng.uniform(0.8, 2.2), rng.uniform(-0.04, 0.1))
        else:
            recipe = JilesAtherton(
                rng.uniform(0.5, 1.1),
                rng.uniform(0.15, 0.45),
                rng.uniform(0.1, 0.35),
                rng.uniform(0, 0.08),
                rng.uniform(-0.15, 0.15),
            )
        if Memory(recipe, width, -1, 1, 2.0, -1).least_um > LEAST_SLOPE:
            return recipe, width
