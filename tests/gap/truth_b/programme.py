"""What this lab records: in front a loop over the full range, then many kinds of motion, with stand-stills between.

All waves are drives in -1..1 over the voltages of the lab.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .parts import Samples
from .stage import Traits

Rng = np.random.Generator
FASTEST_EDGE_S = {1000.0: 0.01, 5000.0: 0.003, 20000.0: 0.001}
FAST_SINE_HZ = {1000.0: (15.0, 35.0), 5000.0: (35.0, 80.0), 20000.0: (90.0, 220.0)}


@dataclass
class Pen:
    """Draws one record, piece by piece, from where the last piece ended."""

    traits: Traits
    rng: Rng
    at: float

    def __post_init__(self) -> None:
        self.pieces: list[Samples] = []

    def _rows(self, seconds: float) -> int:
        return max(2, round(seconds * self.traits.rate_Hz))

    def _add(self, wave: Samples) -> None:
        self.pieces.append(wave)
        self.at = float(wave[-1])

    def idle(self, seconds: float) -> None:
        self._add(np.full(self._rows(seconds), self.at))

    def edge(self, to: float, seconds: float) -> None:
        """A step with a finite edge; the generator rounds its corners."""
        turn = np.linspace(0, np.pi, self._rows(seconds) + 1)[1:]
        self._add(self.at + (to - self.at) * 0.5 * (1 - np.cos(turn)))

    def ramp(self, to: float, seconds: float) -> None:
        self._add(self.at + (to - self.at) * np.linspace(0, 1, self._rows(seconds) + 1)[1:])

    def go(self, to: float) -> None:
        self.edge(to, self.rng.uniform(2, 5) * FASTEST_EDGE_S[self.traits.rate_Hz])

    def loop(self, seconds: float) -> None:
        """Up to one end, down to the other, and back: all at one rate."""
        start, per = self.at, seconds / 4.0
        self.ramp(1.0, per * (1 - start) + 1e-9)
        self.ramp(-1.0, 2 * per)
        self.ramp(start, per * (1 + start) + 1e-9)

    def steps(self, seconds: float) -> None:
        """Steps to random levels in both directions, with holds; the last level is the first."""
        start, number = self.at, int(self.rng.integers(3, 6))
        edge_s = self.rng.uniform(1, 4) * FASTEST_EDGE_S[self.traits.rate_Hz]
        levels = [*self.rng.uniform(-0.9, 0.9, number - 1), start]
        for level in levels:
            self.edge(float(level), edge_s)
            self.idle(seconds / number - edge_s)

    def multisine(self, seconds: float, level: float, low_Hz: float, high_Hz: float, bias: float | None = None) -> None:
        """Random phases on a geometric row of lines, with a flat or a falling spectrum, faded in and out."""
        centre = self.at
        wave = self._lines(self._rows(seconds), low_Hz, high_Hz)
        carried = level * wave
        if bias is not None:
            self.go(bias)
            centre = bias
        self._add(np.clip(centre + carried, -1, 1))

    def _lines(self, n: int, low_Hz: float, high_Hz: float) -> Samples:
        t_s = np.arange(n) / self.traits.rate_Hz
        high_Hz = min(high_Hz, 0.35 * self.traits.rate_Hz)
        count = 60
        lines = np.unique(np.round(np.geomspace(max(low_Hz, 1 / t_s[-1]), high_Hz, count) * t_s[-1])) / t_s[-1]
        wave, fall = np.zeros(n), self.rng.choice([0.0, 0.5, 1.0])
        for f_Hz in lines:
            wave += f_Hz**-fall * np.sin(2 * np.pi * f_Hz * t_s + self.rng.uniform(0, 2 * np.pi))
        fade = np.minimum(1, np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.06 * n))
        return fade * wave / np.abs(fade * wave).max()

    def small_loops(self, seconds: float, level: float) -> None:
        """Triangles that die away, at three biases."""
        start, biases = self.at, self.rng.permutation([-0.6, 0.0, 0.6]) + self.rng.uniform(-0.1, 0.1, 3)
        for bias in biases:
            self.edge(float(bias), 0.05 * seconds)
            for share in (1.0, -0.9, 0.6, -0.5, 0.25, -0.2, 0.0):
                self.ramp(float(np.clip(bias + share * level, -1, 1)), 0.035 * seconds)
        self.edge(start, 0.05 * seconds)

    def fast_sine(self, seconds: float, level: float) -> None:
        start = self.at
        self.edge(0.0, 0.1 * seconds)
        f_Hz = self.rng.uniform(*FAST_SINE_HZ[self.traits.rate_Hz])
        t_s = np.arange(self._rows(0.8 * seconds)) / self.traits.rate_Hz
        fade = np.minimum(1, np.minimum(t_s, t_s[::-1]) / (0.15 * t_s[-1]))
        self._add(level * fade * np.sin(2 * np.pi * f_Hz * t_s))
        self.edge(start, 0.1 * seconds)

    def sweep(self, seconds: float, level: float) -> None:
        """A chirp from slow to fast; from some frequency on its rate of motion rises no further."""
        rate = self.traits.rate_Hz
        n = self._rows(0.9 * seconds)
        low, high = 2 / seconds, 0.15 * rate
        u = np.arange(n) / n
        f_Hz = low * (high / low) ** u
        phase = 2 * np.pi * np.cumsum(f_Hz) / rate
        fade = np.minimum(1, np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.04 * n))
        start = self.at
        centre = start if abs(start) < 0.75 else 0.75 * float(np.sign(start))
        self.ramp(centre, 0.05 * seconds)
        small = min(level, 1 - abs(centre))
        self._add(centre + small * fade * np.minimum(1, 8 * low / f_Hz) * np.sin(phase))
        self.ramp(start, 0.05 * seconds)

    def ride(self, seconds: float, level: float) -> None:
        """Slow and fast together: a slow swing, with a multisine on it."""
        n = self._rows(seconds)
        start = self.at
        part = np.linspace(0, 1, n)
        away = np.minimum(1, 8 * np.minimum(part, 1 - part))
        slow = 0.85 * away * np.sin(2 * np.pi * part) + (1 - away) * start
        fast = self._lines(n, 8 / seconds, 0.1 * self.traits.rate_Hz)
        self._add(np.clip(slow + level * fast, -1, 1))

    def wander(self, seconds: float, level: float) -> None:
        """A path without a plan: corners at random times, straight between."""
        start, left = self.at, seconds
        while left > 0.12 * seconds:
            part = self.rng.uniform(0.04, 0.12) * seconds
            self.ramp(float(np.clip(self.rng.normal(0, level), -0.98, 0.98)), part)
            left -= part
        self.ramp(start, 0.1 * seconds)

    def volts(self) -> Samples:
        return self.traits.volts(np.clip(np.concatenate(self.pieces), -1, 1))


Body = Callable[[Pen, float], None]


def _broad(pen: Pen, seconds: float, levels: tuple[float, float]) -> None:
    low_Hz = 6 / seconds
    high_Hz = min(0.3 * pen.traits.rate_Hz, 3 * pen.traits.modes[0][1])
    bias = float(pen.rng.uniform(-0.4, 0.4))
    start = pen.at
    pen.multisine(0.45 * seconds, levels[0], low_Hz, high_Hz, bias)
    pen.idle(0.08 * seconds)
    pen.multisine(0.45 * seconds, levels[1], low_Hz, 0.4 * high_Hz, -bias)
    pen.go(start)


def _stepped(pen: Pen, seconds: float) -> None:
    pen.steps(0.6 * seconds)
    pen.small_loops(0.4 * seconds, 0.3)


def _mixed(pen: Pen, seconds: float) -> None:
    pen.ride(0.55 * seconds, 0.06)
    pen.idle(0.1 * seconds)
    pen.fast_sine(0.35 * seconds, float(pen.rng.uniform(0.3, 0.7)))


def _swept(pen: Pen, seconds: float) -> None:
    pen.sweep(0.5 * seconds, 0.25)
    pen.idle(0.06 * seconds)
    pen.steps(0.44 * seconds)


def _wandering(pen: Pen, seconds: float) -> None:
    pen.wander(0.4 * seconds, 0.5)
    pen.idle(0.05 * seconds)
    pen.ride(0.25 * seconds, 0.1)
    pen.fast_sine(0.3 * seconds, float(pen.rng.uniform(0.4, 0.8)))


SESSIONS: dict[str, list[tuple[str, float, Body]]] = {
    "reference": [
        ("broadband", 0.12, lambda pen, s: _broad(pen, s, (0.08, 0.2))),
        ("steps", 0.12, _stepped),
        ("mixed", 0.12, _mixed),
    ],
    "train": [
        ("mixed", 0.13, _mixed),
        ("broadband", 0.13, lambda pen, s: _broad(pen, s, (0.12, 0.3))),
        ("steps", 0.13, _stepped),
    ],
    "holdout": [("swept", 0.13, _swept), ("wandering", 0.12, _wandering)],
    "broad reference": [
        ("broadband low", 0.18, lambda pen, s: _broad(pen, s, (0.05, 0.15))),
        ("broadband high", 0.18, lambda pen, s: _broad(pen, s, (0.3, 0.1))),
    ],
    "broad train": [
        ("broadband high", 0.2, lambda pen, s: _broad(pen, s, (0.4, 0.15))),
        ("broadband low", 0.2, lambda pen, s: _broad(pen, s, (0.06, 0.25))),
    ],
    "broad holdout": [
        ("broadband", 0.12, lambda pen, s: _broad(pen, s, (0.25, 0.1))),
        ("swept", 0.12, _swept),
    ],
}
"""By session: name, share of all seconds, and what follows the loop in front."""


def session(name: str, traits: Traits, seconds: float, rng: Rng) -> list[tuple[str, Samples]]:
    """The records of one session: names, and voltages (n,) that begin and end where the stage is parked."""
    park = float((traits.park_V - traits.middle_V) / (0.5 * traits.swing_V))
    found = []
    for title, share, body in SESSIONS[name]:
        whole = share * seconds
        pen = Pen(traits, rng, park)
        pen.idle(whole * rng.uniform(0.06, 0.12))
        pen.loop(whole * rng.uniform(0.14, 0.2))
        pen.idle(whole * rng.uniform(0.02, 0.05))
        body(pen, 0.6 * whole)
        pen.idle(whole * rng.uniform(0.05, 0.1))
        found.append((title, pen.volts()))
    return found
