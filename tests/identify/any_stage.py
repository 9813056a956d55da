"""Stages and records that a laboratory hands over, simulated apart from the product's classes.

Memory is a stack of plays with an exponential density, run row by row with nothing but max and min, bent by a square,
or a Bouc-Wen loop; mechanics are scipy's state space on a grid four times finer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from phaselead.record.recording import AxisRecord, Recording

Array = NDArray[np.float64]
FINER = 4
AMPLIFIER_FINER = 25
"""So fine that a delay of whole steps leaves no doubt of what happens between rows."""
LEAD_S = 1.0
"""Of the full loop in front of a record."""


def play_stack(u: Array, span: float) -> Array:
    """Volts in, volts out: 0.7 of it reversible, with a slight bend."""
    r = span * 0.45 * np.geomspace(0.004, 1.0, 40)
    density = np.exp(-r / (0.12 * span)) * np.gradient(r)
    at, moved = np.zeros(len(r)), np.empty(len(u))
    weight = 0.3 * density / density.sum()
    for k, volt in enumerate(u.tolist()):
        np.minimum(np.maximum(at, volt - r, out=at), volt + r, out=at)
        moved[k] = weight @ at
    return np.asarray(0.7 * u * (1 + 0.08 * u / span) + moved)


def bouc_wen(u: Array, span: float) -> Array:
    """z' = (1 - |z| (0.6 sign(z u') + 0.4)) u', scaled to the span; a tenth of the motion is z."""
    scale, z, way = 0.15 * span, 0.0, []
    for du in np.diff(u, prepend=u[0]).tolist():
        z += (1 - abs(z) * (0.4 + (0.6 if z * du > 0 else -0.6))) * du / scale
        way.append(z)
    return np.asarray(0.9 * u + 0.1 * scale * np.array(way) * 2)


@dataclass(frozen=True)
class AnyStage:
    """``modes``: share of the motion, Hz, damping; shares that do not add up to 1 leave the rest stiff."""

    modes: tuple[tuple[float, float, float], ...] = ()
    um_per_V: float = 10.0
    span_V: float = 10.0
    delay_s: float = 2e-4
    noise_um: float = 0.011
    memory: Callable[[Array, float], Array] = play_stack
    lag_s: float = 0.0
    """Time constant of the amplifier; one has the delay in front of it."""

    def behind_amplifier(self, u: Array, rate_Hz: float) -> Array:
        """Voltage (n,), late and lagging."""
        step_s = 1 / (AMPLIFIER_FINER * rate_Hz)
        b, a, _ = cont2discrete(([1.0], [self.lag_s, 1.0]), step_s, method="foh")
        fine = np.interp(np.arange(AMPLIFIER_FINER * len(u)) / AMPLIFIER_FINER, np.arange(len(u)), u)
        late = np.concatenate([np.full(round(self.delay_s / step_s), u[0]), fine])[: len(fine)]
        return np.asarray(lfilter(np.ravel(b), a, late)[::AMPLIFIER_FINER])

    def measure(self, u: Array, rate_Hz: float, seed: int) -> Array:
        """Position (n,) in um from rest at 0 V."""
        if self.lag_s:
            at_once = replace(self, delay_s=0.0, lag_s=0.0)
            return at_once.measure(self.behind_amplifier(u, rate_Hz), rate_Hz, seed)
        still = self.um_per_V * self.memory(u, self.span_V)
        rows = np.arange(len(u))
        fine = np.interp(np.arange(0, len(u), 1 / FINER) - self.delay_s * rate_Hz, rows, still)
        moved = (1 - sum(c for c, _, _ in self.modes)) * fine
        for c, f_Hz, zeta in self.modes:
            w = 2 * np.pi * f_Hz
            b, a, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), 1 / (FINER * rate_Hz), method="foh")
            moved += c * (lfilter(np.ravel(b), a, fine - fine[0]) + fine[0])
        noise = np.random.default_rng(seed).standard_normal(len(u))
        return np.asarray(moved[::FINER] + self.noise_um * noise)


def time_s(seconds: float, rate_Hz: float) -> Array:
    return np.arange(round(seconds * rate_Hz)) / rate_Hz


