"""Labs that record one kind of excitation once their base is known: which one, and what all of its records share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import waves
from .stage import Character

Samples = NDArray[np.float64]


@dataclass(frozen=True)
class Habit:
    """What one lab always records."""

    excitation: str
    """One of ``EXCITATIONS``."""
    pace: float
    """0 to 1, from the slowest that any lab does to the quickest."""
    bias: float
    """Middle of small loops, of the span."""

    def wave(self, rng: np.random.Generator, c: Character, seconds: float, share: float) -> Samples:
        """One record, V (n,). ``share``: 0 is the lowest level of the lab, 1 the highest."""
        excitation = EXCITATIONS[self.excitation]
        lowest, highest = excitation.levels
        return excitation.wave(rng, c, seconds, lowest + share * (highest - lowest), self)


def draw(rng: np.random.Generator) -> Habit:
    """Each excitation is as likely as the others."""
    return Habit(str(rng.choice(list(EXCITATIONS))), float(rng.uniform()), float(rng.uniform(0.25, 0.75)))


def between(slow: float, quick: float, pace: float) -> float:
    """Evenly in the logarithm."""
    return float(slow * (quick / slow) ** pace)


def _triangles(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    return waves.triangles(c.span_V, c.rate_Hz, seconds, round(between(2, 6, habit.pace)), level)


def _multisine(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    top = between(0.004, 0.02, habit.pace)
    return waves.multisine(rng, c.span_V, c.rate_Hz, seconds, level, 0.4, c.f_Hz, top)


def _steps(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    rise_rows = waves.rise_rows(c.rate_Hz)
    return waves.steps(rng, level * c.span_V, c.rate_Hz, seconds, round(between(4, 9, habit.pace)), rise_rows)


def _sine(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    f_Hz = between(5 / seconds, min(0.03 * c.rate_Hz, 0.25 * c.f_Hz), habit.pace)
    return waves.sine(c.span_V, c.rate_Hz, seconds, f_Hz, level)


def _loops(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    f_Hz = between(8, 40, habit.pace) / seconds
    return waves.loops(c.span_V, c.rate_Hz, seconds, f_Hz, level, habit.bias)


def _sweep(rng: np.random.Generator, c: Character, seconds: float, level: float, habit: Habit) -> Samples:
    ends_Hz = [3 / seconds, min(0.08 * c.rate_Hz, between(0.2, 0.5, habit.pace) * c.f_Hz)]
    first_Hz, last_Hz = rng.permutation(ends_Hz)
    return waves.sweep(c.span_V, c.rate_Hz, seconds, float(first_Hz), float(last_Hz), level)


@dataclass(frozen=True)
class Excitation:
    """One kind of excitation."""

    levels: tuple[float, float]
    """Lowest and highest peak-to-peak share of the span."""
    wave: Callable[[np.random.Generator, Character, float, float, Habit], Samples]


EXCITATIONS = {
    "triangles": Excitation((0.5, 1.0), _triangles),
    "multisine": Excitation((0.3, 0.95), _multisine),
    "steps": Excitation((0.6, 1.0), _steps),
    "sine": Excitation((0.85, 1.0), _sine),
    "loops": Excitation((0.05, 0.2), _loops),
    "sweep": Excitation((0.05, 0.2), _sweep),
}
"""Full slow loops; slow multisines; steps with holds, whose heights are shares of the level; sines of one frequency at
nearly the full level; small loops about one bias; small sweeps that stop below the mode."""
