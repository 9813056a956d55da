"""Records that each count from 0 s: on one clock where all say when they were taken, else untouched."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.gap.one_clock import on_one_clock
from phaselead.record import AxisRecord, Recording, t0_facts

LENGTH_S = 1.0
"""Of every record here."""


def taken(unix_s, from_s=0.0):
    t_s = from_s + np.linspace(0.0, LENGTH_S, 11)
    return Recording(t_s=t_s, axes={"x": AxisRecord(0 * t_s, 0 * t_s)}, meta=t0_facts(unix_s, 0.0))


def times(records):
    return [float(record.t_s[0]) for record in records]


one_after_the_other = st.lists(st.floats(1.1, 1e5), min_size=5, max_size=9).map(np.cumsum)


@given(one_after_the_other, st.floats(0, 2e9))
def test_the_first_training_or_held_out_record_is_at_zero_and_distances_are_those_of_the_clock(after_s, since_s):
    reference, later = after_s[:2], after_s[2:]
    train, holdout = later[1::2], later[::2]
    moved = on_one_clock(*([taken(since_s + t) for t in part] for part in (train, holdout, reference)))
    for records, taken_s in zip(moved, (train, holdout, reference), strict=True):
        np.testing.assert_allclose(times(records), taken_s - later[0], atol=1e-5)
        for record in records:
            np.testing.assert_allclose(np.diff(record.t_s), LENGTH_S / 10, atol=1e-9)


@given(one_after_the_other, st.integers(0, 4))
def test_one_record_that_does_not_say_leaves_all_as_they_are(after_s, silent):
    records = [taken(None if i == silent else t, from_s=7.0) for i, t in enumerate(after_s[:5])]
    moved = on_one_clock(records[:2], records[2:4], records[4:])
    assert [id(record) for part in moved for record in part] == [id(record) for record in records]


@given(one_after_the_other, st.integers(0, 3), st.floats(-0.9, 0.9))
def test_two_records_at_once_show_that_it_is_no_clock(after_s, which, later_s):
    taken_s = [*after_s[:4], after_s[which] + later_s]
    records = [taken(t) for t in taken_s]
    moved = on_one_clock(records[:2], records[2:4], records[4:])
    assert all(times(part) == [0.0] * len(part) for part in moved)


def test_windows_of_one_record_stay_one_after_the_other():
    whole = taken(5e8)
    early = Recording(whole.t_s, whole.axes, scored=slice(0, 5), meta=whole.meta)
    late = Recording(whole.t_s, whole.axes, scored=slice(5, 11), meta=whole.meta)
    (train,), (holdout,), _ = on_one_clock([early], [late], [taken(4e8)])
    assert train.t_s[0] == holdout.t_s[0] == pytest.approx(0.0)
