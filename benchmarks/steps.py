"""When a move by the queue has settled, as docs/tracking.md has it: 100 um from several places, up and down.

The stage is identified first, and its loop tuned for the second table. Each move is made from a hold, as `phaselead
move` makes it, with each of three seeds of the sensor's noise; its time counts from the first tick in which the
reference moves to the last in which the measured position is more than 0.1 % of the way from the end. The last table is
of the first way, as identified, by mode.
"""

from __future__ import annotations

import numpy as np

import phaselead as pl
from phaselead.model import Stage

WAYS_um = ((10.0, 110.0), (40.0, 140.0), (110.0, 10.0), (150.0, 50.0))
SEEDS = (1, 2, 3)
MODES = ("inverse", "inverse+pid", "ff+pid")
WATCHED_TICKS, TICK_HZ = 3000, 5000


def settled_ms(model: Stage, from_um: float, to_um: float, seed: int, mode: str = "inverse+pid") -> tuple[float, float]:
    """Of the move, and when it had settled; the latter infinite where it had not within half a second."""
    with pl.connect(f"sim://xyz250?seed={seed}") as dev:
        dev.move(x=from_um, model=model, mode=mode, rehearse=False)
        dev.device.wait(0.3)
        with dev.live("x") as live:
            live.read(0.01)
            moved = dev.move(x=to_um, wait=False)
            parts, ticks = [], 0
            while ticks < WATCHED_TICKS:
                for part in live.read(0.005):
                    parts.append(part.axes["x"])
                    ticks += part.ticks
    x_um = np.concatenate([part.x_um for part in parts])
    r_um = np.concatenate([part.r_um for part in parts])
    begin = np.flatnonzero(np.abs(r_um - r_um[0]) > 1e-4)[0]
    off_um = np.abs(x_um[begin : begin + TICK_HZ // 2] - to_um)
    late = np.flatnonzero(off_um > 1e-3 * abs(to_um - from_um))
    settled = (late[-1] + 1) / TICK_HZ * 1e3 if late[-1] + 1 < len(off_um) else np.inf
    return moved.axes["x"].duration_s * 1e3, float(settled)


def line(said: str, found: list[tuple[float, float]]) -> None:
    print(f"| {said} | {found[0][0]:.1f} | {', '.join(f'{ms:.1f}' for _, ms in found)} |", flush=True)


def main() -> None:
    with pl.connect("sim://xyz250") as dev:
        fitted = dev.identify("x").model
    with pl.connect("sim://xyz250") as dev:
        tuned = dev.tune("x", model=fitted).model
    for said, model in (("identified", fitted), ("tuned", tuned)):
        print(f"\n| {said}: from, to (um) | move (ms) | settled (ms), by seed |\n|---|---|---|")
        for from_um, to_um in WAYS_um:
            line(f"{from_um:g}, {to_um:g}", [settled_ms(model, from_um, to_um, seed) for seed in SEEDS])
    print("\n| 10, 110, mode | move (ms) | settled (ms), by seed |\n|---|---|---|")
    for mode in MODES:
        line(mode, [settled_ms(fitted, *WAYS_um[0], seed, mode) for seed in SEEDS])


if __name__ == "__main__":
    main()
