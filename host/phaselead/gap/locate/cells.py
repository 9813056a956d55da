"""Cells of a residual: its power by frequency, voltage, time since a step, direction of motion and harmonic order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.records import GapRun
from phaselead.model import Complex
from phaselead.quantity import digits
from phaselead.record import Samples

BLOCKS_PER_RECORD = 24
"""Into which every record is cut."""
LEVELS = 4
"""Voltage bands of equal width."""
ORDERS = range(1, 8)
"""Harmonics of a sine that drives the record."""
DECADES_s = tuple(10.0**exponent for exponent in range(-4, 4))
"""Edges of the cells by time since a step."""
STEP_SHARE = 0.05
"""A change of voltage between two rows, as a share of its span, that counts as a step."""
FREQUENCY, AMPLITUDE, STEP, DIRECTION, HARMONIC, AXIS = (
    "frequency", "amplitude", "time since a step", "direction", "harmonic order", "axis",
)  # fmt: skip


@dataclass(frozen=True)
class Powers:
    """Power of k residuals of one record, summed over the rows of each block."""

    additive: Samples
    """(k, blocks, cells) in um^2, of cells whose powers add up over blocks."""
    total: Samples
    """(k, blocks) in um^2."""
    coherent: Complex
    """(k, blocks, orders) in um: amplitudes of the harmonics, to be added over blocks before they are squared."""


@dataclass(frozen=True)
class Cut:
    """How one record is cut. All records of an axis have the same cells in the same order."""

    length: int
    """Rows of a block; the few rows that are left over at the end of the record stay out."""
    masks: NDArray[np.float32]
    """(cells, blocks, length), 1 where a row belongs to a cell."""
    octaves: Samples
    """Edges (Hz) of the frequency cells; slower motion counts in the first cell."""
    step_s: float
    turn: Samples | None
    """Phase (n,) of the sine that drives the record, in radians; None where no single sine does."""

    def powers(self, errors_um: Samples) -> Powers:
        """Powers of k residuals (k, n) in um."""
        blocks = errors_um[:, : BLOCKS_PER_RECORD * self.length].reshape(len(errors_um), BLOCKS_PER_RECORD, self.length)
        squares = (blocks**2).astype(np.float32)
        by_time = np.einsum("cbl,kbl->kbc", self.masks, squares, optimize=True)
        additive = np.concatenate([self._octaves(blocks), by_time], axis=2).astype(np.float64)
        return Powers(additive, np.asarray((blocks**2).sum(axis=2)), self._orders(blocks))

    def _octaves(self, blocks: Samples) -> Samples:
        """(k, blocks, octaves) in um^2. The mean and slope of a block count in the first octave."""
        line = np.linspace(-1, 1, self.length)
        line /= float(np.sqrt(np.sum(line**2)))
        mean, slope = blocks.mean(axis=2), blocks @ line
        bent = blocks - mean[..., None] - slope[..., None] * line
        lines = 2 * np.abs(np.fft.rfft(bent)[..., 1:]) ** 2 / self.length
        f = np.fft.rfftfreq(self.length, self.step_s)[1:]
        cell = np.searchsorted(self.octaves[1:-1], f, side="right")
        found = lines @ (cell[:, None] == np.arange(len(self.octaves) - 1)).astype(np.float64)
        found[..., 0] += self.length * mean**2 + slope**2
        return np.asarray(found)

    def _orders(self, blocks: Samples) -> Complex:
        """(k, blocks, orders) in um; zeros where no single sine drives the record."""
        if self.turn is None:
            return np.zeros((*blocks.shape[:2], len(ORDERS)), np.complex128)
        turn = self.turn[: BLOCKS_PER_RECORD * self.length].reshape(BLOCKS_PER_RECORD, self.length)
        waves = np.exp(-1j * np.array(ORDERS)[:, None, None] * turn) * np.sqrt(2 / turn.size)
        return np.asarray(np.einsum("obl,kbl->kbo", waves, blocks, optimize=True))


def cut(runs: Sequence[GapRun]) -> tuple[list[Cut], list[tuple[str, str]]]:
    """Every record cut, and the kind and name of each cell: additive cells first, then the harmonic orders."""
    driven = [r.u_V[r.rows] for r in runs if r.driven]
    levels: list[float] = []
    if driven:
        low, high = min(float(u.min()) for u in driven), max(float(u.max()) for u in driven)
        levels = np.linspace(low, high, LEVELS + 1).tolist()
    lengths = [(r.stop - r.start) // BLOCKS_PER_RECORD for r in runs]
    longest_s = max(length * r.step_s for length, r in zip(lengths, runs, strict=True))
    octaves = 2.0 ** np.arange(np.floor(np.log2(2 / longest_s)), np.ceil(np.log2(0.5 / runs[0].step_s)) + 1)
    cuts = []
    for length, run in zip(lengths, runs, strict=True):
        inside = _inside(run, levels)[:, : BLOCKS_PER_RECORD * length].reshape(-1, BLOCKS_PER_RECORD, length)
        turn = None if run.sine is None else np.asarray(2 * np.pi * run.sine.f_Hz * run.t_s[run.rows])
        cuts.append(Cut(length, inside.astype(np.float32), octaves, run.step_s, turn))
    return cuts, [
        *((FREQUENCY, f"{digits(a, 3)}..{digits(b, 3)} Hz") for a, b in pairwise([0.0, *octaves[1:].tolist()])),
        *((DIRECTION, name) for name in ("rising", "falling", "still")),
        *((AMPLITUDE, f"{a:.3g}..{b:.3g} V") for a, b in pairwise(levels)),
        *((STEP, f"{a:g}..{b:g} s") for a, b in pairwise(DECADES_s)),
        *((HARMONIC, str(order)) for order in ORDERS),
    ]


def _inside(run: GapRun, levels: Sequence[float]) -> NDArray[np.bool_]:
    """Scored rows (cells, n) that lie in the cells by direction, voltage (edges: ``levels``) and time since a step."""
    u, since = run.u_V[run.rows], _since_step(run)
    slope = np.diff(run.u_V, prepend=run.u_V[0])[run.rows]
    by_level = [(u >= a) & (u <= b if b == levels[-1] else u < b) & run.driven for a, b in pairwise(levels)]
    by_time = [(since >= a) & (since < b) for a, b in pairwise(DECADES_s)]
    return np.stack([slope > 0, slope < 0, slope == 0, *by_level, *by_time])


def steps_of(run: GapRun) -> NDArray[np.intp]:
    """Rows (m,) of the whole recording at which the voltage jumps."""
    jumps = np.abs(np.diff(run.u_V, prepend=run.u_V[0])) > STEP_SHARE * max(float(np.ptp(run.u_V)), 1e-12)
    return np.flatnonzero(jumps)


def _since_step(run: GapRun) -> Samples:
    """Seconds since the last jump of the voltage (n,) over the scored rows; infinite before the first."""
    rows, steps = np.arange(len(run.u_V)), steps_of(run)
    lasts = np.full(len(rows), -1)
    lasts[steps] = steps
    last = np.maximum.accumulate(lasts)
    return np.where(last >= 0, (rows - last + 1) * run.step_s, np.inf)[run.rows]
