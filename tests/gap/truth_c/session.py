"""What this lab records: a reference session, then one to train and one held out, each after loops of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .parts import Mode, Samples
from .stage import Traits, log_uniform
from .waves import WAVES, paused, turned_down

SECONDS = {2000.0: 110.0, 5000.0: 66.0, 10000.0: 48.0}
"""Of data in a case, by its sampling rate."""
SLOW_SECONDS = {2000.0: 130.0, 5000.0: 72.0, 10000.0: 48.0}
LEVELS = (0.9, 0.45, 0.65, 0.25)
BETWEEN_S = (60.0, 600.0)
"""Between the reference session and the next."""


@dataclass(frozen=True)
class Piece:
    """One record: what runs before it, s = -1..1 of its rows, and the pause (s) in front of all that.

    It waits at the parked place where ``parked``, otherwise where the last one ended.
    """

    kind: str
    s: Samples
    pause_s: float
    parked: bool
    before: Samples
    seed: int


def plan(
    rng: np.random.Generator, traits: Traits, chain: Sequence[Sequence[Mode]], slow: bool
) -> tuple[list[Piece], list[Piece], list[Piece]]:
    """(reference, train, holdout) for a stage with these modes one after the other (`waves.turned_down`)."""
    kinds = [str(k) for k in rng.permutation(["chirp", "raster", "stairs", "wandering", "sines"])]
    if rng.random() < 0.5:
        kinds[kinds.index("chirp")] = "sweep"
    split = 3 if rng.random() < 0.7 else 2
    first = rng.integers(2, size=2)
    train = _session(rng, kinds[:split], int(rng.integers(3, 5)), int(first[0]))
    held = _session(rng, kinds[split:], int(rng.integers(2, 4)), int(first[1]))
    wanted = [_reference(rng), train, held]
    weights = [rng.uniform(0.6, 1.4, len(part)) for part in wanted]
    seconds = (SLOW_SECONDS if slow else SECONDS)[traits.rate_Hz] / sum(w.sum() for w in weights)
    sessions = [
        [_piece(rng, traits, chain, kind, level, float(seconds * w)) for (kind, level), w in zip(part, ws, strict=True)]
        for part, ws in zip(wanted, weights, strict=True)
    ]
    for part, wait_s in zip(sessions, (BETWEEN_S, BETWEEN_S, (10.0, 90.0)), strict=True):
        running_in = _running_in(rng, traits.rate_Hz) if part is not sessions[2] else np.zeros(0)
        part[0] = Piece(part[0].kind, part[0].s, log_uniform(rng, *wait_s), True, running_in, part[0].seed)
    return sessions[0], sessions[1], sessions[2]


def _reference(rng: np.random.Generator) -> list[tuple[str, float]]:
    """Kinds and levels: a full scan, a sweep through the mode, a wandering path, and one to three more."""
    found = [("scan", 1.0), ("sweep", 1.0), ("wandering", rng.uniform(0.5, 1))]
    more = [str(k) for k in rng.permutation(["stairs", "sines", "idle"])][: int(rng.integers(1, 4))]
    if "idle" not in more and rng.random() < 0.7:
        more[-1] = "idle"
    found += [(kind, rng.uniform(0.3, 1)) for kind in more]
    return [found[i] for i in rng.permutation(len(found))]


def _session(rng: np.random.Generator, kinds: Sequence[str], number: int, first: int) -> list[tuple[str, float]]:
    """The habit of the day at several levels; one of two sessions has a record at rest in it."""
    found = [(kinds[i % len(kinds)], LEVELS[(i + first) % len(LEVELS)] * rng.uniform(0.85, 1.1)) for i in range(number)]
    if rng.random() < 0.5:
        found[int(rng.integers(1, number))] = ("idle", 0.0)
    return found


def _piece(
    rng: np.random.Generator,
    traits: Traits,
    chain: Sequence[Sequence[Mode]],
    kind: str,
    level: float,
    seconds: float,
) -> Piece:
    _, f_Hz, zeta = traits.modes[0]
    wave = WAVES[kind](rng, int(seconds * traits.rate_Hz), traits.rate_Hz, f_Hz, zeta)
    if kind not in ("idle", "sweep") and rng.random() < 0.2:
        wave = paused(rng, wave, traits.rate_Hz)
    if kind == "sweep":
        bias = rng.uniform(-0.6, 0.6)
    elif kind == "idle":
        bias = traits.park if rng.random() < 0.6 else rng.uniform(-0.8, 0.8)
    else:
        bias = rng.uniform(-1, 1) * (1 - level)
    s = turned_down(level * wave, bias, traits, chain)
    return Piece(kind, s, log_uniform(rng, 3, 40), bool(rng.random() < 0.5), np.zeros(0), int(rng.integers(2**31)))


def _running_in(rng: np.random.Generator, rate_Hz: float) -> Samples:
    """Two slow loops that no record shows, in three of ten sessions not over the full range."""
    n = int(0.5 * rate_Hz)
    size = 1.0 if rng.random() < 0.7 else rng.uniform(0.3, 0.9)
    return np.asarray(size * np.sin(2 * np.pi * np.arange(2 * n) / n))
