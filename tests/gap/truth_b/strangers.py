"""Systems outside the catalogue. Each is the only mode of its stage: linear in the reference session, and from then on
not. The catalogue has no such thing, so that the honest answer is that something is unknown, or a tie.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from .bench import Bench
from .parts import Part, Samples
from .stage import Traits


class Stranger(Part):
    """The mode of a stage, in place of its own; ``strength`` 0 is linear."""

    strength = 0.0

    def attach(self, bench: Bench) -> None:
        bench.parts["mechanics"].remove(bench.modes)
        super().attach(bench)


class Swing(Stranger):
    """x'' + 2 zeta w x' + w^2 x = w^2 (drive - surplus(drive, x)). Each step propagates the linear part exactly."""

    station = "mechanics"

    def __init__(self, f_Hz: float, zeta: float, dt_s: float, level: float) -> None:
        w = 2 * np.pi * f_Hz
        a = np.array([[0, 1, 0], [-(w**2), -2 * zeta * w, w**2], [0, 0, 0]])
        self.step = expm(a * dt_s)[:2].tolist()
        self.level, self.x, self.v = level, level, 0.0

    def surplus(self, drive: float, x: float) -> float:
        raise NotImplementedError

    def run(self, x: Samples) -> Samples:
        (xx, xv, xf), (vx, vv, vf) = self.step
        at, v, out = self.x, self.v, []
        for drive in x.tolist():
            force = drive - self.surplus(drive, at)
            at, v = xx * at + xv * v + xf * force, vx * at + vv * v + vf * force
            out.append(at)
        self.x, self.v = at, v
        return np.array(out)

    def pause(self, level: float, seconds: float) -> float:
        """Ringing dies; damping finds the place of rest."""
        at = self.x
        for _ in range(200):
            at += 0.3 * (level - self.surplus(level, at) - at)
        self.x, self.v = at, 0.0
        return at


class HardeningSpring(Swing):
    """Duffing: ``strength`` times the cube of the way from rest, in shares of the travel."""

    def surplus(self, drive: float, x: float) -> float:
        return self.strength * (x - self.level) ** 3


class GearSlack(Swing):
    """A mass driven through a gear: within the gap ``strength``, a share of the travel, no force acts and it coasts."""

    def surplus(self, drive: float, x: float) -> float:
        half = 0.5 * self.strength
        return max(-half, min(half, drive - x))


class SaturatedTank(Stranger):
    """Coil and capacitor in front of a stiff stage, with iron that saturates.

    (L(i)/L0) v'' + 2 zeta w v' + w^2 v = w^2 u with L(i) = L0 / (1 + (strength v' / w)^2), down to a ninth of L0;
    ``strength`` is in 1/V.
    """

    station = "amplifier"
    substeps = 4
    air_gap = 8.0

    def __init__(self, f_Hz: float, zeta: float, dt_s: float, level_V: float) -> None:
        self.w, self.zeta, self.dt_s = 2 * np.pi * f_Hz, zeta, dt_s
        self.v, self.rate = level_V, 0.0

    def run(self, x: Samples) -> Samples:
        v, rate, w, h, out = self.v, self.rate, self.w, self.dt_s / self.substeps, []
        stiff, damp, k, most = w * w, 2 * self.zeta * w, self.strength / w, self.air_gap
        for u in x.tolist():
            for _ in range(self.substeps):
                lighter = 1 + min((rate * k) ** 2, most)
                rate = (rate + h * lighter * stiff * (u - v)) / (1 + h * lighter * damp)
                v += h * rate
            out.append(v)
        self.v, self.rate = v, rate
        return np.array(out)

    def pause(self, level: float, seconds: float) -> float:
        self.v, self.rate = level, 0.0
        return level


@dataclass(frozen=True)
class Switch:
    """Makes a stranger of what was linear until now."""

    part: Stranger
    strength: float

    def attach(self, bench: Bench) -> None:
        self.part.strength = self.strength


@dataclass(frozen=True)
class Strange:
    """One kind: the part that is there from the start, and how strong it becomes."""

    place: Callable[[Bench], Stranger]
    strength: Callable[[Bench, np.random.Generator], float]
    allowed: tuple[str, ...] = ()
    """Names that are no mistake."""


def prepared(traits: Traits) -> Traits:
    """The stage with one mode that the records excite well, and little else."""
    _, f_Hz, zeta = traits.modes[0]
    mode = (1.0, min(f_Hz, 0.06 * traits.rate_Hz), max(zeta, 0.02))
    return replace(traits, modes=(mode,), loop=0.03, bend=0.0, creep=0.0)


def _swing(kind: type[Swing]) -> Callable[[Bench], Stranger]:
    return lambda bench: kind(*bench.traits.modes[0][1:], bench.traits.dt_s, bench.zero)


def _tank(bench: Bench) -> Stranger:
    _, f_Hz, zeta = bench.traits.modes[0]
    return SaturatedTank(f_Hz, 2 * zeta, bench.traits.dt_s, 0.0)


STRANGERS = {
    "hardening_spring": Strange(_swing(HardeningSpring), lambda bench, rng: 10 ** rng.uniform(-0.7, 0.3)),
    "gear_slack": Strange(_swing(GearSlack), lambda bench, rng: 10 ** rng.uniform(-2.5, -1.7), allowed=("backlash",)),
    "saturated_tank": Strange(_tank, lambda bench, rng: 10 ** rng.uniform(0.6, 1.3) / bench.traits.swing_V),
}
