"""Where the memory of each record starts."""

from __future__ import annotations

import numpy as np
import pytest
from bench_stage import Array, record, rising_sine

from phaselead.identify.operator.regressors import FitRun, rows_to_fit
from phaselead.identify.operator.starting_memories import settled_of, starting_memory, with_memories
from phaselead.identify.runs import axis_run
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


WAVE = np.cos(np.arange(750.0))


def explained(
    from_V: float, offset_um: float = 0.0, wave: float = 0.0, own_offsets: bool = False
) -> tuple[float | None, list[str]]:
    """What the second of two records is said to come from, when that explains ``offset_um`` and ``wave`` of it."""
    fits = [fitted(rising(10.0)), fitted(rising(5.0))]

    def residual(fit: FitRun) -> Array:
        known = fit.run is fits[0].run or (fit.came_from_V is not None and fit.came_from_V >= from_V)
        return 0.1 * WAVE if known else (0.1 + wave) * WAVE + offset_um

    (first, second), messages = with_memories(fits, residual, own_offsets)
    assert first.came_from_V is None
    return second.came_from_V, messages


def test_the_nearest_turning_point_that_explains_a_record_is_taken():
    said = "1 of 2 records do not start from rest, where each began was fitted: made (from 5 V)"
    assert explained(4.9, wave=1.0) == (5.0, [said])


def test_what_rest_explains_stays_at_rest():
    assert explained(99.0, wave=1.0) == (None, [])
    assert explained(4.9, wave=0.01) == (None, [])


def test_a_small_offset_is_creep_and_a_large_one_is_memory():
    """The record spans 50 um; creep is some tenths of a per cent of it."""
    assert explained(4.9, offset_um=0.4)[0] is None
    assert explained(4.9, offset_um=4.0)[0] == 5.0
    assert explained(4.9, offset_um=4.0, own_offsets=True)[0] is None


def test_a_single_record_defines_rest():
    fits, messages = with_memories([fitted(rising())], lambda fit: np.arange(750.0), False)
    assert fits[0].came_from_V is None
    assert messages == []


SQUARES = {None: 10.0, -3.0: 9.0, 1.0: 5.2, 4.0: 5.0, 7.0: 5.0}


@pytest.mark.parametrize(
    ("share", "alike", "found"),
    [(0.6, None, 4.0), (0.5, None, None), (0.6, 1.1, 1.0), (0.6, 1.01, 4.0), (1.0, 2.0, 1.0)],
)
def test_the_start_that_leaves_least_or_the_nearest_of_those_alike(share, alike, found):
    """Rest leaves 10; a turning point is believed below that times the share."""
    points = [volt for volt in SQUARES if volt is not None]
    assert starting_memory(SQUARES.__getitem__, points, share, alike) == found


def test_without_a_turning_point_to_try_a_record_starts_from_rest():
    assert starting_memory(lambda _: 1.0, [], 0.8) is None
