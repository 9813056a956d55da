"""What `phaselead gap` makes of a leak on a stage that is driven about a bias, and what that costs.

A stage of its own: six plays, a slope that rises by 30 % over the range, a mode at 120 Hz, driven between 10 and 90 V.
Twelve records of 10 to 18 s at 500 Hz, four of them references without the leak; before each the stage was ramped from
0 V and held for 2 s. Printed are the verdict, the leak that was found, the processor time, and how many times that of
the same session without a leak it is. Give rates in 1/s for others than 0.02.

    python benchmarks/leak_about_bias.py
    python benchmarks/leak_about_bias.py 0.005 0.06
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import cont2discrete, lfilter

from phaselead.freed_memory import keep_freed_memory
from phaselead.gap import GapResult, run_gap
from phaselead.identify import fit
from phaselead.record import Recording, Samples
from phaselead.record.recording import AxisRecord

RATE_HZ, LOW_V, HIGH_V, TRAVEL_UM, NOISE_UM = 500.0, 10.0, 90.0, 30.0, 0.004
MODE_HZ, ZETA, RISE = 120.0, 0.05, 0.15
THRESHOLDS = np.array([0.02, 0.05, 0.10, 0.16, 0.24, 0.33]) * (HIGH_V - LOW_V)  # V
WEIGHTS = np.array([0.05, 0.05, 0.05, 0.04, 0.03, 0.03])
LEAD_s = 4.0
"""Of the ramp from 0 V to where a record begins, and of the hold there."""


def stage(u_V: Samples, leak_per_s: float) -> Samples:
    """Position (n,) in um of a stage that was at rest at 0 V."""
    keeps, operated = np.exp(-leak_per_s / RATE_HZ), np.empty_like(u_V)
    lost_V, plays = 0.0, np.zeros(len(THRESHOLDS))
    for i, u in enumerate(u_V):
        v = u - lost_V
        lost_V = u - keeps * v
        plays = np.clip(plays, v - THRESHOLDS, v + THRESHOLDS)
        operated[i] = v * (1 + RISE * v / HIGH_V) + WEIGHTS @ plays
    x = TRAVEL_UM / (HIGH_V - LOW_V) * operated
    w = 2 * np.pi * MODE_HZ
    b, a, _ = cont2discrete(([w * w], [1, 2 * ZETA * w, w * w]), 1 / RATE_HZ, "zoh")
    return np.asarray(lfilter(b[0], a, x - x[0]) + x[0])


def sines(seconds: float, *parts: tuple[float, float]) -> Samples:
    """Voltages of several (frequency in Hz, share of half the range)."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return np.asarray(sum(share * np.sin(2 * np.pi * f_Hz * t) for f_Hz, share in parts))


def steps(rng: np.random.Generator, seconds: float, hold_s: float) -> Samples:
    """Levels that are held, each reached within 50 ms, as shares of half the range."""
    rows, hold = round(seconds * RATE_HZ), round(hold_s * RATE_HZ)
    levels = np.repeat(rng.uniform(-0.9, 0.9, rows // hold + 1), hold)[:rows]
    rise = round(0.05 * RATE_HZ)
    return np.asarray(np.convolve(np.pad(levels, (rise, 0), mode="edge"), np.ones(rise) / rise)[rise : rise + rows])


def session(leak_per_s: float) -> tuple[list[Recording], list[Recording], list[Recording]]:
    """References, records to train and held-out records."""
    rng = np.random.default_rng(1)
    reference = [sines(10, (0.5, 0.95)), sines(12, (0.3, 0.6), (2.1, 0.3)), steps(rng, 14, 1.0),
                 sines(12, (1.0, 0.5), (7.0, 0.3))]  # fmt: skip
    train = [sines(10, (0.5, 0.95)), sines(18, (0.11, 0.55), (1.3, 0.35)), steps(rng, 16, 2.0),
             sines(14, (0.7, 0.6), (5.0, 0.3)), steps(rng, 12, 0.7), sines(16, (0.2, 0.8))]  # fmt: skip
    holdout = [sines(12, (0.25, 0.6), (1.7, 0.35)), steps(rng, 14, 1.3)]

    def recorded(name: str, wave: Samples, leaks_per_s: float) -> Recording:
        u_V = (LOW_V + HIGH_V) / 2 + (HIGH_V - LOW_V) / 2 * wave
        lead = round(LEAD_s * RATE_HZ)
        before = np.minimum(np.linspace(0, 2, lead), 1) * u_V[0]
        x_um = stage(np.concatenate([before, u_V]), leaks_per_s)[lead:] + NOISE_UM * rng.normal(size=len(u_V))
        return Recording(np.arange(len(u_V)) / RATE_HZ, {"x": AxisRecord(u_V, x_um)}, source=name)

    return (
        [recorded(f"reference-{i}", wave, 0.0) for i, wave in enumerate(reference)],
        [recorded(f"train-{i}", wave, leak_per_s) for i, wave in enumerate(train)],
        [recorded(f"holdout-{i}", wave, leak_per_s) for i, wave in enumerate(holdout)],
    )


def timed(leak_per_s: float) -> tuple[GapResult, float]:
    """What is found of a leak of this rate, and the processor time in s."""
    reference, train, holdout = session(leak_per_s)
    model, _ = fit(reference)
    begin = time.process_time()
    return run_gap(model, train, holdout, reference), time.process_time() - begin


def main() -> None:
    keep_freed_memory()
    none, without_s = timed(0.0)
    print("| leak, 1/s | verdict | found | processor time | times that without a leak |\n|---|---|---|---|---|")
    print(f"| none | {', '.join(none.verdicts)} | | {without_s:.0f} s | 1 |", flush=True)
    for rate_per_s in map(float, sys.argv[1:] or ["0.02"]):
        result, spent_s = timed(rate_per_s)
        named = []
        for one in result.effects:
            said = ""
            if one.name == "charge_leakage":
                value, _, (low, high) = one.params["rate_per_s"]
                said = f" {value:.4f} ({low:.4f} .. {high:.4f})"
            named.append(one.name + said)
        print(f"| {rate_per_s} | {', '.join(result.verdicts)} | {'; '.join(named)} | {spent_s:.0f} s | "
              f"{spent_s / without_s:.0f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
