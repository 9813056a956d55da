"""Trigger outputs pulse at the marks of the path and nowhere else; the trigger input begins what waits for it."""

from fractions import Fraction

import numpy as np
import pytest
from device_bench import MID_CODE, SESSION, UM, Bench, V, step_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_motion import NOTHING, hold, holding, move_to, queue, sine

from phaselead.device import wire
from phaselead.device.stream import decode_samples

EDGE = 0x80
CHANNELS = wire.Channel.REFERENCE | wire.Channel.TRIGGER
NEAREST = Fraction(1, 2) + Fraction(1, 1000)
"""Half a tick, and what the phase is rounded by."""


def set_output(bench, mark, *, output=0, axis=0, rising=0, every=1, origin=0):
    return bench.status_of(wire.TriggerSetRequest(output, mark, axis, rising, every, origin))


def started(bench, axes=1, **joins):
    """The tick in which the paths begin; the recorder runs from before."""
    for axis in range(axes):
        assert bench.status_of(wire.SetJoinsRequest(axis, 0, joins.get("enter", 0), joins.get("leave", 0))) == 0
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(CHANNELS, 2**axes - 1, 1))
    return bench.ok(wire.StartRequest(2**axes - 1)).first_tick


def recorded(bench):
    """The first tick, references (n, axes), and the channel of the triggers (n,)."""
    stopped = bench.ok(wire.StreamStopRequest())
    bench.run(10)
    stream = decode_samples([bytes(wire.HEADER.size) + b.pack() for b in bench.samples], None, stopped.sent_ticks)
    triggers = [axis.trigger for axis in stream.axes.values()]
    assert all(np.array_equal(one, triggers[0]) for one in triggers)
    return stream.ticks[0], np.array([axis.reference for axis in stream.axes.values()], np.int64).T, triggers[0]


def pulses(bench, first_tick, output=0):
    """Ticks of the pulses, counted from the first of the path."""
    begin, _, trigger = recorded(bench)
    return np.flatnonzero(trigger >> output & 1) + begin - first_tick


def volts(bench, **path):
    assert bench.set_axis(mode=wire.Mode.OPEN) == wire.Status.OK
    assert bench.set_path(**path) == wire.Status.OK


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(f_Hz=st.floats(0.5, 400), marks=st.integers(1, 300), enter=st.integers(0, 90), ticks=st.integers(1, 3000))
def test_turn_marks_are_in_the_nearest_ticks(f_Hz, marks, enter, ticks):
    """None is lost, added, or drifts away, whatever the frequency."""
    marks = min(marks, int(4999 / f_Hz))
    bench = Bench()
    volts(bench, step=step_of(f_Hz), ticks=ticks)
    assert set_output(bench, wire.Mark.TURN, every=marks) == wire.Status.OK
    first = started(bench, enter=enter, leave=20)
    bench.run(ticks + enter + 60)
    found = pulses(bench, first)
    apart = Fraction(2**64, marks * step_of(f_Hz))
    expected = [k * apart for k in range(int((ticks - Fraction(1, 2)) / apart) + 1)]
    assert len(found) - len(expected) in (-1, 0, 1)  # the last one may be half a tick from the end
    assert all(abs(int(tick) - mark) <= NEAREST for tick, mark in zip(found, expected, strict=False))
    assert found[0] == 0
    assert found[-1] < ticks


@given(every=st.integers(1, 700), ticks=st.integers(1, 2000), enter=st.integers(0, 60))
@settings(max_examples=30, deadline=None)
def test_time_marks_count_from_where_the_path_begins(every, ticks, enter):
    bench = Bench()
    volts(bench, ticks=ticks)
    assert set_output(bench, wire.Mark.TIME, every=every, output=2) == wire.Status.OK
    first = started(bench, enter=enter, leave=30)
    bench.run(ticks + enter + 200)
    assert pulses(bench, first, output=2).tolist() == list(range(0, ticks, every))


