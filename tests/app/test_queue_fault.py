"""A fault that comes while QUEUE checks its paths, which takes longer than a tick."""

import pytest
from c_driver import build, numbers

from phaselead.device import wire


@pytest.fixture(scope="module")
def queue_fault(tmp_path_factory):
    path = build(tmp_path_factory.mktemp("queue_fault"), "queue_fault")
    return lambda moment: numbers(path, moment)[0]


@pytest.mark.parametrize("moment", [1, 2])
def test_the_answer_is_that_a_fault_is_latched(queue_fault, moment):
    """It once was that a value was bad: the axes were found not to be driven."""
    assert queue_fault(moment) == (wire.Status.FAULT_LATCHED, 1, 0)


@pytest.mark.parametrize("never", [0, 3])
def test_without_one_the_path_is_queued(queue_fault, never):
    assert queue_fault(never) == (wire.Status.OK, 0, 1)
