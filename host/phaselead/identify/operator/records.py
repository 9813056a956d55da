"""Records of one axis as every fit of the operator takes them: thinned, with what is the same for a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phaselead.identify.operator.leaving_out import FOLD_BLOCKS
from phaselead.identify.operator.regressors import FEWEST_ROWS, Basis, FitRun, Turns, nested_basis, rows_to_fit
from phaselead.identify.operator.solution import REST_STEP, Solution, best_operator, best_slopes
from phaselead.identify.operator.starting_memories import settled_of
from phaselead.identify.runs import AxisRun, longest_delay_s, period_s
from phaselead.model import LONGEST_DELAY_S, EffectiveField, Mode, PlayDensity

LONGEST_DELAY = 0.1
"""Of a period."""
FIRST_DELAY = 0.02
"""Of the longest delay: where the search starts."""


@dataclass(frozen=True)
class Records:
    """The records of one axis, thinned, and how much counts what their offsets differ by: 0 where each has its own."""

    runs: Sequence[AxisRun]
    fits: list[FitRun]
    span_V: tuple[float, float]
    """The lowest and the highest voltage that the operator is fitted to: not that of rows which are left out."""
    offset_weight: float = 1.0
    lag_s: float = 0.0
    """Of the measured response, where that is known: the delay may be twice as long, however short the periods."""
    tilt: float = 0.0
    taper: float = 0.0
    """How much more plays weigh at the top of these voltages, and how much less at both ends."""
    beside_fading: bool = False
    """Whether plays stand beside fading ones, in every basis that does not say so itself: only while it is searched how
    uneven the operator is."""

    def behind_a_lag(self, lag_s: float) -> Records:
        """The same with a low-pass of this time constant in front of the operator."""
        return replace(self, fits=[replace(f, lag_s=lag_s) for f in self.fits])

    @property
    def field(self) -> EffectiveField:
        """That the operator answers to."""
        return self.fits[0].field

    def in_field(self, bend: float) -> Records:
        """The same where the field over the voltages that it is fitted to bends."""
        field = EffectiveField(bend, self.span_V)
        return replace(self, fits=[replace(f, field=field) for f in self.fits])

    def weighing(self, tilt: float, taper: float) -> Records:
        """The same where the weight of plays depends so on the level."""
        return replace(self, tilt=tilt, taper=taper)

    @property
    def own_offsets(self) -> bool:
        """Whether each has an offset of its own."""
        return self.offset_weight == 0

    def settled(self) -> Records:
        """The rows that remember nothing of what was before their record but an offset, which each then has."""
        return replace(self, fits=settled_of(self.fits), offset_weight=0.0)

    @cached_property
    def longest_delay_s(self) -> float:
        of_periods = min(LONGEST_DELAY * period_s(r) for r in self.runs)
        return min(max(of_periods, 2 * self.lag_s), *(longest_delay_s(r) for r in self.runs), LONGEST_DELAY_S)

    def basis(self, n_plays: int, n_segments: int, *, fading: bool | None = None) -> Basis:
        low, high = map(self.field.at, self.span_V)
        swing = max(float(np.ptp(self.field.of(r.u_V[r.scored]))) for r in self.runs)
        density = PlayDensity(self.tilt, self.taper, (low, high))
        fading = self.beside_fading if fading is None else fading
        return nested_basis(swing, low, high, n_plays, n_segments, fading=fading, density=density)

    def at(self, basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = ()) -> Solution:
        return best_slopes(self.fits, basis, delay_s, rest_fraction, self.offset_weight, modes)

    def searched(
        self, basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = (), *, whole: bool = False
    ) -> Solution:
        """The best operator of a basis and the best modes behind it, from there on."""
        start = (delay_s, rest_fraction)
        return best_operator(self.fits, basis, self.longest_delay_s, self.offset_weight, start, modes, whole=whole)


def thinned(
    runs: Sequence[AxisRun],
    most_rows: int,
    *,
    ringing_s: float = 0.0,
    memories: Sequence[Turns | None] | None = None,
) -> list[FitRun]:
    each = max(FEWEST_ROWS, most_rows // len(runs))
    blocks = 1 if len(runs) >= FOLD_BLOCKS else -(-FOLD_BLOCKS // len(runs))
    fits = [rows_to_fit(run, each, i * blocks, blocks, ringing_s=ringing_s) for i, run in enumerate(runs)]
    return fits if memories is None else [replace(f, turned_V=v) for f, v in zip(fits, memories, strict=True)]


def known_rest(rest_fraction: float) -> float:
    """Where a search goes on from: a start at 0 would stand for a memory that nobody knows, and have a grid tried."""
    return rest_fraction or REST_STEP / 2


def first_delay_s(records: Records) -> float:
    return min(max(FIRST_DELAY * records.longest_delay_s, records.lag_s), records.longest_delay_s)


def searched_from(records: Records, start: Solution) -> Solution:
    """The best operator and modes from there on; a single mode that carries all of the motion goes on to do so."""
    whole = [c for c, _, _ in start.modes] == [1.0]
    return records.searched(start.basis, start.delay_s, known_rest(start.rest_fraction), start.modes, whole=whole)