@given(
    distance=st.integers(128, 40 * UM),
    origin=st.integers(-20 * UM, 20 * UM),
    rising=st.booleans(),
    f_Hz=st.floats(0.5, 50),
)
@settings(max_examples=40, deadline=None)
def test_way_marks_are_where_the_reference_passes_a_place(distance, origin, rising, f_Hz):
    bench = Bench()
    assert bench.set_axis(1, mode=wire.Mode.PID) == wire.Status.OK
    assert bench.set_path(1, swing=60 * UM, offset=5 * UM, step=step_of(f_Hz)) == wire.Status.OK
    assert set_output(bench, wire.Mark.WAY, axis=1, rising=int(rising), every=distance, origin=origin) == 0
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(CHANNELS, 2, 1))
    first = bench.ok(wire.StartRequest(2)).first_tick
    bench.run(800)
    begin, reference, trigger = recorded(bench)
    on_path = reference[first - begin :, 0]
    places = (on_path - origin) / distance
    change = np.diff(np.floor(places))
    expected = change > 0 if rising else change != 0
    near_one = np.abs(places - np.round(places)) < 2.0**-8  # places are rounded by so much
    sure = ~(near_one[1:] | near_one[:-1])
    pulsed = (trigger[first - begin :] & 1).astype(bool)
    assert np.array_equal(pulsed[1:][sure], expected[sure])
    assert not pulsed[0]
    assert not trigger[: first - begin].any()


def test_a_step_pulses_once_it_has_settled_and_once_only():
    bench = holding(mode=wire.Mode.PID, velocity=0, acceleration=0, jerk=0, window_q16=UM, window_ticks=20)
    bench.ok(wire.StreamStopRequest())
    bench.run(20)
    bench.samples.clear()
    bench.ok(wire.StreamStartRequest(CHANNELS, 1, 1))
    assert set_output(bench, wire.Mark.TARGET) == wire.Status.OK
    bench.run(200)  # what has not moved since does not pulse
    here_um = bench.ok(wire.WhereRequest()).reference[0] / UM
    target_code = MID_CODE + round(3 / 280 * 65536)
    begin = bench.status().tick
    assert queue(bench, x=move_to(round((here_um + 3) * UM), 100)) == wire.Status.OK
    bench.run(150)
    bench.run(30, adc=target_code)  # arrives late, by 50 ticks
    bench.run(5)  # leaves
    bench.run(100, adc=target_code)  # and is there again
    first, reference, trigger = recorded(bench)
    at = np.flatnonzero(trigger & 1) + first - begin
    assert len(at) == 1
    assert 170 <= at[0] <= 176  # 150 ticks off target, 20 on it, and what the commands took
    assert reference[-1, 0] == reference[at[0] + begin - first, 0] == reference[at[0] + begin - first - 20, 0]


def test_outputs_follow_axes_of_their_own_at_once():
    bench = Bench()
    for axis, f_Hz in ((0, 50), (2, 10)):
        assert bench.set_axis(axis, mode=wire.Mode.OPEN) == wire.Status.OK
        assert bench.set_path(axis, step=step_of(f_Hz)) == wire.Status.OK
    assert set_output(bench, wire.Mark.TURN, output=0, axis=2) == wire.Status.OK
    assert set_output(bench, wire.Mark.TURN, output=1, axis=0) == wire.Status.OK
    assert set_output(bench, wire.Mark.TURN, output=2, axis=0, every=4) == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(CHANNELS, 5, 1))
    first = bench.ok(wire.StartRequest(5)).first_tick
    bench.run(1600)
    begin, _, trigger = recorded(bench)
    on_path = trigger[first - begin :]
    assert [len(np.flatnonzero(on_path[:1500] >> output & 1)) for output in range(3)] == [3, 15, 60]
    assert np.flatnonzero(on_path & 1)[:3].tolist() == [0, 500, 1000]
    assert np.flatnonzero(on_path & 4)[:4].tolist() == [0, 25, 50, 75]


def test_a_mark_set_on_the_way_waits_for_the_next_one():
    bench = Bench()
    volts(bench, step=step_of(10))
    first = started(bench)
    bench.run(700)
    assert set_output(bench, wire.Mark.TURN) == wire.Status.OK
    assert set_output(bench, wire.Mark.TIME, output=1, every=7) == wire.Status.OK
    bench.run(900)
    begin, _, trigger = recorded(bench)
    assert (np.flatnonzero(trigger & 1) + begin - first).tolist() == [1000, 1500]
    assert not (trigger & 2).any()  # the path has begun


