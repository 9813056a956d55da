"""When a move by the queue has settled, as docs/tracking.md has it, with identify's gains and with those of tune.

A stage is identified and tuned first. Each move is made from a hold, as `phaselead move` makes it: four that were
looked at while the inverse was made, and eight from random places, up and down, each with six seeds of noise that were
not. Its time counts from the first tick in which the reference moves to the last in which the position, true or
measured, is more than 0.1 % of the way from the end.

Run with `python benchmarks/steps.py [STAGE...]`, in mode inverse+pid.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass

import numpy as np

import phaselead as pl
from phaselead.device import TICK_HZ
from phaselead.model import Stage
from phaselead.record import Samples

STAGES = ("xyz250", "x100")
WAY_um = {"xyz250": 100.0, "x100": 40.0}
PLACES_um = {"xyz250": (5.0, 200.0), "x100": (5.0, 90.0)}
KNOWN_um = {"xyz250": ((10.0, 110.0), (40.0, 140.0), (110.0, 10.0), (150.0, 50.0))}
RANDOM_PAIRS = 8
SEEDS = tuple(range(11, 17))
REST_s, WATCHED_s = 0.3, 0.06
KEPT_TICKS = 20_000
LEAST_WAY_um = 1e-4
"""The reference has begun to move."""


@dataclass(frozen=True)
class Settled:
    """Milliseconds, of one move."""

    move: float
    true: float
    measured: float


def pairs_um(name: str) -> list[tuple[float, float]]:
    """Where the moves begin and end, up and down in turn."""
    (low, high), way, rng = PLACES_um[name], WAY_um[name], np.random.default_rng(77)
    lower = [round(float(rng.uniform(low, high - way)), 1) for _ in range(RANDOM_PAIRS)]
    random = [(at, at + way) if i % 2 else (at + way, at) for i, at in enumerate(lower)]
    return [*KNOWN_um.get(name, ()), *random]


def settled(name: str, model: Stage, from_um: float, to_um: float, seed: int) -> Settled:
    with pl.connect(f"sim://{name}?seed={seed}") as dev:
        dev.move(x=from_um, model=model, rehearse=False)
        dev.device.wait(REST_s)
        port = dev.device.session.port
        port.trace_true_positions(KEPT_TICKS)
        parts, ticks = [], 0
        with dev.live("x") as live:
            live.read(0.01)
            moved = dev.move(x=to_um, wait=False)
            while ticks < WATCHED_s * TICK_HZ:
                for part in live.read(0.005):
                    parts.append(part)
                    ticks += part.ticks
        first, true_um = port.true_positions()
    r_um = np.concatenate([part.axes["x"].r_um for part in parts])
    begin = int(np.flatnonzero(np.abs(r_um - r_um[0]) > LEAST_WAY_um)[0])
    measured_um = np.concatenate([part.axes["x"].x_um for part in parts])
    allowed_um = 1e-3 * abs(to_um - from_um)
    return Settled(
        moved.axes["x"].duration_s * 1e3,
        last_off_ms(true_um[parts[0].first_tick - first + begin :, 0], to_um, allowed_um),
        last_off_ms(measured_um[begin:], to_um, allowed_um),
    )


def last_off_ms(x_um: Samples, to_um: float, allowed_um: float) -> float:
    off = np.flatnonzero(np.abs(x_um - to_um) > allowed_um)
    return float((off[-1] + 1) / TICK_HZ * 1e3)


def main(names: tuple[str, ...]) -> None:
    warnings.simplefilter("ignore")
    print(
        "| stage | way (um) | gains of | moves | move (ms) | true position settled (ms), median, largest | measured |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in names:
        with pl.connect(f"sim://{name}") as dev:
            identified = dev.identify("x").model
            tuned = dev.tune("x", model=identified).model
        for gains, model in (("`identify`", identified), ("`tune`", tuned)):
            found = [settled(name, model, *pair, seed) for pair in pairs_um(name) for seed in SEEDS]
            move = max(one.move for one in found)
            each = ([one.true for one in found], [one.measured for one in found])
            cells = " | ".join(f"{np.median(ms):.1f}, {max(ms):.1f}" for ms in each)
            print(f"| `{name}` | {WAY_um[name]:g} | {gains} | {len(found)} | {move:.1f} | {cells} |", flush=True)


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or STAGES)
