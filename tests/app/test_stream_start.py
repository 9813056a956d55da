"""A stream begins with the control state of one tick, or it does not begin."""

import pytest
from c_driver import build, numbers

from phaselead.device import wire

TRIES = 4
MOMENTS = 2
"""In which a tick may come, of each try."""


@pytest.fixture(scope="module")
def stream_start(tmp_path_factory):
    path = build(tmp_path_factory.mktemp("stream_start"), "stream_start")
    return lambda ticks: numbers(path, ticks)


@pytest.mark.parametrize("ticks", range(MOMENTS * TRIES))
def test_a_copy_that_a_tick_came_into_is_made_again(stream_start, ticks):
    (status, came, *same) = stream_start(ticks)[0]
    assert (status, came, same) == (wire.Status.OK, ticks, [1, 1, 1])


def test_it_is_busy_after_as_many_tries_and_there_is_no_state_to_read(stream_start):
    (status, came, latched, _, recording) = stream_start(1000)[0]
    assert (status, came) == (wire.Status.BUSY, MOMENTS * TRIES)
    assert (latched, recording) == (0, 0)
