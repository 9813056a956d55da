"""What a lab records in a session: which waves, how long, at which levels; never the same twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phaselead.record.recording import Recording

from . import waves
from .habits import Habit
from .rig import Rig

Samples = NDArray[np.float64]
UNIT_ROWS = 3000
"""Rows of a "second": records last longer where they are sampled more slowly."""
TRAIN_SHARES = ((0.75, 1.0), (0.0, 0.25))
HELD_OUT_SHARES = ((0.55, 0.7), (0.3, 0.45))
"""Where the levels of narrow records are drawn: 0 is the lowest of the lab, 1 the highest; no two records share one."""


def mixed(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """Multisines at two levels, steps with holds, a decaying triangle, idle, fast sines."""
    rng, (axis, stage) = rig.rng, next(iter(rig.stages.items()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    span, rate = c.span_V, rig.rate_Hz
    rise_rows, top = waves.rise_rows(rate), 0.42 if rate > waves.FAST_ENOUGH_HZ else 0.2
    fast = min(0.03 * rate, 0.25 * c.f_Hz) * rng.uniform(0.7, 1.0)
    made = {
        "idle": waves.idle(rate, (2.0 if held_out else 2.5) * unit),
        "steps": waves.steps(rng, span, rate, (1.8 if held_out else 2.4) * unit, 5 if held_out else 6, rise_rows),
        "fast": waves.sine(span, rate, 0.6 * unit, fast, rng.uniform(0.25, 0.45), rng.uniform(0.4, 0.6)),
    }
    if held_out:
        made["multisine"] = waves.multisine(rng, span, rate, 1.2 * unit, rng.uniform(0.35, 0.55), 0.4, c.f_Hz, top)
        made["triangle"] = waves.triangle(rng, span, rate, 1.0 * unit)
    else:
        made["small"] = waves.multisine(rng, span, rate, 1.2 * unit, rng.uniform(0.12, 0.25), 0.1, c.f_Hz, top)
        made["large"] = waves.multisine(rng, span, rate, 1.2 * unit, rng.uniform(0.7, 0.95), 0.6, c.f_Hz, top)
        made["triangle"] = waves.triangle(rng, span, rate, 1.4 * unit)
    order = ["idle", "triangle", *[k for k in ("small", "large", "multisine") if k in made], "steps", "fast"]
    return [rig.record(f"{name}-{kind}", {axis: made[kind]}) for kind in order]


def sines(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """Sines alone: a few levels, frequencies and middles."""
    rng, (axis, stage) = rig.rng, next(iter(rig.stages.items()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    top = min(0.03 * rig.rate_Hz, 0.25 * c.f_Hz)
    levels = [(1.0, 0.5), (0.5, 0.5), (0.35, 0.3), (0.3, 0.5)] if not held_out else [(0.8, 0.5), (0.4, 0.6)]
    found = []
    for i, (level, middle) in enumerate(levels):
        f_Hz = (4.0 / unit) * (top * unit / 4.0) ** ((i + rng.uniform(0, 0.6)) / len(levels))
        wave = waves.sine(c.span_V, rig.rate_Hz, 1.6 * unit, f_Hz, level * rng.uniform(0.93, 1.0), middle)
        found.append(rig.record(f"{name}-sine{i}", {axis: wave}))
    return found


def tracked(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """Paths followed under feed-forward and feedback: a triangle, a slow and a quick multisine, steps."""
    rng, stage = rig.rng, next(iter(rig.stages.values()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    level, quick = (0.45, 0.5) if held_out else (0.75, 0.2)

    def path(wave_V: Samples) -> Samples:
        share = 0.9 * wave_V / c.span_V
        return np.asarray(c.offset_um + share * c.range_um)

    made = {
        "triangle": waves.triangle(rng, c.span_V, rig.rate_Hz, unit),
        "slow": waves.multisine(rng, c.span_V, rig.rate_Hz, unit, level, 0.6, c.f_Hz, 0.08),
        "quick": waves.multisine(rng, c.span_V, rig.rate_Hz, unit, quick, 0.1, c.f_Hz, 0.4),
        "steps": waves.steps(rng, c.span_V, rig.rate_Hz, 1.2 * unit, 5),
    }
    return [rig.track(f"{name}-{kind}", path(wave)) for kind, wave in made.items()]


def three_axes(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """Each axis driven alone, then all at once, below their modes."""
    rng, unit = rig.rng, UNIT_ROWS / rig.rate_Hz
    found = []
    n = round(1.0 * unit * rig.rate_Hz)

    def wave(axis: str, together: bool) -> Samples:
        c = rig.stages[axis].character
        if held_out or together:
            level = rng.uniform(0.4, 0.7)
            return waves.multisine(rng, c.span_V, rig.rate_Hz, unit, level, 0.5, c.f_Hz, 0.15)
        return waves.triangle(rng, c.span_V, rig.rate_Hz, unit)

    still = np.zeros(n)
    for driven in rig.stages:
        found.append(rig.record(f"{name}-{driven}", {a: wave(a, False) if a == driven else still for a in rig.stages}))
    found.append(rig.record(f"{name}-all", {a: wave(a, True) for a in rig.stages}))
    return found


def poor(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """One slow sine of a tenth of the range."""
    axis, stage = next(iter(rig.stages.items()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    level = 0.08 if held_out else 0.12
    found = []
    for i in range(1 if held_out else 2):
        f_Hz = rig.rng.uniform(3, 6) / unit
        wave = waves.sine(c.span_V, rig.rate_Hz, 1.2 * unit, f_Hz, level, 0.5)
        found.append(rig.record(f"{name}-sine{i}", {axis: wave}))
    return found


def slow_sines(rig: Rig, name: str, *, held_out: bool = False) -> list[Recording]:
    """Sines of 3 to 16 Hz at 5 kHz: how late the stage is, and not why."""
    axis, stage = next(iter(rig.stages.items()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    found = []
    for i, (level, cycles) in enumerate([(0.5, 3.0)] if held_out else [(0.6, 2.0), (0.3, 8.0)]):
        f_Hz, middle = cycles * rig.rng.uniform(0.8, 1.2) / unit, rig.rng.uniform(0.4, 0.6)
        wave = waves.sine(c.span_V, rig.rate_Hz, 3.2 * unit, f_Hz, level * rig.rng.uniform(0.9, 1.1), middle)
        found.append(rig.record(f"{name}-sine{i}", {axis: wave}))
    return found


def narrow(rig: Rig, name: str, habit: Habit, *, held_out: bool = False) -> list[Recording]:
    """Idle, and what this lab always records: twice to train, once or twice held out, at other levels."""
    axis, stage = next(iter(rig.stages.items()))
    c, unit = stage.character, UNIT_ROWS / rig.rate_Hz
    shares = HELD_OUT_SHARES[: rig.rng.integers(1, 3)] if held_out else TRAIN_SHARES
    made = {"idle": waves.idle(rig.rate_Hz, (2.0 if held_out else 2.5) * unit)}
    for i, share in enumerate(shares):
        made[f"{habit.excitation}{i}"] = habit.wave(rig.rng, c, 3.2 * unit, rig.rng.uniform(*share))
    return [rig.record(f"{name}-{kind}", {axis: wave}) for kind, wave in made.items()]
