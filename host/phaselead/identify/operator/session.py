"""What differs from record to record: where each began, and the offset that it has beside the others.

Memories are told by an operator, and the operator goes with the memories and the offsets: one leads to the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.identify.operator.choosing import choose_basis
from phaselead.identify.operator.one_session import in_one_session, session_in_part, told_session
from phaselead.identify.operator.order import Order, orders
from phaselead.identify.operator.records import Records, first_delay_s, known_rest, searched_from, thinned
from phaselead.identify.operator.regressors import FitRun, Turns, fitted_span_V, ringing_s
from phaselead.identify.operator.result import OperatorFit
from phaselead.identify.operator.solution import DRIFT, EXACT, LEAST_OFFSET_WEIGHT, Solution, weight_of_offsets
from phaselead.identify.operator.starting_memories import (
    END_SHARE,
    LIKELY_MEMORY,
    OTHER_MEMORY,
    some_settle,
    told_memories,
    with_alike_offsets,
    with_memories,
)
from phaselead.identify.runs import AxisRun
from phaselead.model import Mode

SEARCH_ROWS = 12_000
"""Of all records, while searching."""
SEARCH = (12, 10)
"""Plays and segments before a size is chosen."""
MEMORY_ROUNDS = 4
"""How often memories are told by the operator that went with those of before: a budget of time."""


Told = tuple[Records, Solution, list[str]]
"""Records with the memories they start from, the operator that goes with these, and what to say of them."""


def from_their_memories(records: Records, modes: tuple[Mode, ...]) -> Told:
    """The records with the memories and offsets that explain them best, the operator then, and what to say of them.

    Offsets tell the memories of a grid of levels, and would bend the loop of a stage that creeps. They count in full
    first and, where that shows that much of what is left is offsets, as little as they may; what leaves less is kept.
    Where the order of a session tells the memories, none are searched.
    """
    first = _of_settled_rows(records, modes)
    in_full = _Telling.of(records, first)
    if some_settle(records.fits) and (in_order := in_full.told_in_order()):
        return _with_offsets_weighed(*in_order)
    told = [in_full.told()]
    judged = [_counted_least(*told[0][:2])]
    if judged[0] ** 2 < LIKELY_MEMORY * told[0][1].error ** 2:
        told.append(_Telling.of(replace(records, offset_weight=LEAST_OFFSET_WEIGHT), first).told())
        judged.append(_counted_least(*told[1][:2]))
    session, found, said = told[int(np.argmin(judged))]
    offsets = _offsets(session.fits, found)
    if max(offsets) > DRIFT:  # a memory may explain it, or another session
        apart, of_apart, also = _Telling.of(replace(records, offset_weight=0.0), first).told()
        if np.median(offsets) > DRIFT or of_apart.error**2 < OTHER_MEMORY * min(judged) ** 2:
            return apart, of_apart, also
    # Settled rows leave much less: other memories may as well, without what makes records differ in offset.
    if first.error**2 < OTHER_MEMORY * min(judged) ** 2:
        alike, of_alike, also = in_full.told_alike()
        if _counted_least(alike, of_alike) ** 2 < OTHER_MEMORY * min(judged) ** 2:
            session, found, said = alike, of_alike, also
    return _with_offsets_weighed(session, found, said)


def _with_offsets_weighed(records: Records, found: Solution, said: list[str]) -> Told:
    """What goes with these memories where offsets count as much as what is left of each record shows."""
    shapes = [float(np.std(found.residual(f))) / f.run.range_um for f in records.fits]
    session = replace(records, offset_weight=weight_of_offsets(_offsets(records.fits, found), shapes))
    return session, searched_from(session, found), said


def _counted_least(records: Records, found: Solution) -> float:
    """The relative error that these memories leave where offsets count least."""
    session = replace(records, offset_weight=LEAST_OFFSET_WEIGHT)
    return session.at(found.basis, found.delay_s, found.rest_fraction, found.modes).error


def _of_settled_rows(records: Records, modes: tuple[Mode, ...]) -> Solution:
    """The operator of the rows that remember nothing of what was before their record but an offset."""
    late = records.settled()
    found = late.searched(late.basis(*SEARCH), first_delay_s(late), 0.0, modes)
    basis, _ = choose_basis(late, found, leave_out_ends=True)
    return late.at(basis, found.delay_s, found.rest_fraction, found.modes)


@dataclass(frozen=True)
class _Telling:
    """What some records tell of their memories, for what offsets count in them.

    Memories are told by an operator and the operator goes with the memories: what a wrong one made of a record is told
    anew by the operator that the others led to.
    """

    records: Records
    first: Solution
    """Of settled rows: basis, modes, and where searches begin."""
    at_rest: Solution
    """Of all records as if from rest: what memories are compared with."""
    of_first: list[FitRun]
    """The records with the memories that settled rows tell."""

    @classmethod
    def of(cls, records: Records, first: Solution) -> _Telling:
        at_rest = records.searched(first.basis, first.delay_s, 0.0, first.modes)
        return cls(records, first, at_rest, _with_likely_memories(records, first))

    def told(self) -> Told:
        """Begun with the memories that three operators tell: of settled rows, of all from rest, and of all after the
        highest voltage, where that is how a session of falling levels began."""
        starts = [self.of_first, _with_likely_memories(self.records, self.at_rest)]
        fallen = _after_top(self.records)
        best: Told = (self.records, self.at_rest, [])
        if any(f.turned_V for f in fallen.fits):
            found = self._searched(fallen)
            if self._leaves_less(fallen, found, self.at_rest):
                best = fallen, found, told_memories(fallen.fits)
                starts.append(_with_likely_memories(self.records, found))
        return self._best_from(starts, best)

    def told_in_order(self) -> Told | None:
        """Each record after those before it, or most of them, in the first order where that leaves less than all from
        rest, clearly less where no clock tells the order, and no other memories can leave much less, by what settled
        rows leave."""
        for order in orders(self.records.runs):
            told, share = self._in_order(order), 1.0 if order.by_clocks else OTHER_MEMORY
            less = told is not None and told[1].error ** 2 < share * self.at_rest.error**2
            if told is not None and less and OTHER_MEMORY * told[1].error ** 2 <= self.first.error**2:
                return told
        return None

    def _in_order(self, order: Order) -> Told | None:
        """The session in this order that leaves least: which records are apart is told by the operator of settled rows,
        and anew by that of the session that this led to. None where an order changes nothing."""
        best: Told | None = None
        records, others, operator = self.records, self.of_first, self.first
        tried: list[list[Turns | None]] = []
        for again in range(MEMORY_ROUNDS):
            before = best
            for session, said in _sessions(records, order, others, operator, offset_told=again > 0):
                memories = [f.turned_V for f in session.fits]
                if memories in tried:
                    continue
                tried.append(memories)
                found = self._searched(session)
                if best is None or found.error < best[1].error:
                    best = session, found, said
            if best is None or best is before:
                break
            records, operator, _ = best
            others = with_memories(self.records.fits, operator, LIKELY_MEMORY, records.own_offsets)[0]
        return best

    def told_alike(self) -> Told:
        """Begun with the memories that settled rows tell, where offsets are most alike."""
        starts = [with_alike_offsets(self.of_first, self.first)]
        return self._best_from(starts, (self.records, self.at_rest, []))

    def _best_from(self, starts: Sequence[list[FitRun]], best: Told) -> Told:
        """What leaves least: the best so far, these memories, or those that the operator of each round tells."""
        tried: list[list[Turns | None]] = []
        for fits in starts:
            for rounds_left in reversed(range(MEMORY_ROUNDS)):
                memories = [f.turned_V for f in fits]
                if memories in tried or not any(turned_V is not None for turned_V in memories):
                    break
                tried.append(memories)
                moved = replace(self.records, fits=fits)
                by_them = self._searched(moved)
                if self._leaves_less(moved, by_them, best[1]):
                    best = moved, by_them, told_memories(fits)
                if rounds_left:
                    fits, _ = with_memories(self.records.fits, by_them, OTHER_MEMORY, self.records.own_offsets)
        return best

    def _searched(self, of: Records) -> Solution:
        return of.searched(self.first.basis, self.first.delay_s, self.first.rest_fraction, self.first.modes)

    def _leaves_less(self, moved: Records, found: Solution, best: Solution) -> bool:
        """Whether memories leave less than the best so far, and clearly less of what has one than all from rest."""
        return found.error < best.error and _tell_better(moved, found, self.at_rest)


def _sessions(
    records: Records, order: Order, others: Sequence[FitRun], operator: Solution, *, offset_told: bool = True
) -> Iterator[tuple[Records, list[str]]]:
    """The records as a session, and what to say of that: all in order; and, where an ``operator`` explains some clearly
    better with their likeliest memories, which ``others`` have, those apart and the rest in order. Without those that
    change nothing. ``offset_told``: whether the operator tells the offset that records have."""
    fits = [others[i] if i in order.alone else f for i, f in enumerate(records.fits)]
    in_part = session_in_part(fits, order, others, operator, records.own_offsets, offset_told=offset_told)
    for session in (in_one_session(fits, order), *([in_part] if in_part.apart else [])):
        if [f.turned_V for f in session.fits] != [f.turned_V for f in records.fits]:
            yield replace(records, fits=session.fits), told_session(session)


def _with_likely_memories(records: Records, found: Solution) -> list[FitRun]:
    """The records with the memories that an operator tells first, whatever their offsets."""
    return with_memories(records.fits, found, LIKELY_MEMORY, own_offsets=True)[0]


def _after_top(records: Records) -> Records:
    """The records as if all that do not show the highest voltage had come from it."""
    tops_V = [float(f.run.u_V.max()) for f in records.fits]
    shown_V = max(tops_V) - END_SHARE * (max(tops_V) - min(float(f.run.u_V.min()) for f in records.fits))
    fits = [replace(f, turned_V=(max(tops_V),)) if top_V < shown_V else f
            for f, top_V in zip(records.fits, tops_V, strict=True)]  # fmt: skip
    return replace(records, fits=fits)


def _tell_better(elsewhere: Records, found: Solution, at_rest: Solution) -> bool:
    """Whether the memories leave clearly less of the records that have one than if all had come from rest."""
    weight = elsewhere.offset_weight
    moved = [fit for fit in elsewhere.fits if fit.turned_V is not None]
    gains = [_square(found, f, weight) / _square(at_rest, replace(f, turned_V=None), weight) for f in moved]
    return float(np.exp(np.mean(np.log(gains)))) < OTHER_MEMORY


def _square(found: Solution, fit: FitRun, offset_weight: float) -> float:
    """Mean square that is left of a record, at least what rounding leaves."""
    e = found.residual(fit)
    return float(np.var(e)) + offset_weight * float(np.mean(e)) ** 2 + (EXACT * fit.run.range_um) ** 2


def _offsets(fits: list[FitRun], solution: Solution) -> list[float]:
    """How far each record sits from most others, as a share of its range."""
    means_um = [float(solution.residual(f).mean()) for f in fits]
    usual_um = float(np.median(means_um))
    return [abs(mean_um - usual_um) / f.run.range_um for mean_um, f in zip(means_um, fits, strict=True)]


def weight_known(known: OperatorFit) -> float:
    """How much offsets count by what a fit left of each record."""
    if known.own_offsets:
        return 0.0
    usual_um = float(np.median([one.mean_um for one in known.records]))
    shapes = [float(np.sqrt(max(one.rms_um**2 - one.mean_um**2, 0.0))) / one.range_um for one in known.records]
    return weight_of_offsets([(one.mean_um - usual_um) / one.range_um for one in known.records], shapes)


def as_known(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> Records:
    """The records with the memories, the weight of offsets, the field and the lag of a fit."""
    memories = [record.turned_V for record in known.records]
    fits = thinned(runs, SEARCH_ROWS, ringing_s=ringing_s(modes), memories=memories)
    view = known.view
    # A bend of the field, and how plays weigh, are told over the voltages of that fit.
    uneven = view.field_bend or view.play_tilt or view.play_taper
    span_V = view.u_range_V if uneven else fitted_span_V(runs, ringing_s(modes))
    records = Records(runs, fits, span_V, weight_known(known))
    return records.in_field(view.field_bend).behind_a_lag(known.lag_s).weighing(view.play_tilt, view.play_taper)


def told_behind_modes(records: Records, found: Solution, known: OperatorFit) -> Told:
    """The memories told anew, since the ringing of fast records hid them from a fit without modes, and what to say of
    all of them.

    Where rows before those that count have settled a record no search tells more; an order may.
    """
    said = list(known.about_memories)
    if not found.modes:
        return records, found, said
    rest, whole = known_rest(found.rest_fraction), len(found.modes) == 1

    def searched(moved: Records) -> Solution:
        return moved.searched(found.basis, found.delay_s, rest, found.modes, whole=whole)

    warmed = [i for i, f in enumerate(records.fits) if f.run.scored.start]

    def told(share: float) -> tuple[list[FitRun], list[str]]:
        return with_memories(records.fits, found, share, records.own_offsets, known=warmed)

    fits, named = told(LIKELY_MEMORY)
    before = records
    for session, of_session in _sessions(before, orders(before.runs)[0], fits, found):
        better = searched(session)
        if better.error < found.error:
            records, found, said = session, better, of_session
    if records is not before:
        fits, named = told(LIKELY_MEMORY)
    for _ in range(MEMORY_ROUNDS):
        better = searched(moved := replace(records, fits=fits))
        if not better.error < found.error:
            break
        records, found, said = moved, better, named
        fits, named = told(OTHER_MEMORY)
    return records, found, said
