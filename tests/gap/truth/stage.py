"""A stage drawn at random: what is inside, and one chain from voltage to measured position that carries all of its
memory from call to call. Effects from the other modules of this folder hook into it place by place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .linear import Filter, Fine, Relaxations, Shift, lag, mode
from .memory import FrictionSet, PreisachPlane

Samples = NDArray[np.float64]
Memory = FrictionSet | PreisachPlane
OVERSAMPLING = 8


@dataclass(frozen=True)
class Character:
    """One stage. Micrometres and volts; the voltage runs from 0 to ``span_V``."""

    rate_Hz: float
    span_V: float
    gain_um_per_V: float
    offset_um: float
    loop: float
    """Opening of the full loop, of range."""
    friction: float
    """Share of the loop that is friction; the rest is a Preisach plane's."""
    f_Hz: float
    zeta: float
    second_share: float
    base_creep: float
    """Per decade."""
    delay_s: float
    amplifier_tau_s: float
    sensor_tau_s: float
    white_um: float
    coloured_um: float
    colour_Hz: float
    bits: int = 16

    @property
    def range_um(self) -> float:
        return self.gain_um_per_V * self.span_V

    @property
    def fine_s(self) -> float:
        """Step of the fine grid."""
        return 1 / (self.rate_Hz * OVERSAMPLING)

    @property
    def lsb_V(self) -> float:
        """Of a converter from -10 to 10 V."""
        return 20 / 2**self.bits


def draw(rng: np.random.Generator, rate_Hz: float, bits: int = 16) -> Character:
    """A stage as they come: ten per cent of hysteresis, one lightly damped mode, noise of some nanometres."""
    span_V = float(rng.uniform(7.5, 9.8))
    return Character(
        rate_Hz=rate_Hz,
        span_V=span_V,
        gain_um_per_V=float(rng.uniform(85, 130)) / span_V,
        offset_um=float(rng.uniform(-4, 4)),
        loop=float(rng.uniform(0.08, 0.15)),
        friction=float(rng.choice([0.0, rng.uniform(0.02, 0.07)])),
        f_Hz=float(np.exp(rng.uniform(np.log(150), np.log(900)))),
        zeta=float(rng.uniform(0.01, 0.05)),
        second_share=float(rng.choice([0.0, rng.uniform(0.005, 0.03)])),
        base_creep=float(rng.choice([0.0, rng.uniform(0.0005, 0.002)])),
        delay_s=float(rng.uniform(1e-4, 4e-4)),
        amplifier_tau_s=float(rng.uniform(2e-5, 4e-5)),
        sensor_tau_s=float(rng.uniform(1e-5, 2e-5)),
        white_um=float(rng.uniform(0.002, 0.012)),
        coloured_um=float(rng.uniform(0.001, 0.012)),
        colour_Hz=float(np.exp(rng.uniform(np.log(3), np.log(60)))),
        bits=bits,
    )


def friction(span_V: float, opening_um: float, rng: np.random.Generator) -> FrictionSet:
    """Four elements, scaled so that a full loop opens by ``opening_um`` at its middle."""
    reaches = span_V * np.array([0.02, 0.06, 0.16, 0.35]) * rng.uniform(0.8, 1.25, 4)
    shape: Samples = np.array([0.8, 1.0, 1.0, 0.7]) * rng.uniform(0.7, 1.4, 4) / reaches
    return FrictionSet(reaches, shape * opening_um / _opening(FrictionSet(reaches, shape), span_V))


def preisach(span_V: float, opening_um: float, rng: np.random.Generator) -> PreisachPlane:
    """Forty levels, scaled alike."""
    levels = span_V * np.linspace(0.01, 0.45, 40)
    shape = np.exp(-levels / (span_V * rng.uniform(0.12, 0.3)))
    middle, breadth = span_V * rng.uniform(0.42, 0.58), span_V * rng.uniform(1.2, 2.5)
    trial = PreisachPlane(levels, shape, middle, breadth)
    return PreisachPlane(levels, shape * opening_um / _opening(trial, span_V), middle, breadth)


def _opening(memory: Memory, span_V: float) -> float:
    """Of a full loop at its middle, from the second of two."""
    up = np.linspace(0, span_V, 400)
    memory.step(up)
    memory.step(up[::-1])
    forth, back = memory.step(up), memory.step(up[::-1])[::-1]
    return float(abs(forth[200] - back[200]))


def held_back(memory: Memory, v: Samples) -> Samples:
    """What the memory keeps the motion from following, um (n,), 0 for a line through the origin."""
    held = memory.step(v)
    return float(memory.weights.sum()) * v - held if isinstance(memory, PreisachPlane) else held


