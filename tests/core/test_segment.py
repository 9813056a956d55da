"""The queue of paths: the first in is the first out, and one that is full takes no more."""

from collections import deque

from core_bindings import PathConfig, Segment, SegmentQueue
from hypothesis import example, given
from hypothesis import strategies as st

QUEUED = len(SegmentQueue().ring)
actions = st.lists(st.sampled_from(["put"] * 12 + ["drop_first"] * 6 + ["drop_all"]), max_size=60)


def number_of(pointer):
    """Of the command and of the path; None: there is no segment."""
    return (pointer[0].number, pointer[0].path.offset) if pointer else None


@given(actions)
@example(["put"] * (2 * QUEUED) + ["drop_first"])
def test_it_is_a_queue_of_so_many_places(core, actions):
    queue, expected = SegmentQueue(), deque()
    for i, action in enumerate(actions):
        if action == "put":
            core.segment_put(queue, Segment(path=PathConfig(offset=-i)), i)
            if len(expected) < QUEUED:
                expected.append((i, -i))
        elif action == "drop_first":
            core.segment_drop_first(queue)
            if expected:
                expected.popleft()
        else:
            core.segment_drop_all(queue)
            expected.clear()
        assert queue.count == len(expected)
        assert number_of(core.segment_first(queue)) == (expected[0] if expected else None)
        assert number_of(core.segment_last(queue)) == (expected[-1] if expected else None)
