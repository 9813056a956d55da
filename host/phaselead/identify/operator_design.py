"""Rows and columns of the operator fit: which samples count, and what each play and each segment adds to
them.

The reversible part of the operator is written as slopes over segments between knots, so that "monotone" is
simply "no slope is negative"; ``time_view`` turns them into a gain and one-sided dead zones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.columns import Columns, Slopes
from phaselead.identify.runs import AxisRun, jumps, period_s
from phaselead.model import Mode, TimeView, behind_modes
from phaselead.record import Samples

AFTER_JUMP = 0.1
"""Share of a period after a jump in which a model without dynamics is not asked to agree."""


@dataclass(frozen=True)
class Basis:
    """Thresholds of the plays (m,), rising, and edges of the segments (s + 1,), rising, all in V."""

    play_r_V: Samples
    knots_V: Samples

    @property
    def size(self) -> int:
        return len(self.knots_V) - 1 + len(self.play_r_V)

    def equals(self, other: Basis) -> bool:
        """Whether both have the same plays and segments."""
        return np.array_equal(self.play_r_V, other.play_r_V) and np.array_equal(self.knots_V, other.knots_V)

    @cached_property
    def _segments(self) -> tuple[Samples, Samples, Samples]:
        """Ends of every segment, and where 0 V stands in it; the end segments go on."""
        low, high = self.knots_V[:-1].copy(), self.knots_V[1:].copy()
        low[0], high[-1] = -np.inf, np.inf
        return low, high, np.clip(0.0, low, high)

    def resting(self, rest_fraction: float) -> Slopes:
        """For ``FitRun.fill``, counted from rest at 0 V."""
        return Slopes(self._segments, self.play_r_V, rest_fraction * self.play_r_V)


def nested_basis(swing_V: float, low_V: float, high_V: float, n_plays: int, n_segments: int) -> Basis:
    """Thresholds up to half of ``swing_V``, denser where they are small, and equal segments from low to high.

    The steady loop of a swing never moves a play whose threshold is beyond half of it.
    """
    r = swing_V / 2 * (np.arange(1, n_plays + 1) / max(n_plays, 1)) ** 1.5
    return Basis(r, np.linspace(low_V, high_V, n_segments + 1))


@dataclass(frozen=True)
class FitRun:
    """One run as the fit sees it: the rows that count and the groups they fall into, row by row."""

    run: AxisRun
    rows: NDArray[np.uintp]
    groups: NDArray[np.intp]
    weight: float
    """Of a row's square; a run's weights sum to 1 / range^2, so that small records count as much as large
    ones."""
    came_from_V: float | None = None
    """Memory at the start: None is from rest, else the voltage at which the stage last turned round."""
    modes: tuple[Mode, ...] = ()
    """Behind the operator."""

    def position(self) -> Samples:
        return self.run.x_um[self.rows]

    @cached_property
    def _columns(self) -> Columns:
        u = self.run.u_V
        before_V = 0.0 if self.came_from_V is None else float(u[0])
        if self.modes:
            return Columns(u, before_V, self.run.turning_rows, np.arange(len(u), dtype=np.uintp), self.run.x_um)
        return Columns(u, before_V, self.run.turning_rows, self.rows, self.position())

    def fill(self, out: Samples, delay_s: float, play_r_V: Samples, rest_fraction: float, slopes: Slopes) -> None:
        """The columns [segments, plays, 1, position] into ``out`` (rows, s + m + 2)."""
        start = rest_fraction * play_r_V
        if self.came_from_V is not None:
            start = np.clip(start, self.came_from_V - play_r_V, self.came_from_V + play_r_V)
        late_rows = delay_s / self.run.step_s
        if not self.modes:
            self._columns.fill(out, late_rows, slopes, start)
            return
        whole = np.empty((len(self.run.u_V), out.shape[1]))
        self._columns.fill(whole, late_rows, slopes, start)
        out[: len(self.rows), :-2] = behind_modes(whole[:, :-2], self.modes, self.run.step_s)[self.rows]
        out[: len(self.rows), -2:] = whole[self.rows, -2:]

    @cached_property
    def stretches(self) -> list[tuple[int, slice]]:
        """Each group and where its rows are."""
        edges = [*np.flatnonzero(np.diff(self.groups, prepend=-1)).tolist(), len(self.rows)]
        return [(int(self.groups[a]), slice(a, b)) for a, b in pairwise(edges)]


def fit_run(run: AxisRun, most_rows: int, first_group: int, n_groups: int, modes: tuple[Mode, ...] = ()) -> FitRun:
    """Thin the scored rows of ``run`` to about ``most_rows`` and split them into ``n_groups`` stretches of
    time."""
    start, stop, _ = run.scored.indices(len(run.u_V))
    rows = np.arange(start, stop, max(1, (stop - start) // most_rows))
    settled = rows[~_after_jump(run)[rows]]
    if not modes and len(settled) > len(rows) // 2:
        rows = settled
    groups = first_group + np.arange(len(rows)) * n_groups // len(rows)
    weight = 1.0 / (np.ptp(run.x_um[rows]) ** 2 * len(rows))
    return FitRun(run, rows.astype(np.uintp), groups, float(weight), modes=modes)


def _after_jump(run: AxisRun) -> NDArray[np.bool_]:
    flags = np.zeros(len(run.u_V), dtype=np.bool_)
    length = round(min(AFTER_JUMP * period_s(run) / run.step_s, len(flags)))
    for row in jumps(run):
        flags[row : row + length] = True
    return flags


def design(fit: FitRun, basis: Basis, delay_s: float, rest_fraction: float) -> Samples:
    """(rows, segments + plays) in V: what a unit slope of each adds to the position, zero at rest at 0 V."""
    columns = np.empty((len(fit.rows), basis.size + 2))
    fit.fill(columns, delay_s, basis.play_r_V, rest_fraction, basis.resting(rest_fraction))
    return columns[:, :-2]


def linearised(
    fit: FitRun, basis: Basis, delay_s: float, rest_fraction: float, slopes: Samples, step_s: float
) -> Samples:
    """(rows, slopes that are not 0 + 4): a unit of each of those, of the delay, of the rest fraction, 1, position.

    ``step_s`` is the step of the delay over which its column is a difference.
    """
    free = slopes > 0
    at = design(fit, basis, delay_s, rest_fraction)
    columns = np.empty((len(at), int(free.sum()) + 4))
    columns[:, :-4] = at[:, free]
    near = rest_fraction + (0.02 if rest_fraction < 0 else -0.02)
    columns[:, -4] = (design(fit, basis, delay_s + step_s, rest_fraction) - at) @ slopes / step_s
    columns[:, -3] = (design(fit, basis, delay_s, near) - at) @ slopes / (near - rest_fraction)
    columns[:, -2] = 1.0
    columns[:, -1] = fit.position()
    return columns


def delay_step_s(fits: list[FitRun], delay_s: float) -> float:
    """A step of the delay for ``linearised``."""
    return 0.02 * min(f.run.step_s for f in fits) + 0.01 * delay_s


def group_numbers(fits: list[FitRun]) -> list[int]:
    """The groups that still have rows, ascending."""
    return sorted({group for f in fits for group, _ in f.stretches})


def gram(fits: list[FitRun], basis: Basis, delay_s: float, rest_fraction: float) -> Samples:
    """Weighted moments (group, k, k) of the columns [segments, plays, 1, position], k = basis.size + 2."""
    slopes = basis.resting(rest_fraction)
    room = np.empty((max(len(f.rows) for f in fits), basis.size + 2))

    def columns() -> Iterator[Samples]:
        for f in fits:
            f.fill(room, delay_s, basis.play_r_V, rest_fraction, slopes)
            yield room

    return moments_of(fits, columns(), basis.size + 2)


def moments_of(fits: list[FitRun], columns: Iterable[Samples], size: int) -> Samples:
    """Weighted moments (group, size, size) of the ``columns`` (rows, size) of each record."""
    present = group_numbers(fits)
    moments = np.zeros((len(present), size, size))
    at = dict(zip(present, moments, strict=True))
    for f, of_record in zip(fits, columns, strict=True):
        for group, part in f.stretches:
            piece = of_record[part]
            at[group] += f.weight * (piece.T @ piece)
    return moments


def centred(moments: Samples) -> Samples:
    """Moments (..., k, k) after removing the mean of every column, per matrix: the offset is solved for."""
    ones = moments[..., :, -2]
    return np.asarray(moments - ones[..., :, None] * ones[..., None, :] / moments[..., -2, -2, None, None])


def time_view(
    basis: Basis, slopes: Samples, at_rest_um: float, delay_s: float, rest_fraction: float, rate_Hz: float
) -> TimeView:
    """The fitted slopes [segments, plays] as a stage file's time view; plays and dead zones of no weight are
    left out."""
    n = len(basis.knots_V) - 1
    segment, weight = slopes[:n], slopes[n:]
    scale = float(segment.sum() / n + weight.sum())
    keep = weight > 1e-6 * scale
    bends = np.diff(segment)
    knees = np.abs(bends) > 1e-6 * scale
    r, w = basis.play_r_V[keep], weight[keep]
    d, s = basis.knots_V[1:-1][knees], bends[knees]
    rest = float(w @ r * rest_fraction + s @ np.maximum(-d, 0.0))
    return TimeView(
        gain_um_per_V=float(segment[0]),
        play_r_V=tuple(r.tolist()),
        play_w_um_per_V=tuple(w.tolist()),
        deadzone_d_V=tuple(d.tolist()),
        deadzone_s_um_per_V=tuple(s.tolist()),
        offset_um=at_rest_um - rest,
        delay_s=delay_s,
        rest_fraction=rest_fraction,
        u_range_V=(float(basis.knots_V[0]), float(basis.knots_V[-1])),
        rate_Hz=rate_Hz,
    )