class Effect:
    """A hidden effect: every place of the chain passes by unless a subclass says otherwise.

    ``value`` is its size in ``unit``, comparable with the first size parameter that the catalogue gives the effect.
    """

    name = ""
    unit = ""
    family = ""
    """What the truth is, in words."""
    typical = 0.0
    """In ``unit``, at size 1."""

    def __init__(self, size: float, stage: Character, rng: np.random.Generator) -> None:
        self.size, self.stage, self.rng = size, stage, rng
        self.prepare()

    @property
    def value(self) -> float:
        return self.size * self.typical

    def prepare(self) -> None:
        """Draw and build what it needs."""

    def converter(self, u: Samples) -> Samples:
        """Rows, V."""
        return u

    def electrical(self, v: Samples) -> Samples:
        """Fine grid, V."""
        return v

    def ferroelectric(self, x: Samples, v: Samples) -> Samples:
        """Rows: displacement in um and the voltage at the material."""
        return x

    def mechanical(self, x: Samples) -> Samples:
        """Fine grid, displacement in um, in front of the base's own mode."""
        return x

    def sensed(self, y: Samples) -> Samples:
        """Fine grid, displacement in um, behind the mechanics."""
        return y

    def measured(self, y: Samples, t: Samples) -> Samples:
        """Rows: position in um at absolute times in s."""
        return y

    def digitised(self, y: Samples) -> Samples:
        """Rows: the last that happens to a position."""
        return y

    def sampled(self, y: Samples) -> Samples | None:
        """From the fine grid to rows, if it does that itself."""
        return None

    def mode(self, f_Hz: float, zeta: float) -> tuple[float, float]:
        """What the base's mode becomes."""
        return f_Hz, zeta

    def rest(self, seconds: float) -> None:
        """The stage stands still for so long."""


class Stage:
    """The chain of one axis. ``effects`` may be set between records: what is in there acts."""

    def __init__(self, character: Character, rng: np.random.Generator) -> None:
        self.character, self.effects, c = character, [], character
        self._noise = np.random.default_rng(rng.integers(2**63))
        self.memories: list[Memory] = [preisach(c.span_V, (1 - c.friction) * c.loop * c.range_um, rng)]
        if c.friction:
            self.memories.append(friction(c.span_V, c.friction * c.loop * c.range_um, rng))
        self._exercise()
        base_taus = np.logspace(-1.5, 3, 14)
        per_decade = len(base_taus) / 4.5
        self._creep = Relaxations(base_taus, np.full(14, c.base_creep / per_decade), 1 / c.rate_Hz)
        fine = c.fine_s
        self._up_v, self._up_x = Fine(OVERSAMPLING), Fine(OVERSAMPLING)
        self._delay, self._amplifier = Shift(c.delay_s, fine), lag(c.amplifier_tau_s, fine)
        self._sensor = lag(c.sensor_tau_s, fine)
        self._modes = self._built_modes()
        pole = np.exp(-2 * np.pi * c.colour_Hz / c.rate_Hz)
        self._colour = Filter(np.array([np.sqrt(1 - pole**2)]), np.array([1.0, -pole]))
        self._rest_um = self._displacement_raw(np.zeros(1))[0]
        self._resting_um = 0.0

    def _built_modes(self) -> list[tuple[float, Filter]]:
        c = self.character
        f_Hz, zeta = c.f_Hz, c.zeta
        for effect in self.effects:
            f_Hz, zeta = effect.mode(f_Hz, zeta)
        second = min(3.1 * c.f_Hz, 0.45 * c.rate_Hz)
        found = [(1 - c.second_share, mode(f_Hz, zeta, c.fine_s))]
        return [*found, (c.second_share, mode(second, c.zeta, c.fine_s))] if c.second_share else found

    def switch(self, effects: Sequence[Effect]) -> None:
        """From now on these act; called while the stage stands still."""
        self.effects = list(effects)
        self._modes = self._built_modes()
        self._calm()

    def _exercise(self) -> None:
        """Two full loops before anything is recorded, as a lab would."""
        up = np.linspace(0, self.character.span_V, 200)
        for way in (up, up[::-1]) * 2:
            for memory in self.memories:
                memory.step(way)

    def _displacement_raw(self, v: Samples) -> Samples:
        return self.character.gain_um_per_V * v - sum(held_back(memory, v) for memory in self.memories)

    def _calm(self) -> None:
        """No ringing is left."""
        for _, part in self._modes:
            part.settle(self._resting_um)

    def motion(self, u: Samples) -> Samples:
        """True displacement from rest, um, on the fine grid (n OVERSAMPLING,), for voltages (n,) of successive rows."""
        for effect in self.effects:
            u = effect.converter(u)
        fine = self._delay.step(self._up_v.up(u))
        for effect in self.effects:
            fine = effect.electrical(fine)
        v = self._up_v.down(self._amplifier.step(fine))
        x = self._displacement_raw(v) - self._rest_um
        for effect in self.effects:
            x = effect.ferroelectric(x, v)
        x = x + self._creep.step(x)
        moved = self._up_x.up(x)
        self._resting_um = float(moved[-1])
        for effect in self.effects:
            moved = effect.mechanical(moved)
        return np.asarray(sum(share * part.step(moved) for share, part in self._modes))

    def measure(self, moved: Samples, t: Samples) -> Samples:
        """Measured position (n,) in um of a displacement on the fine grid, at absolute times (n,)."""
        for effect in self.effects:
            moved = effect.sensed(moved)
        moved = self._sensor.step(moved)
        by_itself = [y for y in (effect.sampled(moved) for effect in self.effects) if y is not None]
        y = (by_itself[0] if by_itself else self._up_x.down(moved)) + self.character.offset_um
        for effect in self.effects:
            y = effect.measured(y, t)
        y = y + self._disturbed(len(y))
        for effect in self.effects:
            y = effect.digitised(y)
        return y

    def _disturbed(self, n: int) -> Samples:
        c = self.character
        coloured = self._colour.step(self._noise.standard_normal(n))
        return c.white_um * self._noise.standard_normal(n) + c.coloured_um * coloured

    def rest(self, seconds: float) -> None:
        """Stand still, at the last voltage, unrecorded."""
        self._creep.rest(seconds)
        self._calm()
        for effect in self.effects:
            effect.rest(seconds)