@pytest.mark.parametrize(
    "bad",
    [
        {"output": 3},
        {"mark": 5},
        {"axis": 3},
        {"rising": 2},
        {"mark": wire.Mark.TURN, "every": 0},
        {"mark": wire.Mark.TIME, "every": 0},
        {"mark": wire.Mark.WAY, "every": 127},
    ],
)
def test_what_no_tick_can_hold_is_refused(bad):
    assert set_output(Bench(), **({"mark": wire.Mark.TARGET} | bad)) == wire.Status.BAD_VALUE


def test_a_new_session_begins_without_marks():
    bench = Bench()
    assert set_output(bench, wire.Mark.TIME) == wire.Status.OK
    bench.session = SESSION + 1
    bench.ok(wire.HelloRequest())
    volts(bench, ticks=100)
    first = started(bench)
    bench.run(200)
    assert len(pulses(bench, first)) == 0


# ---------------------------------------------------------------- the input


def waiting(**segments):
    bench = holding("xy")
    mask = sum(1 << "xyz".index(axis) for axis in segments)
    three = tuple(segments.get(axis, NOTHING) for axis in "xyz")
    request = wire.QueueRequest(mask, 0, 0, three, 1)
    return bench, bench.status_of(request)


def edge(bench):
    """One comes now. Gives the tick that sees it."""
    tick = bench.firmware.tick
    bench.firmware.trigger_at(tick)
    return tick


def test_a_path_begins_in_the_tick_after_the_edge():
    bench = holding("xy")
    edge(bench)
    bench.run(50)  # one that nothing waits for is forgotten
    assert queue(bench, x=hold(), y=hold()) == wire.Status.OK
    bench, status = waiting(x=move_to(2 * V, 100), y=move_to(V, 100))
    assert status == wire.Status.OK
    bench.run(500)
    assert bench.status().first_tick == 0
    assert bench.ok(wire.WhereRequest()).queued[:2] == (1, 1)
    seen = edge(bench)
    bench.run(200)
    assert bench.status().first_tick == seen + 1
    told = [event for event in bench.events if event.kind == wire.EventKind.TRIGGER]
    assert [(event.tick, event.value) for event in told] == [(seen, 3)]
    head = bytes(wire.HEADER.size)
    stream = decode_samples([head + batch.pack() for batch in bench.samples], None)
    for axis in stream.axes.values():
        moved = stream.ticks[np.flatnonzero(np.diff(axis.reference.astype(np.int64)))]
        assert abs(moved[0] - (seen + 1)) <= 2  # the first steps of a least-jerk move are below an LSB
        assert moved[-1] <= seen + 101


def test_a_periodic_path_is_at_its_beginning_when_its_join_is_over():
    bench, status = waiting(x=sine(2 * V, 0, 20, 1000, enter=150), y=sine(V, 0, 10, 1000, enter=150))
    assert status == wire.Status.OK
    assert set_output(bench, wire.Mark.TURN) == wire.Status.OK
    bench.run(100)
    seen = edge(bench)
    bench.ok(wire.StreamStopRequest())
    bench.run(5)
    bench.samples.clear()
    bench.ok(wire.StreamStartRequest(CHANNELS, 3, 1))
    bench.run(600)
    first = bench.status().first_tick
    assert first == seen + 151
    assert pulses(bench, first)[:2].tolist() == [0, 250]


def test_edges_are_in_the_stream_and_what_waits_can_be_dropped():
    bench, status = waiting(x=move_to(2 * V, 100))
    assert status == wire.Status.OK
    assert queue(bench, at_once=1, x=hold(flags=wire.PathFlag.FROM_HERE, enter=20)) == wire.Status.OK
    bench.run(100)
    bench.ok(wire.StreamStopRequest())
    bench.run(5)
    bench.samples.clear()
    bench.ok(wire.StreamStartRequest(CHANNELS, 1, 1))
    seen = edge(bench)
    bench.run(100)
    begin, reference, trigger = recorded(bench)
    assert (np.flatnonzero(trigger == EDGE) + begin).tolist() == [seen]
    assert np.ptp(reference) == 0
    assert bench.status().first_tick == 0


def test_a_flag_beyond_one_is_refused():
    bench = holding("x")
    assert bench.status_of(wire.QueueRequest(1, 0, 0, (hold(), NOTHING, NOTHING), 2)) == wire.Status.BAD_VALUE