def full_loop(span: float, rate_Hz: float) -> Array:
    t = time_s(LEAD_S, rate_Hz)
    return np.asarray(span / 2 * (1 - np.cos(2 * np.pi * t / LEAD_S)))


def slow_sine(span: float, rate_Hz: float, share: float, f_Hz: float = 1.0) -> Array:
    t = time_s(3 / f_Hz, rate_Hz)
    return np.asarray(share * span / 2 * (1 - np.cos(2 * np.pi * f_Hz * t)))


def steps(span: float, rate_Hz: float, edge_s: float = 0.008, seed: int = 1) -> Array:
    levels = np.concatenate([[0.0], np.random.default_rng(seed).uniform(0, span, 7), [0.0]])
    at = np.concatenate([[0.0]] + [[0.25 * i + 0.1, 0.25 * i + 0.1 + edge_s] for i in range(8)])
    return np.interp(time_s(2.2, rate_Hz), at, np.concatenate([[0.0], np.repeat(levels, 2)[1:-1]]))


def idle(span: float, rate_Hz: float) -> Array:
    t = time_s(2.0, rate_Hz)
    return np.interp(t, [0.2, 0.5, 1.4, 1.6], [0.0, 0.4 * span, 0.4 * span, 0.0])


def multisine(span: float, rate_Hz: float, seed: int = 2, top_Hz: float = 600.0, low_Hz: float = 2.0) -> Array:
    t, rng = time_s(3.0, rate_Hz), np.random.default_rng(seed)
    f_Hz = np.arange(low_Hz, top_Hz, 2.0)
    phase = rng.uniform(0, 2 * np.pi, len(f_Hz))
    lines = np.cos(2 * np.pi * np.outer(t, f_Hz) + phase).sum(axis=1)
    fade = np.minimum(t / 0.2, 1.0)
    return np.asarray(span * fade * (0.5 + 0.12 * lines / np.abs(lines).max()))


def ramp(span: float, rate_Hz: float) -> Array:
    return np.asarray(0.6 * span * time_s(1.5, rate_Hz) / 1.5)


def record_of(stage: AnyStage, u: Array, rate_Hz: float, seed: int, source: str, offset_um: float = 0.0) -> Recording:
    t = np.arange(len(u)) / rate_Hz
    return Recording(t, {"x": AxisRecord(u, stage.measure(u, rate_Hz, seed) + offset_um)}, slice(None), source,
                     f"{seed:064x}")  # fmt: skip


def drives(span: float, rate_Hz: float, lead: bool = True) -> dict[str, Array]:
    """What a laboratory records of one stage, each after a full-range loop."""
    made = {
        "sine": slow_sine(span, rate_Hz, 0.8),
        "small sine": slow_sine(span, rate_Hz, 0.05, 5.0),
        "steps": steps(span, rate_Hz),
        "idle": idle(span, rate_Hz),
        "multisine": multisine(span, rate_Hz),
        "ramp": ramp(span, rate_Hz),
    }
    return {name: np.concatenate([full_loop(span, rate_Hz), u]) if lead else u for name, u in made.items()}


def laboratory(stage: AnyStage, rate_Hz: float = 5000.0, seed: int = 0, only: tuple[str, ...] = ()) -> list[Recording]:
    made = drives(stage.span_V, rate_Hz)
    return [
        record_of(stage, u, rate_Hz, 100 * seed + i, name)
        for i, (name, u) in enumerate(made.items())
        if not only or name in only
    ]


def held_out(stage: AnyStage, rate_Hz: float = 5000.0) -> Recording:
    u = np.concatenate(
        [full_loop(stage.span_V, rate_Hz), multisine(stage.span_V, rate_Hz, 17)[: round(rate_Hz)],
         slow_sine(stage.span_V, rate_Hz, 0.3, 3.0), steps(stage.span_V, rate_Hz, seed=9)]
    )  # fmt: skip
    return record_of(stage, u, rate_Hz, 99, "held out")


NO_MODE = AnyStage()
ONE_MODE = replace(NO_MODE, modes=((1.0, 430.0, 0.036),))
