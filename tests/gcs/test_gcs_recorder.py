"""The data recorder on a stream that is made up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.device import LiveSamples
from phaselead.device.live import LiveAxis
from phaselead.gcs.errors import GcsError
from phaselead.gcs.recorder import AT_ONCE, MOST_POINTS, NEXT_COMMAND, NEXT_MOVE, ON_MOVES, Recorder
from phaselead.scope import Samples


def made(ticks: range, missing: int = 0) -> LiveSamples:
    """Position = tick, reference = tick + 0.5."""
    x = np.arange(ticks.start, ticks.stop, dtype=np.float32)
    one = LiveAxis(x + np.float32(0.5), x, x / 8, x, x)
    return LiveSamples(ticks.start, len(ticks), {"x": one}, missing)


@given(st.lists(st.integers(1, 90), min_size=1, max_size=8), st.integers(1, 7), st.booleans())
def test_every_so_manyth_tick_from_the_trigger_on_however_it_is_collected(parts, rate, collect_each):
    samples = Samples("x", seconds=1.0)
    samples.add(made(range(100)))
    recorder = Recorder(samples)
    recorder.rate = rate
    recorder.set_trigger(AT_ONCE)
    at = 100
    for size in parts:
        samples.add(made(range(at, at + size)))
        at += size
        if collect_each:
            recorder.collect()
    recorder.collect()
    wanted = list(range(100, at, rate))
    assert recorder.recorded(1) == len(wanted)
    (found,) = recorder.columns([1], 1, len(wanted)).values()
    assert found == wanted


def test_a_tick_that_did_not_come_is_nan():
    samples = Samples("x", seconds=1.0)
    recorder = Recorder(samples)
    recorder.begin()
    samples.add(made(range(5)))
    samples.add(made(range(7, 10), missing=2))
    recorder.collect()
    (found,) = recorder.columns([1], 1, 10).values()
    assert [at for at, value in enumerate(found) if np.isnan(value)] == [5, 6]


def test_it_is_full_at_its_size_and_begins_anew():
    samples = Samples("x", seconds=1.0)
    recorder = Recorder(samples)
    recorder.begin()
    for first in range(0, MOST_POINTS + 4000, 2000):
        samples.add(made(range(first, first + 2000)))
        recorder.collect()
    assert recorder.recorded(1) == MOST_POINTS
    recorder.begin()
    assert recorder.recorded(1) == 0


def test_options_of_a_table():
    samples = Samples("x", seconds=1.0)
    recorder = Recorder(samples)
    for table, option in ((1, 1), (2, 3), (3, 7), (4, 0)):
        recorder.configure(table, "X", option)
    recorder.begin()
    samples.add(made(range(4)))
    recorder.collect()
    found = recorder.columns([1, 2, 3], 2, 2)
    assert list(found.values()) == [[1.5, 2.5], [0.5, 0.5], [0.125, 0.25]]
    with pytest.raises(GcsError, match="NOT_ENOUGH"):
        recorder.columns([4], 1, 1)


@pytest.mark.parametrize(
    ("source", "moves", "begins", "after"),
    [(0, True, False, 0), (ON_MOVES, True, True, ON_MOVES), (ON_MOVES, False, False, ON_MOVES),
     (NEXT_MOVE, True, True, 0), (NEXT_MOVE, False, False, NEXT_MOVE), (NEXT_COMMAND, False, True, 0)],
)  # fmt: skip
def test_triggers(source, moves, begins, after):
    samples = Samples("x", seconds=1.0)
    recorder = Recorder(samples)
    recorder.set_trigger(source)
    recorder.commanded(0, moves=moves)
    samples.add(made(range(3)))
    recorder.collect()
    assert (recorder.count > 0, recorder.trigger) == (begins, after)
