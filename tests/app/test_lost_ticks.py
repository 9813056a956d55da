"""Ticks that do not come, while flash is written or the processor is late: of a stream they are dropped and counted."""

import pytest
from c_driver import build, numbers
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.fixture(scope="module")
def lost_ticks(tmp_path_factory):
    path = build(tmp_path_factory.mktemp("lost_ticks"), "lost_ticks")
    return lambda decimation, spans: numbers(path, decimation, *[ticks for span in spans for ticks in span])


@settings(max_examples=100, deadline=None)
@given(
    decimation=st.one_of(st.integers(1, 12), st.integers(1, 700)),
    spans=st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), min_size=1, max_size=8),
)
def test_a_stream_keeps_its_step_over_ticks_that_are_lost(lost_ticks, decimation, spans):
    """Every tick of its step is there or dropped, and each batch says how many were dropped before it."""
    ran, end = set(), 0
    for run, lost in spans:
        ran.update(range(end, end + run))
        end += run + lost
    *batches, (dropped,) = lost_ticks(decimation, spans)
    step = range(0, end, decimation)
    taken = [first + i * decimation for first, ticks, _ in batches for i in range(ticks)]
    assert taken == [tick for tick in step if tick in ran]
    assert dropped == sum(tick not in ran for tick in step)
    for first, _, before in batches:
        assert before == sum(tick < first and tick not in ran for tick in step)
