"""What plays alone leave of stages with another memory, and plays beside fading ones, of a bent field, or of weights
that depend on the level.

    python benchmarks/memory.py [STAGES]

Stages drawn at random with a Bouc-Wen or a Coleman-Hodgdon loop, plays of a field that bends, or a Preisach plane whose
density falls off from its middle as a normal one does, with a curve, one mode and noise; the models are fitted to six
records of each and judged on six others, all behind a full loop. Percentages of the travel, rms.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import cont2discrete, lfilter

from phaselead.identify import fit
from phaselead.identify.operator import fitting, regressors
from phaselead.model import Stage, predict
from phaselead.record import AxisRecord, Recording, Samples

RATE_HZ, LEAD_S, SECONDS = 5000.0, 0.5, 2.0
KINDS = ("triangle", "wide multisine", "multisine", "steps", "small sine", "fast sine")
Memory = Callable[[Samples], Samples]


def bouc_wen(limit: float, power: float, loading: float) -> Memory:
    """z / limit along s: dz/ds = 1 - |z / limit|^power (1 - loading + loading sign(z ds))."""

    def memory(s: Samples) -> Samples:
        z, out = 0.0, []
        for way in np.diff(s, prepend=s[0]).tolist():
            parts = max(1, round(abs(way) / 0.01))
            for _ in range(parts):
                side = 1.0 if z * way > 0 else 1 - 2 * loading
                z += way / parts * (1 - abs(z / limit) ** power * side)
            out.append(z / limit)
        return np.array(out)

    return memory


def coleman_hodgdon(per_s: float) -> Memory:
    """dz/d|s| = per_s (sign(ds) - z)."""

    def memory(s: Samples) -> Samples:
        z, out = 0.0, []
        for way in np.diff(s, prepend=s[0]).tolist():
            end = np.sign(way)
            z = end + (z - end) * np.exp(-per_s * abs(way)) if way else z
            out.append(z)
        return np.array(out)

    return memory


def plays_of_field(bend: float, width: float) -> Memory:
    """The lag of ten plays of the field s + bend (s^2 - 1), and what the field lacks of s, in widths of the loop."""

    def memory(s: Samples) -> Samples:
        v = s + bend * (s**2 - 1)
        r = np.linspace(0.1, 1.0, 10)
        at, lag = np.full(10, v[0]), []
        for volt in v.tolist():
            at = np.clip(at, volt - r, volt + r)
            lag.append(float(np.mean((volt - at) / r)))
        return np.array(lag) - (v - s) / width

    return memory


def preisach(level: float, breadth: float) -> Memory:
    """The lag of ten columns of relays, whose density over the mean switching voltage is normal about a level."""

    def memory(s: Samples) -> Samples:
        r, levels = np.linspace(0.1, 1.0, 10), np.linspace(-2.2, 2.2, 4401)
        density = np.exp(-(((levels - level) / breadth) ** 2) / 2)
        below = np.cumsum(density) * (levels[1] - levels[0])
        at, read = np.full(10, s[0]), []
        for volt in s.tolist():
            at = np.clip(at, volt - r, volt + r)
            read.append(float(np.mean((volt - np.interp(at, levels, below)) / r)))
        return np.array(read)

    return memory


@contextmanager
def without(module: Any, name: str, value: object) -> Iterator[None]:
    """A part of the fit left out."""
    kept = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, kept)


@dataclass
class Bench:
    """One stage and what is played on it. s is the voltage, -1 to 1 over 0 to 10 V."""

    rng: np.random.Generator
    memory: Memory

    def __post_init__(self) -> None:
        rng = self.rng
        self.travel_um, self.width, self.bend = rng.uniform(20, 150), rng.uniform(0.08, 0.14), rng.uniform(0, 0.02)
        w, zeta = 2 * np.pi * rng.uniform(200, 700), rng.uniform(0.015, 0.04)
        b, self.a, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), 1 / RATE_HZ, method="foh")
        self.b = np.ravel(b)

    def wave(self, kind: str) -> Samples:
        """(n,) of SECONDS."""
        rng, t = self.rng, np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
        if kind == "triangle":
            return np.asarray(np.interp((2 * t) % 1, [0, 0.5, 1], [-1, 1, -1]) * np.maximum(1 - t / SECONDS, 0.05))
        if kind == "steps":
            return np.repeat(rng.uniform(-0.9, 0.9, 8), len(t) // 8)
        if kind == "small sine":
            return np.asarray(
                rng.uniform(-0.5, 0.5) + rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * rng.uniform(3, 20) * t)
            )
        if kind == "fast sine":
            return np.asarray(0.25 * np.sin(2 * np.pi * 40 * t))
        size, lines = (0.8 if kind == "wide multisine" else 0.3), np.unique(np.round(np.geomspace(1, 400, 50)))
        each = np.cos(2 * np.pi * np.outer(t, lines) + rng.uniform(0, 2 * np.pi, len(lines))) / np.sqrt(lines)
        way = each.sum(axis=1)
        return np.asarray(rng.uniform(-0.3, 0.3) * (1 - size) + size * way / np.abs(way).max())

    def record(self, kind: str, number: int) -> Recording:
        """The wave behind a full loop from 0 V, where the stage rests that has been there and back."""
        wave, turns = self.wave(kind), np.arange(round(LEAD_S * RATE_HZ)) / (LEAD_S * RATE_HZ)
        s = np.concatenate([np.full(50, -1.0), -np.cos(2 * np.pi * turns), np.linspace(-1, wave[0], 250), wave])
        still = s - self.width * self.memory(np.concatenate([[-1.0, 1.0, -1.0], s]))[3:] + self.bend * s**2
        moved = lfilter(self.b, self.a, still - still[0]) + still[0]
        x_um = self.travel_um / 2 * (1 + moved) + self.rng.normal(0, 3e-5 * self.travel_um, len(s))
        return Recording(np.arange(len(s)) / RATE_HZ, {"x": AxisRecord(5 * (1 + s), x_um)}, source=f"{kind} {number}")

    def left(self, stage: Stage, records: list[Recording]) -> float:
        """Rms over the waves, each about its mean, in % of the travel."""
        powers = []
        for record in records:
            x, model = record.axes["x"].x_um, predict(stage, record).axes["x"].x_um
            assert x is not None
            assert model is not None
            powers.append(np.var((x - model)[-round(SECONDS * RATE_HZ) :]))
        return 100 * float(np.sqrt(np.mean(powers))) / self.travel_um


def main(stages: int) -> None:
    """A line for each stage and memory."""
    for seed in range(stages):
        rng = np.random.default_rng(seed)
        loops = {
            "Bouc-Wen": bouc_wen(rng.uniform(0.3, 0.6), rng.choice([1.0, 1.4, 2.0]), rng.uniform(0.5, 0.65)),
            "Coleman-Hodgdon": coleman_hodgdon(rng.uniform(1, 3)),
        }
        for name, memory in loops.items():
            compared(f"{seed} {name}", Bench(rng, memory), "beside fading ones", regressors, "FADING", ())
        bench = Bench(np.random.default_rng([seed, 1]), lambda s: s)
        bench.memory = plays_of_field(bench.rng.uniform(0.03, 0.12) * bench.rng.choice([-1, 1]), bench.width)
        compared(f"{seed} bent field", bench, "of its field", fitting, "unevenly", as_they_are)
        bench = Bench(np.random.default_rng([seed, 2]), lambda s: s)
        bench.memory = preisach(bench.rng.uniform(-0.3, 0.3), bench.rng.uniform(0.8, 1.6))
        compared(f"{seed} Preisach", bench, "of its weights", fitting, "unevenly", as_they_are)


def as_they_are(records: Any, *_: object, **__: object) -> Any:
    """In the place of a search that would change them."""
    return records


def compared(name: str, bench: Bench, beside: str, module: Any, part: str, none: object) -> None:
    """A line on one stage: what the fit leaves without a part of it, and with it."""
    fitted, judged = ([bench.record(kind, i) for kind in KINDS] for i in range(2))
    with without(module, part, none):
        alone = bench.left(fit(fitted)[0], judged)
    print(f"{name:18} plays alone {alone:.3f} %, {beside} {bench.left(fit(fitted)[0], judged):.3f} %", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
