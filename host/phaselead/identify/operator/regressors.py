"""Regressors of the operator fit: what each play, fading or not, and each segment of the voltage adds to the position
of a record.

The reversible part of the operator is written as slopes over segments between knots, so that "monotone" is simply "no
slope is negative"; ``time_view`` turns them into a gain and one-sided dead zones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator.column_kernel import BasisInC, RecordInC, Start
from phaselead.identify.runs import AxisRun, jumps, period_s, turning_rows
from phaselead.model import (
    EVEN,
    EVEN_DENSITY,
    NO_WEIGHT,
    EffectiveField,
    Mode,
    PlayDensity,
    TimeView,
    behind_modes,
    modes_in_C,
    relaxed_late,
    state_after,
)
from phaselead.record import Samples

AFTER_JUMP = 0.1
"""Share of a period after a jump in which a model without dynamics is not asked to agree."""
FEWEST_ROWS = 200
"""Of each record, to which a fit thins it, however many records there are."""
FADING = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
"""Of a swing: thresholds of fading plays. The largest has hardly turned when the swing ends."""


@dataclass(frozen=True)
class Basis:
    """Thresholds of the plays (m,), rising, knots between the segments (s + 1,), rising, and thresholds of the fading
    plays (k,), all in V; and how the weight of a play depends on where it stands."""

    play_r_V: Samples
    knots_V: Samples
    fading_r_V: Samples = field(default_factory=lambda: np.zeros(0))
    density: PlayDensity = EVEN_DENSITY

    @property
    def n_segments(self) -> int:
        """How many segments there are; their slopes stand in front of those of the plays."""
        return len(self.knots_V) - 1

    @property
    def size(self) -> int:
        """Segments, plays and fading plays."""
        return self.n_segments + self.n_plays + len(self.fading_r_V)

    @property
    def n_plays(self) -> int:
        """How many plays there are that do not fade; their slopes stand in front of those that do."""
        return len(self.play_r_V)

    def equals(self, other: Basis) -> bool:
        """Whether both have the same plays and segments."""
        return self.density == other.density and all(map(np.array_equal, self._thresholds(), other._thresholds()))

    def _thresholds(self) -> tuple[Samples, Samples, Samples]:
        return self.play_r_V, self.knots_V, self.fading_r_V

    @cached_property
    def _segments(self) -> tuple[Samples, Samples, Samples]:
        """Ends of every segment, and where 0 V stands in it; the end segments go on."""
        low, high = self.knots_V[:-1].copy(), self.knots_V[1:].copy()
        low[0], high[-1] = -np.inf, np.inf
        return low, high, np.clip(0.0, low, high)

    def in_C(self, rest_fraction: float) -> BasisInC:
        """For ``FitRun.fill``; its columns are 0 at rest at 0 V."""
        of_plays = self.play_r_V, self.density.read(rest_fraction * self.play_r_V)
        return BasisInC(self._segments, of_plays, self.density, (self.fading_r_V, rest_fraction * self.fading_r_V))


def play_thresholds(swing_V: float, count: int) -> Samples:
    """Thresholds (count,) in V, rising to half of ``swing_V`` and denser where they are small.

    The steady loop of a swing never moves a play whose threshold is beyond half of it.
    """
    return np.asarray(swing_V / 2 * (np.arange(1, count + 1) / max(count, 1)) ** 1.5)


def nested_basis(
    swing_V: float,
    low_V: float,
    high_V: float,
    n_plays: int,
    n_segments: int,
    *,
    fading: bool = False,
    density: PlayDensity = EVEN_DENSITY,
) -> Basis:
    """``play_thresholds``, equal segments from low to high, and fading plays if these are asked for."""
    fading_r_V = np.array(FADING if fading else ()) * swing_V
    return Basis(play_thresholds(swing_V, n_plays), np.linspace(low_V, high_V, n_segments + 1), fading_r_V, density)


Turns = tuple[float, ...]
"""Voltages at which a stage turned round after it left rest at 0 V, the last one last; () went straight."""


@dataclass(frozen=True)
class FitRun:
    """One run as the fit sees it: the rows that count, and the group of each for leaving out."""

    run: AxisRun
    rows: NDArray[np.uintp]
    groups: NDArray[np.intp]
    weight: float
    """Of a row's square; the weights of a run sum to 1 / range^2, so that small records count as much as large ones."""
    turned_V: Turns | None = None
    """Memory at the start: None is from rest, by a step in the first row; else it stood there, after these turns."""
    lag_s: float = 0.0
    """Time constant of a low-pass in front of the operator."""
    field: EffectiveField = EVEN
    """That the operator answers to."""

    def with_start(self) -> FitRun:
        """The same with rows from the first that is scored on, as dense as the others: how a record begins tells most
        of where the stage came from, though it may ring there from before."""
        first, stride = self.run.scored.indices(len(self.run.u_V))[0], max(1, int(np.median(np.diff(self.rows))))
        start = np.arange(first, self.rows[0], stride).astype(np.uintp)
        groups = np.concatenate([np.full(len(start), self.groups[0]), self.groups])
        return replace(self, rows=np.concatenate([start, self.rows]), groups=groups)

    @cached_property
    def of_every_row(self) -> FitRun:
        """The same, but that all rows of the record count."""
        rows = np.arange(len(self.run.u_V), dtype=np.uintp)
        return replace(self, rows=rows, groups=np.zeros(len(rows), dtype=np.intp))

    def position(self) -> Samples:
        """Measured (rows,) in um."""
        return self.run.x_um[self.rows]

    @cached_property
    def _before_V(self) -> float:
        return 0.0 if self.turned_V is None else float(self.run.u_V[0])

    @cached_property
    def _record(self) -> RecordInC:
        """A field turns where its voltage does."""
        driven_V, before_V = self.field.of(self.run.u_V), self.field.at(self._before_V)
        return RecordInC(driven_V, before_V, self.run.turning_rows, self.rows, self.position())

    def fill(
        self,
        out: Samples,
        delay_s: float,
        basis: Basis,
        rest_fraction: float,
        in_C: BasisInC,
        modes: tuple[Mode, ...] = (),
    ) -> None:
        """Write the columns [segments, plays, fading plays, 1, position] into ``out`` (rows, basis.size + 2), in V and
        um, behind the ``modes``. Raises ValueError for a negative delay."""
        if not modes or in_C.goes_or_stands:
            carried = modes_in_C(modes, self.run.step_s) if modes else None
            self._fill(out, self._record, delay_s, in_C, self._start(basis, rest_fraction), carried)
            return
        still = np.empty((len(self.run.u_V), basis.size + 2))
        self.of_every_row.fill(still, delay_s, basis, rest_fraction, in_C)
        out[: len(self.rows)] = behind_modes(still, modes, self.run.step_s)[self.rows]  # all of it: a part is a copy
        out[: len(self.rows), -1] = self.position()

    def _fill(
        self,
        out: Samples,
        record: RecordInC,
        delay_s: float,
        basis: BasisInC,
        start: Start,
        modes: Samples | None = None,
    ) -> None:
        """Delay and low-pass go together: the way of a lag is curved between rows."""
        if not self.lag_s:
            record.fill(out, delay_s / self.run.step_s, basis, start, modes)
            return
        u_V = np.concatenate([[self._before_V], self.run.u_V])
        late_V = relaxed_late(u_V, [self.lag_s], self.run.step_s, delay_s)[1:]
        record.with_voltage(self.field.of(late_V), turning_rows(late_V)).fill(out, 0.0, basis, start, modes)

    def _start(self, basis: Basis, rest_fraction: float) -> Start:
        plays_V, fading = rest_fraction * basis.play_r_V, np.full(len(basis.fading_r_V), -rest_fraction)
        if self.turned_V is not None:
            turned_V = [*map(self.field.at, self.turned_V)]
            for turn_V in turned_V:
                plays_V = np.clip(plays_V, turn_V - basis.play_r_V, turn_V + basis.play_r_V)
            fading = state_after([0.0, *turned_V, self.field.at(self._before_V)], basis.fading_r_V, fading)
        return Start(plays_V, fading)

    @cached_property
    def stretches(self) -> list[tuple[int, slice]]:
        """Each group and where its rows are."""
        edges = [*np.flatnonzero(np.diff(self.groups, prepend=-1)).tolist(), len(self.rows)]
        return [(int(self.groups[a]), slice(a, b)) for a, b in pairwise(edges)]


