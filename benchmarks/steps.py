"""When a move by the queue has settled, as docs/tracking.md has it: 100 um from several places, up and down.

The stage is identified first. Each move is made from a hold, as `phaselead move` makes it, with each of three seeds of
the sensor's noise; its time counts from the first tick in which the reference moves to the last in which the measured
position is more than 0.1 % of the way from the end.
"""

from __future__ import annotations

import numpy as np

import phaselead as pl
from phaselead.model import Stage

WAYS_um = ((10.0, 110.0), (40.0, 140.0), (110.0, 10.0), (150.0, 50.0))
SEEDS = (1, 2, 3)
WATCHED_TICKS, TICK_HZ = 600, 5000


def settled_ms(model: Stage, from_um: float, to_um: float, seed: int) -> tuple[float, float]:
    """Of the move, and when it had settled."""
    with pl.connect(f"sim://xyz250?seed={seed}") as dev:
        dev.move(x=from_um, model=model, rehearse=False)
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
    late = np.flatnonzero(np.abs(x_um[begin : begin + WATCHED_TICKS // 2] - to_um) > 1e-3 * abs(to_um - from_um))
    return moved.axes["x"].duration_s * 1e3, (late[-1] + 1) / TICK_HZ * 1e3


def main() -> None:
    with pl.connect("sim://xyz250") as dev:
        model = dev.identify("x").model
    print("| from, to (um) | move (ms) | settled (ms), by seed |\n|---|---|---|")
    for from_um, to_um in WAYS_um:
        found = [settled_ms(model, from_um, to_um, seed) for seed in SEEDS]
        each = ", ".join(f"{ms:.1f}" for _, ms in found)
        print(f"| {from_um:g}, {to_um:g} | {found[0][0]:.1f} | {each} |")


if __name__ == "__main__":
    main()
