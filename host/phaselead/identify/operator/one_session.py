"""Records of one session: each begins where those before it left the stage, but where something else was driven in
between."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from phaselead.identify.operator.order import Order, same_drive
from phaselead.identify.operator.regressors import FitRun, Turns
from phaselead.identify.operator.starting_memories import (
    OTHER_MEMORY,
    Leaves,
    beyond_drift_um,
    named,
    nearest,
    some_of,
    told_memories,
    turning_points_V,
    ways_alike,
)
from phaselead.identify.runs import TURN_SHARE, AxisRun
from phaselead.record import Samples

IN_ORDER = "each record is taken to begin where the one before it left the stage"
"""What is said of records in the order of a session."""


class Session(NamedTuple):
    """Records with the memories of a session, their order, and the numbers of those before which something else was
    driven."""

    fits: list[FitRun]
    order: Order
    apart: list[int]


def in_one_session(
    fits: Sequence[FitRun], order: Order, judged: Callable[[int, FitRun], FitRun | None] | None = None
) -> Session:
    """The records as if each but the first of a chain had begun where those before it left the stage; those alone as
    they are. ``judged`` may give one another memory, by its number and as it would begin in order; those after it come
    after that."""
    found, apart = list(fits), []
    for chain in order.chains:
        before: Turns = ()
        for last, i in zip((None, *chain), chain, strict=False):
            way_V = _swings(fits[i].run)
            if last is not None and same_drive(fits[last].run, fits[i].run):  # the longer one comes after the shorter
                found[i] = replace(fits[i], turned_V=found[last].turned_V)
                before = driven_on(found[i].turned_V or (), way_V)
                continue
            found[i] = _first(fits[i]) if last is None else _after(before, fits[i], way_V[0])
            other = judged(i, found[i]) if judged else None
            if other is not None:
                found[i] = other
                apart.append(i)
            if other is not None or last is None:
                before = found[i].turned_V or ()
            before = driven_on(before, way_V)
    return Session(found, order, sorted(apart))


def _first(fit: FitRun) -> FitRun:
    """The first record of a chain: from rest where it begins at 0 V, else from wherever it is known to come."""
    return replace(fit, turned_V=None) if fit.run.begins_at_0_V else fit


def _after(before: Turns, fit: FitRun, first_V: float) -> FitRun:
    """The record as it begins after these turns."""
    turned_V = left_behind(before, first_V)
    if turned_V and abs(turned_V[-1] - first_V) < _noise_V(fit.run):
        turned_V = turned_V[:-1]
    return replace(fit, turned_V=turned_V if turned_V or not fit.run.begins_at_0_V else None)


def session_in_part(
    fits: Sequence[FitRun],
    order: Order,
    others: Sequence[FitRun],
    operator: Leaves,
    own_offsets: bool = False,
    *,
    offset_told: bool = False,
) -> Session:
    """The same, but that a record is apart which an ``operator`` explains clearly better with its likeliest memory,
    which ``others`` have. That is what was driven in between, after what the session had left behind where this leaves
    the record as it does by itself. Where half of those in chains or more are apart there is no session, and all are.

    How far its first turn went is often told by the offset alone: it is taken where that is as of the records in order
    before it, unless records have ``own_offsets``. ``offset_told``: the operator tells the one that all have, and
    what is beyond drift counts against a memory.
    """
    means_um: list[float] = []
    points_V, offset_told = turning_points_V(fits), offset_told and not own_offsets

    def judged(i: int, in_order: FitRun) -> FitRun | None:
        e, other = operator.residual(in_order.with_start()), others[i]
        alone = operator.residual(other.with_start())
        if OTHER_MEMORY * _square(e, in_order, offset_told) <= _square(alone, other, offset_told):
            means_um.append(float(e.mean()))
            return None
        ways = ways_alike(other, operator, points_V, lambda turns: driven_on(in_order.turned_V or (), turns))
        if own_offsets or not (offset_told or means_um):
            return ways[0][0]
        return nearest(ways, 0.0 if offset_told else float(np.median(means_um)))[0]

    session = in_one_session(fits, order, judged)
    some = 2 * len(session.apart) < sum(map(len, order.chains))
    return session if some else Session(list(others), order, list(range(len(fits))))


def _square(left_um: Samples, fit: FitRun, offset_told: bool) -> float:
    """Mean square of what is left of a record, of its mean no more than what is beyond drift."""
    return float(np.var(left_um)) + (beyond_drift_um(left_um, fit.run) ** 2 if offset_told else 0.0)


def told_session(session: Session) -> list[str]:
    """What is said of the records of a session; the first of a chain may have begun anywhere."""
    fits, order, apart = session
    if len(apart) == len(fits):
        return told_memories(fits)
    names = [named(fits[i]) for i in apart if i not in order.firsts]
    but = f", but for {some_of(names)}: there something else was driven in between, or the order is another"
    begin = some_of([named(fits[i]) for i in order.firsts])
    found = [f"{IN_ORDER}, {order.known}, beginning with {begin}{but if names else ''}"]
    if order.alone:
        count = f"{len(order.alone)} of {len(fits)} records"
        which = some_of([named(fits[i]) for i in order.alone])
        found.append(f"{count} say no time that is theirs alone; where each began was searched for: {which}")
    return found


def _swings(run: AxisRun) -> list[float]:
    """The voltages between which a record goes, from its first to its last; what turns by little is noise."""
    u, noise_V = run.u_V, _noise_V(run)
    found = [run.first_V]
    for volt in [*u[run.turning_rows].tolist(), float(u[-1])]:
        goes_on = len(found) > 1 and (volt - found[-1]) * (found[-1] - found[-2]) >= 0
        if goes_on:
            found[-1] = volt
        elif abs(volt - found[-1]) > noise_V:
            found.append(volt)
    return found


def _noise_V(run: AxisRun) -> float:
    """A voltage that turns by less has not turned."""
    return TURN_SHARE * float(np.ptp(run.u_V))


def driven_on(turns: Turns, way_V: Sequence[float]) -> Turns:
    """What a stage remembers after these turns that is driven from one voltage to the next, the last one last."""
    for volt in way_V:
        turns = (*left_behind(turns, volt), volt)
    return turns


def left_behind(turns: Turns, to_V: float) -> Turns:
    """Of these turns those that a stage remembers that goes on to this voltage: a swing wipes out all smaller ones. The
    farthest on either side of 0 V stay: how plays rest is not known, and one that rests at an end of its width
    remembers them."""
    while turns:
        last_V, before_V = turns[-1], turns[-2] if len(turns) > 1 else 0.0
        way, way_before = to_V - last_V, last_V - before_V
        if way * way_before >= 0:
            turns = turns[:-1]
        elif len(turns) > 1 and abs(way) >= abs(way_before):
            turns = turns[:-2] if len(turns) > 2 or last_V * before_V >= 0 else (last_V,)
        else:
            break
    return turns
