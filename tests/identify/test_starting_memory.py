"""Where the memory of each record starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from bench_stage import Array, record, rising_sine
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.identify.operator.one_session import (
    in_one_session,
    left_behind,
    session_in_part,
    told_session,
)
from phaselead.identify.operator.order import Order, orders
from phaselead.identify.operator.regressors import FitRun, Turns, rows_to_fit
from phaselead.identify.operator.starting_memories import (
    settled_of,
    starting_memory,
    way_before,
    with_memories,
)
from phaselead.identify.runs import axis_run
from phaselead.model import plays
from phaselead.record import Began
from phaselead.record.recording import Recording


def fitted(recording: Recording) -> FitRun:
    return rows_to_fit(axis_run(recording, "x"), 10_000, 0, 1)


def rising(swing_V: float = 5.0) -> Recording:
    t, u = rising_sine(swing_V, 2, 3, 500)
    return record(t, u, 10 * u)


def test_settled_begins_at_the_first_top():
    """From there on no play that still moves remembers the start."""
    fit = fitted(rising())
    assert len(fit.rows) == 750
    (late,) = settled_of([fit])
    assert 115 <= late.rows[0] <= 125
    assert late.rows[-1] == 749


def test_rows_before_a_window_settle_it():
    whole = rising()
    windowed = Recording(whole.t_s, whole.axes, slice(250, None), "windowed")
    assert len(settled_of([fitted(windowed)])[0].rows) == 500


def growing() -> Recording:
    """Never settled: it reaches the end of its voltage with its last rows."""
    t = np.arange(1000) / 500
    u = t * (1 - np.cos(2 * np.pi * 4 * t))
    return record(t, u, 10 * u)


def test_records_of_which_none_is_ever_settled_are_used_whole():
    fits = [fitted(growing()), fitted(growing())]
    assert [len(late.rows) for late in settled_of(fits)] == [1000, 1000]


def test_beside_settled_records_one_that_never_is_does_not_draw_the_operator():
    """It stands with its last rows, which tell its offset."""
    late, unsettled = settled_of([fitted(rising()), fitted(growing())])
    assert len(late.rows) > 600
    assert 20 <= len(unsettled.rows) < 100
    assert unsettled.rows[-1] == 999


FIRST_V = 5.0
WAVE = np.cos(np.arange(750.0))


def explained(
    from_V: float, offset_um: float = 0.0, wave: float = 0.0, own_offsets: bool = False
) -> tuple[Turns | None, list[str]]:
    """What the second of two records is said to come from, when that explains ``offset_um`` and ``wave`` of it."""
    fits = [fitted(rising(10.0)), fitted(rising(5.0))]

    class Operator:
        def residual(self, fit: FitRun) -> Array:
            known = fit.run is fits[0].run or max(fit.turned_V or (0.0,)) >= from_V
            return 0.1 * WAVE if known else (0.1 + wave) * WAVE + offset_um

        def residuals_of(self, fit: FitRun) -> Callable[[Turns], Array]:
            return lambda turned_V: self.residual(replace(fit, turned_V=turned_V))

    (first, second), messages = with_memories(fits, Operator(), 0.6, own_offsets)
    assert first.turned_V is None
    return second.turned_V, messages


def test_the_nearest_turning_point_that_explains_a_record_is_taken():
    said = (
        "1 of 2 records do not start from rest; where each began was searched for, record by record: "
        "made (from about 5 V)"
    )
    assert explained(4.9, wave=1.0) == ((5.0,), [said])


def test_what_rest_explains_stays_at_rest():
    assert explained(99.0, wave=1.0) == (None, [])
    assert explained(4.9, wave=0.01) == (None, [])


def test_a_small_offset_is_creep_and_a_large_one_is_memory():
    """The record spans 50 um; creep is some tenths of a per cent of it."""
    assert explained(4.9, offset_um=0.4)[0] is None
    assert explained(4.9, offset_um=4.0)[0] == (5.0,)
    assert explained(4.9, offset_um=4.0, own_offsets=True)[0] is None


def test_a_single_record_defines_rest():
    fits, messages = with_memories([fitted(rising())], None, 0.6, False)
    assert fits[0].turned_V is None
    assert messages == []


SQUARES = {None: 10.0, (-3.0,): 9.0, (1.0,): 5.2, (4.0,): 5.0, (7.0,): 5.0}


@pytest.mark.parametrize(("share", "found"), [(0.6, (4.0,)), (0.5, None)])
def test_the_start_that_leaves_least(share, found):
    """Rest leaves 10; a turning point is believed below that times the share."""
    assert starting_memory(SQUARES.__getitem__, [-3.0, 1.0, 4.0, 7.0], share) == found


def test_without_a_turning_point_to_try_a_record_starts_from_rest():
    assert starting_memory(lambda _: 1.0, [], 0.8) is None


TURNS = st.lists(st.floats(0.0, 10.0), max_size=4).map(tuple)


@given(TURNS)
@settings(deadline=None, max_examples=50)
def test_the_way_before_a_record_leaves_no_play_where_it_was_not(turned_V):
    """Whatever way a stage went before a record, the plays that the way found leaves are where it left them, to a small
    part of what rest does. What may be lost is a turn within a quarter of the grid of where the record begins, and the
    third of three turns of which two explain hardly more than one: (8, 0, 6) is found as one turn, with 16 % left."""
    r = np.linspace(0.1, 4.0, 40)

    def plays_V(turns: Turns | None) -> Array:
        at_V = np.zeros(40)
        for volt in (*(turns or ()), FIRST_V):
            at_V = np.clip(at_V, volt - r, volt + r)
        return at_V

    def squares(turns: Turns | None) -> float:
        return float(np.mean((plays_V(turns) - plays_V(turned_V)) ** 2)) + 1e-4

    found = way_before(squares, np.linspace(0.0, 10.0, 13).tolist(), FIRST_V, 0.6)
    assert squares(found) < max(0.3 * squares(None), 0.05)


def test_a_loop_through_both_ends_is_found_though_neither_end_alone_explains_much():
    """One turn near where the record begins leaves less than a turn at either end, ten of the grid do: the loop that
    leaves nothing is tried all the same."""
    few = {(10.0, 0.0): 1e-3, (0.0,): 9.0, (10.0,): 9.0}

    def squares(turns: Turns | None) -> float:
        if turns is None or not turns:
            return 8.0
        return few.get(turns, 4.0 + 0.1 * len(turns) + 0.01 * abs(turns[-1] - FIRST_V))

    assert way_before(squares, np.linspace(0.0, 10.0, 25).tolist(), FIRST_V, 0.6) == (10.0, 0.0)


R_V = np.linspace(0.1, 25, 60)


def went(turns: Turns, to_V: float, rest: float) -> Array:
    """Where plays are that went from rest, at this part of their width, through all of these voltages."""
    at_V = rest * R_V
    for volt in (*turns, to_V):
        at_V = np.clip(at_V, volt - R_V, volt + R_V)
    return at_V


@given(st.lists(st.floats(-10, 10), max_size=12), st.floats(-10, 10), st.floats(-1, 1))
@settings(max_examples=500)
def test_what_is_left_behind_leaves_plays_where_all_of_the_way_did(way_V, to_V, rest):
    turns: Turns = ()
    for volt in way_V:
        turns = (*left_behind(turns, volt), volt)
    kept = left_behind(turns, to_V)
    assert set(kept) <= set(way_V)
    assert went(kept, to_V, rest) == pytest.approx(went(tuple(way_V), to_V, rest))


def through(*volts: float, noise_V: float = 0.0, began: Began | None = None) -> FitRun:
    """A record that goes straight from each of these voltages to the next."""
    u = np.concatenate([np.linspace(a, b, 50, endpoint=False) for a, b in pairwise(volts)] + [volts[-1:]])
    u = u + np.random.default_rng(0).normal(0, noise_V, len(u))
    fit = fitted(record(np.arange(len(u)) / 500, u, 10 * u))
    return replace(fit, run=replace(fit.run, began=began))


def began(*records: FitRun) -> list[Turns | None]:
    """Where each had turned round before, in the order of a session."""
    return [fit.turned_V for fit in in_one_session(records, orders([fit.run for fit in records])[0]).fits]


AS_GIVEN = (
    "each record is taken to begin where the one before it left the stage, in the order in which they are given, "
    "beginning with "
)


def as_given(records: list[FitRun]) -> Order:
    return Order((tuple(range(len(records))),), (), "in the order in which they are given", False)


def test_records_of_one_session_begin_where_those_before_left_the_stage():
    """Nothing is remembered after the first 5 V but these: 2 V is less, and 7 V wipes them out."""
    every = [through(0, volt, 0, volt, 0) for volt in (5, 2, 7, 1)]
    assert began(*every) == [None, (5,), (5,), (7,)]


def test_all_swings_that_get_smaller_are_remembered_however_many():
    every = [through(0, v, -v, v, -v, 0) for v in (5.0, 3.0, 1.5, 0.7)]
    assert began(*every)[1:] == [(5, -5), (5, -5, 3, -3), (5, -5, 3, -3, 1.5, -1.5)]


def test_a_record_may_go_on_from_where_the_last_one_ended():
    """The second goes on from 5 V; the third has turned round at 6 V."""
    assert began(through(0, 5), through(5, 6, 5), through(5, 4, 5)) == [None, (), (6,)]


def test_the_voltage_with_which_a_record_begins_may_be_where_the_stage_turned():
    """To 10 V and back to 4 V, where the second begins."""
    assert began(through(0, 10), through(4, 7, 5), through(5, 6, 5)) == [None, (10,), (10, 4, 7)]


IN_BETWEEN = (10.0, 0.0, 9.0, 1.0, 8.0, 2.0)
"""Where the third of ``WITH_A_GAP`` had turned: something went to 8 V and back to 2 V before it."""
WITH_A_GAP = [(0, 10, 0, 9), (9, 1, 5), (5, 7, 3, 5), (5, 6, 4, 5), (5, 8.5, 5), (5, 6, 5)]
REST = 0.3


class Exactly:
    """Leaves what a stage of a few plays leaves that came a known way, or that of others before a record."""

    def __init__(self, ways: dict[str, Turns]) -> None:
        self.ways = ways

    def _at(self, fit: FitRun, turned_V: Turns | None) -> np.ndarray:
        at_V, _ = plays(fit.run.u_V, R_V, went(turned_V or (), fit.run.first_V, REST))
        return np.asarray(at_V[fit.rows].sum(axis=1))

    def residual(self, fit: FitRun) -> np.ndarray:
        return self._at(fit, self.ways[fit.run.source]) - self._at(fit, fit.turned_V)

    def residuals_of(self, fit: FitRun):
        return lambda turned_V: self.residual(replace(fit, turned_V=turned_V))


def named_apart(*others: Turns | None, **more) -> tuple[list[Turns | None], list[int]]:
    """The memories that ``session_in_part`` tells of ``WITH_A_GAP``, and the numbers of those apart."""
    every = [named_so(i, through(*volts)) for i, volts in enumerate(WITH_A_GAP)]
    ways = [(), (10.0, 0.0), IN_BETWEEN, (*IN_BETWEEN, 7.0, 3.0), (*IN_BETWEEN, 7.0, 3.0, 6.0, 4.0),
            (10.0, 0.0, 9.0, 1.0, 8.5)]  # fmt: skip
    told = [replace(fit, turned_V=other) for fit, other in zip(every, others, strict=True)]
    found = session_in_part(every, as_given(every), told, Exactly({f"{i}": way for i, way in enumerate(ways)}), **more)
    return [fit.turned_V for fit in found.fits], found.apart


def named_so(number: int, fit: FitRun) -> FitRun:
    return replace(fit, run=replace(fit.run, source=f"{number}"))


OTHERS = [None, (10.0,), (8.0, 2.0), (7.0, 3.0), (6.0, 4.0), (8.5,)]


@pytest.mark.parametrize("own_offsets", [False, True])
@pytest.mark.parametrize("likeliest", [IN_BETWEEN, (8.0, 2.0)])
def test_what_was_driven_before_one_record_is_in_the_memory_of_those_after(likeliest, own_offsets):
    found, apart = named_apart(*OTHERS[:2], likeliest, *OTHERS[3:], own_offsets=own_offsets)
    assert apart == [2]
    assert found[:3] == [None, (10, 0), IN_BETWEEN]
    assert found[3:] == [(*IN_BETWEEN, 7, 3), (*IN_BETWEEN, 7, 3, 6, 4), (10, 0, 9, 1, 8.5)]


def test_the_offset_tells_how_far_the_first_turn_in_between_went():
    """To within the grid of turns that are tried: 9.5 V would have wiped out what was before."""
    found, apart = named_apart(*OTHERS[:2], (9.5, 2.0), *OTHERS[3:])
    assert apart == [2]
    assert found[3] == pytest.approx((*IN_BETWEEN, 7, 3), abs=0.7)


class Leaving:
    """Leaves so much of a record's shape, and so much on average, in um, by what it remembers."""

    def __init__(self, left: dict[Turns | None, tuple[float, float]]) -> None:
        self.left = left

    def residual(self, fit: FitRun) -> np.ndarray:
        return self.residuals_of(fit)(fit.turned_V)

    def residuals_of(self, fit: FitRun):
        sides = np.resize([1.0, -1.0], len(fit.rows) // 2 * 2)
        return lambda turned_V: self.left.get(turned_V, (0.0, 0.0))[0] * sides + self.left.get(turned_V, (0.0, 0.0))[1]


@pytest.mark.parametrize(("offset_told", "own_offsets"), [(False, False), (True, False), (True, True)])
def test_a_memory_that_puts_a_record_far_off_is_not_believed_where_the_offset_is_told(offset_told, own_offsets):
    """Its rows alone are explained clearly better than in order. Where each has an offset of its own none is told."""
    every = [through(0, volt, 0) for volt in (5, 4, 3)]
    others = [every[0], replace(every[1], turned_V=(9.0,)), replace(every[2], turned_V=(5.0,))]
    operator = Leaving({(5.0,): (0.3, 0.0), (9.0,): (0.1, -5.0)})
    found = session_in_part(every, as_given(every), others, operator, own_offsets, offset_told=offset_told)
    assert found.apart == ([] if offset_told and not own_offsets else [1])


def test_the_first_record_has_a_past_that_those_after_it_have_as_well():
    first = replace(through(4, 7, 5), turned_V=(10.0,))
    assert began(first, through(5, 6, 5.5)) == [(10,), (10, 4, 7)]


def test_another_memory_is_that_of_those_after():
    three = [through(0, 5), through(5, 6, 5), through(5, 4, 5)]
    found = in_one_session(three, as_given(three), lambda i, one: replace(one, turned_V=(9.0, 1.0)) if i == 1 else None)
    assert found.apart == [1]
    assert [fit.turned_V for fit in found.fits] == [None, (9, 1), (9, 1, 6)]


def test_where_half_are_apart_there_is_no_session():
    both = [named_so(0, through(0, 5, 0)), named_so(1, through(0, 3, 0))]
    others = [both[0], replace(both[1], turned_V=(9.0,))]
    found = session_in_part(both, as_given(both), others, Exactly({"0": (), "1": (9.0,)}))
    assert found.apart == [0, 1]
    assert [fit.turned_V for fit in found.fits] == [None, (9,)]
    assert not told_session(found)[0].startswith(AS_GIVEN)


def test_the_first_record_may_have_begun_anywhere():
    three = [through(5, 6, 4.9), through(4.9, 6.5, 4.8), through(4.8, 6.2, 4.7)]
    found = in_one_session(three, as_given(three), lambda i, one: None if i else replace(one, turned_V=(9.0, 1.0)))
    assert found.apart == [0]
    assert told_session(found) == [f"{AS_GIVEN}made (from about 9 V and then 1 V)"]


def test_noise_of_a_voltage_is_no_turn():
    turned_V = began(*(through(0, volt, 0, volt, 0, noise_V=0.005) for volt in (10, 6, 3)))
    assert [len(turns or ()) for turns in turned_V] == [0, 1, 1]
    assert [turns[0] for turns in turned_V if turns] == pytest.approx([10, 10], abs=0.02)


@pytest.mark.parametrize("unix", [True, False])
def test_records_that_say_when_they_were_taken_may_be_given_in_any_order(unix):
    first, second, third = (
        through(0, volt, 0, began=Began(t, unix=unix)) for volt, t in ((5, 10.0), (7, 20.0), (2, 30.0))
    )
    assert began(third, first, second) == [(7,), None, (5,)]


def taken_at(fit: FitRun, at_s: float | None, session: str | None = None, *, unix: bool = False) -> FitRun:
    """The record as it says when it began."""
    return replace(fit, run=replace(fit.run, began=None if at_s is None else Began(at_s, unix, session)))


def numbers(*records: FitRun) -> list[tuple[tuple[tuple[int, ...], ...], tuple[int, ...]]]:
    """Chains and those alone, of each order that the records may have."""
    return [(order.chains, order.alone) for order in orders([fit.run for fit in records])]


TO = [through(0, volt, 0) for volt in (5, 7, 2, 6, 1)]


def test_a_device_that_counts_from_0_in_each_session_starts_from_rest_in_each():
    """The sessions share times, and stand in the order in which they are given first."""
    times = [(20.0, "b"), (10.0, "b"), (10.0, "a"), (0.0, "a"), (0.0, "b")]
    every = [taken_at(fit, *time) for fit, time in zip(TO, times, strict=True)]
    assert numbers(*every) == [(((4, 1, 0), (3, 2)), ()), (((0, 1, 2, 3, 4),), ())]
    assert began(*every) == [(7,), (1,), (6,), None, None]


@pytest.mark.parametrize("wrong_s", [None, 10.0])
def test_a_record_without_a_time_of_its_own_stands_alone(wrong_s):
    """So does that whose time it claims; the others stay in order."""
    every = [taken_at(fit, at_s, "a") for fit, at_s in zip(TO, (40.0, 30.0, 20.0, 10.0, 0.0), strict=True)]
    every[1] = taken_at(every[1], wrong_s, "a")
    alone = (1,) if wrong_s is None else (1, 3)
    chain = tuple(i for i in (4, 3, 2, 1, 0) if i not in alone)
    assert numbers(*every)[1] == ((chain,), alone)
    said = told_session(in_one_session(every, orders([fit.run for fit in every])[1]))
    assert "in the order of their times" in said[0]
    assert f"{len(alone)} of 5 records say no time that is theirs alone" in said[1]


def test_a_record_without_a_time_may_have_followed_the_one_given_before_it():
    every = [taken_at(fit, at_s, "a") for fit, at_s in zip(TO, (None, 30.0, 20.0, None, 0.0), strict=True)]
    first, second, third = orders([fit.run for fit in every])
    assert (first.chains, first.alone) == (((0, 4, 2, 3, 1),), ())
    assert (second.chains, second.alone) == (((4, 2, 1),), (0, 3))
    assert third.chains == ((0, 1, 2, 3, 4),)
    assert "2 without a time of their own: after the one given before" in first.known
    assert [order.by_clocks for order in (first, second, third)] == [False, True, False]


@pytest.mark.parametrize("times_s", [(5.0, 5.0, 5.0, 0.0, 9.0), (None, None, None, 1.0, 9.0)])
def test_records_most_of_which_have_no_time_of_their_own_are_taken_as_they_are_given(times_s):
    every = [taken_at(fit, at_s, "a") for fit, at_s in zip(TO, times_s, strict=True)]
    assert numbers(*every) == [(((0, 1, 2, 3, 4),), ())]


def test_times_of_rows_tell_the_order_where_no_record_says_when_it_began():
    later = replace(TO[0], run=replace(TO[0].run, t_s=TO[0].run.t_s + 10))
    assert numbers(later, TO[1]) == [(((1, 0),), ()), (((0, 1),), ())]
    (only,) = orders([TO[1].run, later.run])
    assert only.known == "in the order of their times"
    assert not only.by_clocks


@pytest.mark.parametrize("rows", [60, None])
def test_windows_of_one_record_begin_alike_and_the_longest_was_driven(rows):
    """They have the rows before the window and not those after it."""
    first, second, third = (taken_at(fit, at_s, "a") for fit, at_s in zip(TO[:3], (0.0, 10.0, 20.0), strict=True))
    run, end = second.run, slice(rows)
    window = replace(run, t_s=run.t_s[end], u_V=run.u_V[end], x_um=run.x_um[end], scored=slice(50, rows))
    every = [third, second, first, rows_to_fit(window, 10_000, 0, 1)]
    assert began(*every) == [(7,), (5,), None, (5,)]
    assert numbers(*every)[0][1] == ()


def test_the_same_voltage_driven_twice_is_no_window():
    """Neither says when it began, and their rows have the same times."""
    twice = [replace(fit, run=replace(fit.run, x_um=fit.run.x_um + more)) for fit in TO[:2] for more in (0.0, 0.1)]
    assert numbers(*twice) == [(((0, 1, 2, 3),), ())]
    assert began(*twice) == [None, (5,), (5,), (7,)]