def ringing_s(modes: tuple[Mode, ...]) -> float:
    """How long the modes ring, down to a hundredth."""
    return max((np.log(100) / (2 * np.pi * f_Hz * zeta) for _, f_Hz, zeta in modes), default=0.0)


def rows_to_fit(run: AxisRun, most_rows: int, first_group: int, n_groups: int, *, ringing_s: float = 0.0) -> FitRun:
    """Thin the rows of ``run`` that count to about ``most_rows``, in ``n_groups`` stretches of time."""
    start, stop, _ = run.scored.indices(len(run.u_V))
    rows = np.arange(start, stop, max(1, (stop - start) // most_rows))
    counted = rows[rows_that_count(run, ringing_s)[rows]]
    if len(counted) > len(rows) // 2:  # of quick jumps thinning may keep those rows alone that do not count
        rows = counted
    groups = first_group + np.arange(len(rows)) * n_groups // len(rows)
    weight = 1.0 / (np.ptp(run.x_um[rows]) ** 2 * len(rows))
    return FitRun(run, rows.astype(np.uintp), groups, float(weight))


def rows_that_count(run: AxisRun, ringing_s: float) -> NDArray[np.bool_]:
    """Which rows (n,) of a run are fitted: the scored ones, but those just after a jump, unless most are or the model
    has modes that tell how the stage rings there (for ``ringing_s``). They do not tell how it rang before the record:
    where that does not begin at 0 V, its start is left out."""
    scored = np.zeros(len(run.u_V), dtype=np.bool_)
    scored[run.scored] = True
    if not ringing_s:
        calm = scored & ~_after_jump(run)
    else:
        calm = scored if run.begins_at_0_V else scored & (np.arange(len(scored)) >= round(ringing_s / run.step_s))
    return calm if calm.sum() > scored.sum() // 2 else scored


def fitted_span_V(runs: Sequence[AxisRun], ringing_s: float = 0.0) -> tuple[float, float]:
    """The lowest and the highest voltage of the rows that count."""
    each = [run.u_V[rows_that_count(run, ringing_s)] for run in runs]
    return min(float(u.min()) for u in each), max(float(u.max()) for u in each)


def _after_jump(run: AxisRun) -> NDArray[np.bool_]:
    flags = np.zeros(len(run.u_V), dtype=np.bool_)
    length = round(min(AFTER_JUMP * period_s(run) / run.step_s, len(flags)))
    for row in jumps(run):
        flags[row : row + length] = True
    return flags


def design_matrix(
    fit: FitRun, basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = ()
) -> Samples:
    """(rows, basis.size) in V: what a unit slope of each adds to the position, 0 at rest at 0 V."""
    columns = np.empty((len(fit.rows), basis.size + 2))
    fit.fill(columns, delay_s, basis, rest_fraction, basis.in_C(rest_fraction), modes)
    return columns[:, :-2]


def time_view(
    basis: Basis, slopes: Samples, at_rest_um: float, delay_s: float, rest_fraction: float, rate_Hz: float
) -> TimeView:
    """The time view of slopes [segments, plays, fading plays] (s + m + k,) in um/V; plays and dead zones of no weight
    are left out, and of the fading plays it has the gain alone: their lag is an effect beside it."""
    n, m = basis.n_segments, basis.n_plays
    segment, weight, fading = slopes[:n], slopes[n : n + m], slopes[n + m :]
    keep, bent = with_weight(basis, slopes)
    bends = np.diff(segment)
    r, w = basis.play_r_V[keep], weight[keep]
    d, s = basis.knots_V[1:-1][bent], bends[bent]
    rest = float(w @ basis.density.read(rest_fraction * r) + s @ np.maximum(-d, 0.0))
    return TimeView(
        gain_um_per_V=float(segment[0] + fading.sum()),
        play_r_V=tuple(r.tolist()),
        play_w_um_per_V=tuple(w.tolist()),
        deadzone_d_V=tuple(d.tolist()),
        deadzone_s_um_per_V=tuple(s.tolist()),
        offset_um=at_rest_um - rest,
        delay_s=delay_s,
        rest_fraction=rest_fraction,
        play_tilt=basis.density.tilt,
        play_taper=basis.density.taper,
        u_range_V=(float(basis.knots_V[0]), float(basis.knots_V[-1])),
        rate_Hz=rate_Hz,
    )


def without_idle_plays(basis: Basis, slopes: Samples) -> tuple[Basis, Samples]:
    """The basis without the plays, fading or not, whose slope is exactly 0, and the slopes of what it has: the same
    answer, in less time."""
    n, m = basis.n_segments, basis.n_plays
    plays, fading = slopes[n : n + m] > 0, slopes[n + m :] > 0
    kept = np.concatenate([np.ones(n, dtype=np.bool_), plays, fading])
    return replace(basis, play_r_V=basis.play_r_V[plays], fading_r_V=basis.fading_r_V[fading]), slopes[kept]


def with_weight(basis: Basis, slopes: Samples) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which plays (m,) and which bends between segments (s - 1,) a time view keeps: those of weight, and all plays
    beside fading ones, whose states at the start of a record are told by where the plays stand."""
    n, m = basis.n_segments, basis.n_plays
    least = NO_WEIGHT * float(slopes[:n].sum() / n + slopes[n:].sum())
    kept = np.full(m, bool(slopes[n + m :].any())) | (slopes[n : n + m] > least)
    return kept, np.abs(np.diff(slopes[:n])) > least
