"""Records that each count from 0 s: on one clock where all of a session say when they were taken, else untouched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.gap.records import axis_runs, seconds_into_session
from phaselead.gap.run import run_gap
from phaselead.identify import fit
from phaselead.model import AxisModel, Stage, TimeView, catalogue
from phaselead.record import AxisRecord, Recording, t0_facts

LENGTH_S = 1.0
"""Of every record here."""
RATE_HZ = 1000
DAY_s = 86400.0


def taken(unix_s, from_s=0.0):
    t_s = from_s + np.linspace(0.0, LENGTH_S, 11)
    return Recording(t_s=t_s, axes={"x": AxisRecord(0 * t_s, 0 * t_s)}, meta=t0_facts(unix_s, 0.0, 1))


one_after_the_other = st.lists(st.floats(1.1, 1e5), min_size=5, max_size=9).map(np.cumsum)


@given(one_after_the_other, st.floats(0, 2e9), st.randoms())
def test_seconds_count_from_the_first_record_of_the_session_in_whatever_order(after_s, since_s, random):
    order = [*range(len(after_s))]
    random.shuffle(order)
    found = seconds_into_session([taken(since_s + after_s[i]) for i in order])
    np.testing.assert_allclose(found, after_s[order] - after_s[0], atol=1e-5)


@given(one_after_the_other, st.integers(0, 4))
def test_one_record_that_does_not_say_leaves_the_session_without_a_clock(after_s, silent):
    records = [taken(None if i == silent else t, from_s=7.0) for i, t in enumerate(after_s)]
    assert seconds_into_session(records) == [0.0] * len(records)


@given(one_after_the_other, st.integers(0, 4), st.floats(-0.9, 0.9))
def test_two_records_at_once_show_that_it_is_no_clock(after_s, which, later_s):
    records = [taken(t) for t in (*after_s, after_s[which] + later_s)]
    assert seconds_into_session(records) == [0.0] * len(records)


def test_windows_of_one_record_stay_one_after_the_other():
    whole = taken(5e8)
    parts = [replace(whole, scored=slice(0, 5)), replace(whole, scored=slice(5, 11))]
    assert seconds_into_session(parts) == [0.0, 0.0]
    assert seconds_into_session([*parts, taken(5e8 + 60)]) == pytest.approx([0.0, 0.0, 60.0])


def session(began_s, count, drifts_um_per_s=0.0, seed=0):
    """Records of a straight line, 10 s apart, each from 0 s on; the last is at rest."""
    rng, found = np.random.default_rng(seed), []
    t_s = np.arange(4 * RATE_HZ) / RATE_HZ
    for i in range(count):
        level_V = 0.0 if i == count - 1 else 2.0 + i
        u_V = level_V / 2 * (1 - np.cos(2 * np.pi * (1 + i) * t_s))
        drift_um = drifts_um_per_s * (t_s + 10.0 * i)
        x_um = 10 * u_V + drift_um + rng.normal(0, 0.01) + rng.normal(0, 0.005, len(t_s))
        name, meta = f"{seed}-{i}.h5", t0_facts(began_s, 10.0 * i, 1)
        found.append(Recording(t_s, {"x": AxisRecord(u_V, x_um)}, source=name, meta=meta))
    return found


def without_clock(records):
    return [replace(record, meta={}) for record in records]


def by_the_clock(records):
    """The same with times that need no attribute."""
    return [replace(r, meta={}, t_s=r.t_s + 10.0 * i) for i, r in enumerate(records)]


def answer(stage, parts):
    reference, train, holdout = parts
    few = {"thermal_drift", "offset", "gain_change", "creep"}
    return run_gap(stage, train, holdout, reference, without=tuple(n for n in catalogue() if n not in few))


def test_the_attribute_and_times_of_one_clock_give_the_same_answer():
    reference = session(4e8, 5, seed=1)
    later = session(5e8, 9, drifts_um_per_s=0.02, seed=2)
    stage, _ = fit(reference)
    counted = by_the_clock(later)
    said = answer(stage, (reference, [*later[:5], later[8]], later[5:8]))
    same = answer(stage, (by_the_clock(reference), [*counted[:5], counted[8]], counted[5:8]))
    alone = answer(stage, tuple(map(without_clock, (reference, [*later[:5], later[8]], later[5:8]))))
    assert [e.name for e in said.effects] == [e.name for e in same.effects] == ["thermal_drift"]
    (mine,), (theirs,) = said.effects, same.effects
    assert mine.params["ramp_um_per_s"][0] == pytest.approx(theirs.params["ramp_um_per_s"][0])
    assert any("counts from the first training or held-out record" in line for line in said.messages)
    assert not any("counts from the first" in line for line in (*same.messages, *alone.messages))


def test_a_base_that_drifts_hides_nothing_in_sessions_a_day_apart():
    reference, later = session(4e8, 5, 5e-4, seed=1), session(4e8 + DAY_s, 9, 5e-4, seed=2)
    stage, _ = fit(reference)
    drifting = stage.with_effect("thermal_drift", ramp_um_per_s=5e-4, rise_um=0.0)
    assert answer(drifting, (reference, [*later[:5], later[8]], later[5:8])).verdicts == ("none",)


def test_runs_count_from_their_session_and_know_the_times_of_their_files():
    line = AxisModel(time=TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=float(RATE_HZ)))
    later = session(5e8, 4, seed=3)
    runs = axis_runs(Stage(name="line", axes={"x": line}), later[:2], later[2:], [])["x"]
    assert [run.t_s[0] for run in runs] == pytest.approx([0.0, 10.0, 20.0, 30.0])
    assert all(run.file_t_s[0] == pytest.approx(0.0) for run in runs)
