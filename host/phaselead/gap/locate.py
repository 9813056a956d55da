"""Where model and measurement part: cells of the held-out and training residual, ranked, each with a sentence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from phaselead.gap.records import Run
from phaselead.gap.result import Cell
from phaselead.record.recording import Samples

Mask = NDArray[np.bool_]
DRAWS = 500
BLOCKS = 24
STEP_SHARE = 0.05
"""Of its span: a change of voltage between two rows that starts the clock of a step."""
LEVEL = 0.01
MOST = 12

Ranked = tuple[str, str, float, float, str]
"""By, cell, share, family-wise p, sentence."""


@dataclass(frozen=True)
class Part:
    """Residual of one run (n,) about its own offset, and how large it is where nothing is missing."""

    run: Run
    error_um: Samples
    floor_um: float


def locate(parts: Sequence[Part], seed: int, axis: str | None = None) -> list[Cell]:
    """Cells ranked by share of the unexplained power; those that a constant floor would also show are left out.

    Family-wise at 1 % by max-T (Westfall and Young 1993): the excess of each cell over its share of the rows, against
    blocks of the residual dealt out at random.
    """
    power = sum(float(np.sum(p.error_um**2)) for p in parts)
    if not power > 0:
        return []
    found: list[Ranked] = []
    for by, cells in _families(parts).items():
        shares, p_values = _tested(parts, cells, seed)
        for (name, words, _), share, p in zip(cells, shares, p_values, strict=True):
            if share > 0.01:
                found.append((by, name, share, p, f"{100 * share:.0f} % of the unexplained power {words}"))
    found += [*_frequency(parts), *_harmonics(parts)]
    ranked = sorted(found, key=lambda c: (c[3] > LEVEL, -c[2]))[:MOST]
    return [Cell(by, name, share, sentence, p, axis) for by, name, share, p, sentence in ranked]


Family = list[tuple[str, str, Callable[[Part], Mask]]]


def _families(parts: Sequence[Part]) -> dict[str, Family]:
    span = max((float(np.ptp(p.run.u_V[p.run.rows])) for p in parts), default=0.0)
    low = min(float(p.run.u_V[p.run.rows].min()) for p in parts)
    families: dict[str, Family] = {
        "direction": [
            ("rising", "is left while the voltage rises", lambda p: _slope(p) > 0),
            ("falling", "is left while it falls", lambda p: _slope(p) < 0),
            ("still", "is left while it stands still", lambda p: _slope(p) == 0),
        ],
        "amplitude": [],
        "time since a step": [],
    }
    if span > 0:
        for i in range(4):
            a, b = low + span * i / 4, low + span * (i + 1) / 4
            families["amplitude"].append(
                (f"{a:.3g}..{b:.3g} V", f"is left between {a:.3g} and {b:.3g} V", _between(a, b))
            )
    for exponent in range(-4, 2):
        a, b = 10.0**exponent, 10.0 ** (exponent + 1)
        words = f"comes {a:g} to {b:g} s after a step"
        families["time since a step"].append((f"{a:g}..{b:g} s", words, _since(a, b)))
    return {by: family for by, family in families.items() if family}


def _slope(part: Part) -> Samples:
    return np.diff(part.run.u_V, prepend=part.run.u_V[0])[part.run.rows]


def _between(a: float, b: float) -> Callable[[Part], Mask]:
    def cell(part: Part) -> Mask:
        u = part.run.u_V[part.run.rows]
        return np.asarray((u >= a) & (u <= b) & part.run.driven)

    return cell


def _since(a: float, b: float) -> Callable[[Part], Mask]:
    def cell(part: Part) -> Mask:
        since = since_step(part.run)
        return np.asarray((since >= a) & (since < b))

    return cell


def since_step(run: Run) -> Samples:
    """Seconds since the last jump of the voltage (n,) over the scored rows; infinite before the first."""
    jumps = np.abs(np.diff(run.u_V, prepend=run.u_V[0])) > STEP_SHARE * max(float(np.ptp(run.u_V)), 1e-12)
    lasts = np.where(jumps, np.arange(len(run.u_V)), -1)
    last = np.maximum.accumulate(lasts)
    since = (np.arange(len(run.u_V)) - last + 1) * run.step_s
    return np.where(last >= 0, since, np.inf)[run.rows]


def _tested(parts: Sequence[Part], cells: Family, seed: int) -> tuple[Samples, Samples]:
    """Shares (cells,) and family-wise p values."""
    power, rows = [], []
    for part in parts:
        masks = np.stack([cell(part) for _, _, cell in cells]).astype(np.float64)
        edges = np.linspace(0, len(part.error_um), BLOCKS + 1).astype(int)
        squares = np.add.reduceat(part.error_um**2, edges[:-1])
        of_cell = np.stack([np.add.reduceat(part.error_um**2 * m, edges[:-1]) for m in masks], axis=1)
        power.append(np.concatenate([of_cell, squares[:, None]], axis=1))
        rows.append(np.stack([np.add.reduceat(m, edges[:-1]) / len(part.error_um) for m in masks], axis=1))
    counted, expected = np.concatenate(power), np.concatenate(rows)
    total = counted[:, -1].sum()
    shares = counted[:, :-1].sum(axis=0) / total
    rng = np.random.default_rng(seed)
    null = np.array([_excess(rng.permutation(counted[:, -1]), expected) for _ in range(DRAWS)])
    centre, spread = null.mean(axis=0), null.std(axis=0) + 1e-12
    seen = (shares - centre) / spread
    largest = ((null - centre) / spread).max(axis=1)
    p = (1 + (largest[:, None] >= seen).sum(axis=0)) / (DRAWS + 1)
    return shares, p


def _excess(squares: Samples, expected: Samples) -> Samples:
    within = expected / np.maximum(expected.sum(axis=1, keepdims=True), 1e-12)
    return np.asarray((squares[:, None] * within).sum(axis=0) / squares.sum())


def _frequency(parts: Sequence[Part]) -> list[Ranked]:
    """Octaves of the residual's spectrum."""
    density: dict[int, float] = {}
    for part in parts:
        f, s = welch(part.error_um, 1 / part.run.step_s, nperseg=min(len(part.error_um), 8192))
        width = float(f[1] - f[0])
        for octave, value in zip(np.floor(np.log2(np.maximum(f[1:], width))).astype(int), s[1:], strict=True):
            density[int(octave)] = density.get(int(octave), 0.0) + float(value) * width * len(part.error_um)
    total = sum(density.values()) or 1.0
    found = []
    for octave, value in density.items():
        a, b, share = 2.0**octave, 2.0 ** (octave + 1), value / total
        if share > 0.1:
            words = f"{100 * share:.0f} % of the unexplained power lies between {a:.3g} and {b:.3g} Hz"
            found.append(("frequency", f"{a:.3g}..{b:.3g} Hz", share, 0.0, words))
    return found


def _harmonics(parts: Sequence[Part]) -> list[Ranked]:
    """Orders of the drive's frequency where a run is driven by a sine: odd and even tell symmetric from asymmetric."""
    from phaselead.identify.checks import AxisRun

    power, total = np.zeros(8), 0.0
    for part in parts:
        run = part.run
        sine = AxisRun(run.t_s, run.u_V, run.x_um, run.rows, run.axis, run.source).sine if run.driven else None
        if sine is None:
            continue
        turn = 2 * np.pi * sine.f_Hz * run.t_s[run.rows]
        for order in range(1, 8):
            even, odd = np.mean(part.error_um * np.cos(order * turn)), np.mean(part.error_um * np.sin(order * turn))
            power[order] += 2 * float(even**2 + odd**2) * len(turn)
        total += float(np.sum(part.error_um**2))
    names = {1: "the fundamental", 2: "the second harmonic: one half of the loop differs from the other"}
    return [
        (
            "harmonic order", str(order), power[order] / total, 0.0,
            f"{100 * power[order] / total:.0f} % of the power left under sines is "
            f"{names.get(order, f'harmonic {order}')}",
        )
        for order in range(1, 8)
        if total > 0 and power[order] / total > 0.05
    ]  # fmt: skip
