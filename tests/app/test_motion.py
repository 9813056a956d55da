"""Paths one after another: continuous in position, velocity and acceleration, within the limits, on the same tick."""

from zlib import crc32

import numpy as np
import pytest
from device_bench import UM, Bench, V, model, step_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.stream import decode_samples

HERE, MORE = wire.PathFlag.FROM_HERE, wire.PathFlag.MORE
NOTHING = wire.Segment(wire.PathKind.HOLD, 0, 0, 0, 0, 0, 0, 0)
FINE = 1 << 24
"""Limits are in so many parts of an LSB."""


def per(ticks):
    return min(-(-(2**64) // ticks), 2**64 - 1)


def hold(offset=0, *, flags=0, ticks=0, enter=0):
    return wire.Segment(wire.PathKind.HOLD, flags, 0, offset, 0, ticks, enter, 0)


def move_to(target, ticks, *, enter=0, flags=0):
    return wire.Segment(wire.PathKind.MOVE, HERE | flags, target, 0, per(ticks), 0, enter, 0)


def sine(swing, offset, f_Hz, ticks, *, enter=200, leave=200, flags=0):
    return wire.Segment(wire.PathKind.SINE, flags, swing, offset, step_of(f_Hz), ticks, enter, leave)


def queue(bench, *, at_once=0, begin_tick=0, **segments):
    mask = sum(1 << "xyz".index(axis) for axis in segments)
    three = tuple(segments.get(axis, NOTHING) for axis in "xyz")
    return bench.status_of(wire.QueueRequest(mask, at_once, begin_tick, three))


def holding(axes="x", mode=wire.Mode.OPEN, **limits):
    """A device whose axes hold where they stand."""
    bench = Bench()
    if mode != wire.Mode.OPEN:
        assert bench.upload(model()).status == wire.Status.OK
    for axis in range(len(axes)):
        assert bench.set_axis(axis, mode, **({"kp": V // 50, "ki": 1 << 20} if "PID" in mode.name else {})) == 0
        assert bench.set_path(axis, path=wire.PathKind.HOLD, swing=0) == wire.Status.OK
        bench.ok(wire.SetJoinsRequest(axis, HERE, 50, 0))
        if limits:
            bench.ok(wire.MotionRequest(axis, **{"window_q16": UM, "window_ticks": 10} | limits))
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(wire.Channel.REFERENCE | wire.Channel.FEEDFORWARD, 2 ** len(axes) - 1, 1))
    bench.ok(wire.StartRequest(2 ** len(axes) - 1))
    bench.run(60)
    return bench


def recorded(bench):
    """Every tick since the stream began, by axis."""
    stopped = bench.ok(wire.StreamStopRequest())
    bench.run(10)
    head = bytes(wire.HEADER.size)
    return decode_samples([head + batch.pack() for batch in bench.samples], 0, stopped.sent_ticks).axes


def references(bench):
    return {axis: stream.reference.astype(np.int64) for axis, stream in recorded(bench).items()}


def derivatives(reference):
    """The largest velocity, acceleration and jerk, per tick."""
    return [int(np.abs(np.diff(reference, order)).max(initial=0)) for order in (1, 2, 3)]


LIMITS = {"velocity": V // 40 * FINE, "acceleration": V // 800 * FINE, "jerk": V // 8000 * FINE}

swing = st.integers(1, 4 * V)
ticks = st.integers(1, 400)
segment = st.one_of(
    st.builds(move_to, st.integers(0, 8 * V), ticks, enter=st.sampled_from([0, 0, 60, 200])),
    st.builds(hold, flags=st.just(HERE), ticks=st.integers(0, 40), enter=st.sampled_from([0, 100, 300])),
    st.builds(sine, swing, st.integers(0, 4 * V), st.integers(1, 40), st.integers(0, 500), enter=ticks, leave=ticks),
    st.builds(hold, st.integers(0, 8 * V), enter=st.integers(0, 500)),
)
commands = st.lists(st.tuples(segment, st.booleans(), st.integers(0, 300), st.integers(0, 60)), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(commands)
def test_no_sequence_of_commands_exceeds_the_limits(asked):
    """Velocity, acceleration and jerk of the reference, whatever is queued whenever, with four LSB for its rounding."""
    bench = holding(**LIMITS)
    for path, at_once, later, pause in asked:
        begin = bench.status().tick + later if later > 10 else 0
        status = queue(bench, x=path, at_once=int(at_once), begin_tick=begin)
        assert status in (wire.Status.OK, wire.Status.BAD_VALUE, wire.Status.OUTSIDE_LIMITS, wire.Status.BUSY)
        bench.run(1 + pause)
    bench.run(600)
    for found, limit in zip(derivatives(references(bench)["x"]), LIMITS.values(), strict=True):
        assert found <= limit / FINE + 4


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([("move", 300), ("sine", 300), ("stop", 300)]), st.integers(1, 8 * V), st.floats(1, 30))
def test_what_is_faster_than_its_limit_is_refused_and_a_move_no_sooner(asked, swing, f_Hz):
    """A limit at 0.98 of what a path does refuses it; one at 1.01 admits a move. The bound of a join may be further
    off: its two paths need not do their worst at the same time."""
    kind, enter = asked
    path = move_to(swing, enter) if kind == "move" else sine(swing, 0, f_Hz, 5000, enter=enter, leave=enter)
    bench = holding()
    assert queue(bench, x=path) == wire.Status.OK
    bench.run(1400 if kind != "stop" else 700)
    speed = derivatives(references(bench)["x"])[0]
    free = {"acceleration": 0, "jerk": 0}
    slower = holding(**free, velocity=int(0.98 * speed * FINE))
    assert queue(slower, x=path) == wire.Status.OUTSIDE_LIMITS or speed < 100
    faster = holding(**free, velocity=int((1.01 * speed + 2) * FINE))  # two LSB for the rounding of the reference
    assert queue(faster, x=path) == wire.Status.OK or kind != "move"


def test_a_move_arrives_to_the_bit_and_the_next_begins_there():
    bench = holding()
    for target in (5 * V, V + 7, 3 * V):
        assert queue(bench, x=move_to(target, 100)) == wire.Status.OK
    bench.run(80)
    assert bench.ok(wire.WhereRequest()).queued == (2, 0, 0)
    bench.run(300)
    where = bench.ok(wire.WhereRequest())
    assert (where.reference[0], where.end[0], where.moving) == (3 * V, 3 * V, 0)
    reference = references(bench)["x"]
    assert {5 * V, V + 7, 3 * V} <= set(reference.tolist())


def test_a_hold_that_waits_to_begin_wherever_the_axis_is_then_ends_at_the_reference_until_then():
    """Its end was once said to be 0."""
    bench = holding()
    assert queue(bench, x=move_to(5 * V, 400)) == wire.Status.OK
    begin = bench.status().tick + 200
    assert queue(bench, x=hold(flags=HERE, enter=100), begin_tick=begin) == wire.Status.OK
    bench.run(100)
    where = bench.ok(wire.WhereRequest())
    assert where.queued[0] == 1
    assert where.end[0] == where.reference[0] > 0
    bench.run(300)
    where = bench.ok(wire.WhereRequest())
    assert (where.queued[0], where.moving) == (0, 0)
    assert 0 < where.end[0] == where.reference[0] < 5 * V


@pytest.mark.parametrize(("volts_q24", "status"), [
    (-2 * V, wire.Status.OK), (-2 * V - 1, wire.Status.OUTSIDE_LIMITS),
    (10 * V, wire.Status.OK), (10 * V + 1, wire.Status.OUTSIDE_LIMITS),
])  # fmt: skip
def test_without_a_model_outputs_go_from_minus_2_to_10_V(bench, volts_q24, status):
    assert bench.set_axis(0) == wire.Status.OK
    assert bench.set_path(0, path=wire.PathKind.MOVE, swing=volts_q24, step=2**64 // 5000) == status


@pytest.mark.parametrize("code", [5, 2341, 65_500])
def test_without_a_model_the_sensor_has_280_um_from_minus_10_um_on_to_the_last_bit(code):
    """10 um are 2340.57 codes; 280 um in 65536 codes of q16 are 280 a code. It holds where it was measured to be."""
    bench = Bench()
    assert bench.set_axis(0, wire.Mode.PID) == wire.Status.OK
    assert bench.set_path(0, path=wire.PathKind.HOLD, swing=0) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, HERE, 1, 0))
    bench.ok(wire.ArmRequest(0))
    bench.run(2, adc=code)
    bench.ok(wire.StartRequest(1))
    bench.run(5, adc=code)
    assert bench.ok(wire.WhereRequest()).reference[0] == round(280 * (code - 599186 / 256))


@pytest.mark.parametrize("rest", [0, 1, 128, 255])
def test_the_code_of_0_um_has_a_fraction(rest):
    bench = Bench()
    assert bench.upload(model(flags=3 | rest << 24)).status == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.PID) == wire.Status.OK
    assert bench.set_path(0, path=wire.PathKind.HOLD, swing=0) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, HERE, 1, 0))
    bench.ok(wire.ArmRequest(0))
    bench.run(2, adc=5000)
    bench.ok(wire.StartRequest(1))
    bench.run(5, adc=5000)
    assert bench.ok(wire.WhereRequest()).reference[0] == round(280 * (5000 - 2341 - rest / 256))


def test_a_path_that_begins_elsewhere_is_refused():
    bench = holding()
    assert queue(bench, x=move_to(4 * V, 100)) == wire.Status.OK
    for other in (hold(4 * V + 1), hold(3 * V), sine(V, 4 * V, 5, 0, enter=0)):
        assert queue(bench, x=other) == wire.Status.BAD_VALUE
    from_elsewhere = wire.Segment(wire.PathKind.MOVE, 0, V, V, per(100), 0, 0, 0)
    assert queue(bench, x=from_elsewhere) == wire.Status.BAD_VALUE
    assert queue(bench, x=move_to(0, 100), at_once=1) == wire.Status.BAD_VALUE  # without a join it would jump
    assert queue(bench, x=hold(4 * V)) == wire.Status.OK


def test_axes_of_a_command_begin_in_the_same_tick():
    bench = holding("xy")
    assert queue(bench, y=move_to(V, 200)) == wire.Status.OK
    assert queue(bench, x=move_to(2 * V, 100), y=move_to(3 * V, 100)) == wire.Status.OK
    bench.run(500)
    x, y = references(bench).values()
    assert np.argmax(x > 0) == np.flatnonzero(y == V)[-1] + 1


def test_a_dropped_companion_keeps_nobody_waiting():
    bench = holding("xy")
    assert queue(bench, y=move_to(V, 200)) == wire.Status.OK
    assert queue(bench, x=move_to(2 * V, 100), y=move_to(3 * V, 100)) == wire.Status.OK
    assert queue(bench, y=hold(flags=HERE, enter=100), at_once=1) == wire.Status.OK
    bench.run(400)
    assert bench.ok(wire.WhereRequest()).reference[0] == 2 * V


def test_a_stamped_path_begins_in_its_tick():
    bench = holding()
    tick = bench.status().tick + 100
    assert queue(bench, x=move_to(V, 100), begin_tick=tick) == wire.Status.OK
    assert queue(bench, x=move_to(V, 100), begin_tick=3) == wire.Status.BAD_VALUE  # has passed
    bench.run(300)
    moved = np.flatnonzero(np.diff(references(bench)["x"]))
    first = bench.samples[0].first_tick
    assert first + moved[0] == tick  # its first value is the one that was held


def test_it_moves_for_as_long_as_a_path_has_not_ended():
    """One without an end for ever, one that holds for a time for that time."""
    bench = holding()
    assert bench.ok(wire.WhereRequest()).moving == 0
    assert queue(bench, x=hold(ticks=200)) == wire.Status.OK
    bench.run(100)
    assert bench.ok(wire.WhereRequest()).moving == 1
    bench.run(200)
    assert bench.ok(wire.WhereRequest()).moving == 0
    assert queue(bench, x=sine(V, 0, 5, 0)) == wire.Status.OK
    bench.run(3000)
    assert bench.ok(wire.WhereRequest()).moving == 1


def test_a_queue_that_runs_dry_holds_and_says_so():
    bench = holding()
    assert queue(bench, x=move_to(V, 50, flags=MORE)) == wire.Status.OK
    bench.run(100)
    where = bench.ok(wire.WhereRequest())
    assert (where.dry, where.reference[0], where.state) == (1, V, wire.State.RUNNING)
    assert queue(bench, x=move_to(2 * V, 50, flags=MORE)) == wire.Status.OK
    assert queue(bench, x=move_to(V, 50)) == wire.Status.OK
    bench.run(200)
    assert bench.ok(wire.WhereRequest()).dry == 0


def test_a_full_queue_is_busy():
    bench = holding()
    taken = [queue(bench, x=hold(0, ticks=1000)) for _ in range(12)]
    assert taken == [wire.Status.OK] * taken.index(wire.Status.BUSY) + [wire.Status.BUSY] * (
        12 - taken.index(wire.Status.BUSY)
    )
    assert queue(bench, x=hold(0), at_once=1) == wire.Status.OK
    bench.run(2)
    assert bench.ok(wire.WhereRequest()).queued == (0, 0, 0)


def test_only_axes_that_are_driven_can_queue(bench):
    assert queue(bench, x=hold()) == wire.Status.WRONG_STATE
    moving = holding()
    assert queue(moving, y=hold()) == wire.Status.BAD_VALUE
    assert queue(moving, x=move_to(11 * V, 100)) == wire.Status.OUTSIDE_LIMITS
    moving.ok(wire.StopRequest())
    assert queue(moving, x=hold()) == wire.Status.WRONG_STATE


@pytest.mark.parametrize("mode", [wire.Mode.FF, wire.Mode.INVERSE])
def test_feedforward_has_no_kick_at_either_end(mode):
    """A sine entered by a join and ended in mid-slope: the feed-forward stays below 1.3 of the sine's own speed."""
    bench = holding(mode=mode)
    assert queue(bench, x=sine(60 * UM, 10 * UM, 20, 1062, enter=500, leave=500)) == wire.Status.OK
    bench.run(2400)
    u = recorded(bench)["x"].feedforward.astype(float)[60:]
    steps = np.abs(np.diff(u))
    middle = slice(700, 1400)
    assert steps.max() < 1.3 * steps[middle].max()
    assert np.abs(u[-50:] - u[-1]).max() <= 2  # it holds


def test_an_inverse_sees_a_move_before_it_begins():
    """Looking 1.5 ticks ahead from the first tick on it would begin with 50 steps of the recorded voltage."""
    bench = holding(mode=wire.Mode.INVERSE)
    bench.run(200)
    assert queue(bench, x=move_to(150 * UM, 20)) == wire.Status.OK
    bench.run(60)
    x = recorded(bench)["x"]
    steps, moves = (np.diff(channel.astype(int))[200:] for channel in (x.feedforward, x.reference))
    first = np.flatnonzero(np.abs(steps) > 2)[0]
    assert abs(steps[first]) < 25
    assert first <= np.flatnonzero(moves)[0]


def test_without_a_join_the_lead_is_dropped_in_one_tick():
    """What test_feedforward_has_no_kick_at_either_end would see: the paper's sine stopped mid-slope."""
    bench = holding(mode=wire.Mode.FF)
    assert queue(bench, x=sine(60 * UM, 10 * UM, 20, 1062, enter=500, leave=0)) == wire.Status.OK
    bench.run(2400)
    steps = np.abs(np.diff(recorded(bench)["x"].feedforward.astype(float)[60:]))
    assert steps.max() > 2 * steps[700:1400].max()


def test_a_hold_within_a_move_stops_between_here_and_its_target():
    bench = holding()
    assert queue(bench, x=move_to(8 * V, 1000)) == wire.Status.OK
    bench.run(500)
    assert queue(bench, x=hold(flags=HERE, enter=100), at_once=1) == wire.Status.OK
    bench.run(200)
    where = bench.ok(wire.WhereRequest())
    assert where.moving == 0
    assert 4 * V < where.reference[0] < 5 * V


def test_a_hold_within_a_sine_stops_where_that_is_half_a_join_later():
    """No test saw a look ahead of half as many ticks."""
    stopped, going = holding(), holding()
    for bench in (stopped, going):
        assert queue(bench, x=sine(4 * V, 0, 5, 0)) == wire.Status.OK
        bench.run(330)
    assert queue(stopped, x=hold(flags=HERE, enter=200), at_once=1) == wire.Status.OK
    begun = going.status().tick
    for bench in (stopped, going):
        bench.run(400)
    begun -= going.samples[0].first_tick
    along = references(going)["x"][begun + 95 : begun + 106]
    assert along.min() < references(stopped)["x"][-1] < along.max()


def test_a_hold_follows_where_a_move_that_says_its_own_begin_ends():
    """No test saw the swing of such a move taken for its end."""
    bench = holding()
    a_to_b = wire.Segment(wire.PathKind.MOVE, 0, 3 * V, V, per(100), 0, 0, 0)
    assert queue(bench, x=move_to(V, 100)) == wire.Status.OK
    assert queue(bench, x=a_to_b) == wire.Status.OK
    for elsewhere in (3 * V, 6 * V, V):
        assert queue(bench, x=hold(elsewhere)) == wire.Status.BAD_VALUE
    assert queue(bench, x=hold(4 * V)) == wire.Status.OK


def test_start_enters_a_path_and_says_when_it_begins():
    bench = Bench()
    assert bench.set_axis(0, wire.Mode.OPEN) == wire.Status.OK
    assert bench.set_path(0, swing=4 * V, offset=V, ticks=1000) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, 0, 300, 300))
    bench.ok(wire.StreamStartRequest(wire.Channel.REFERENCE, 1, 1))
    bench.ok(wire.ArmRequest(0))
    first = bench.ok(wire.StartRequest(1)).first_tick
    bench.run(2000)
    reference = references(bench)["x"]
    from_first = reference[first - bench.samples[0].first_tick :]
    whole = V + 2 * V * (1 - np.cos(2 * np.pi * 5 / 5000 * np.arange(1000)))
    assert np.abs(from_first[:1000] - whole).max() < 2
    assert max(derivatives(from_first)) < V // 50
    assert max(derivatives(reference[first - bench.samples[0].first_tick - 300 :])) < V // 50


@pytest.mark.parametrize("rest_ticks", [0, 20_000])
def test_an_inverse_path_is_entered_from_the_voltage_at_which_the_axis_stands(rest_ticks):
    """With creep in the model it once began with a step of 190 codes, 60 mV."""
    bench = Bench()
    assert bench.upload(model(u_park_q24=5 * V)).status == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    bench.run(1000)
    bench.park()
    bench.run(rest_ticks)
    assert bench.set_axis(0, wire.Mode.INVERSE) == wire.Status.OK
    assert bench.set_path(0, path=wire.PathKind.HOLD, swing=0) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, HERE, 500, 0))
    bench.ok(wire.ArmRequest(0))
    before = int(bench.dac[-1, 0])
    bench.ok(wire.StartRequest(1))
    codes = bench.run(600)[:, 0].astype(int)
    assert before == 32768 + 5 * 3200
    assert np.abs(codes[:20] - before).max() < 100  # a join begins at rest
    assert np.abs(np.diff(codes, prepend=before)).max() < 40
    assert abs(codes[-1] - before) > 1000  # the sensor says that it stands elsewhere: there it went


@pytest.mark.parametrize(
    ("preview_q16", "whole"), [(0, 0), (1, 1), (1 << 16, 1), ((1 << 16) + 1, 2), (3 << 15, 2), (2 << 16, 2)]
)
def test_a_path_begins_no_sooner_than_its_inverse_can_look_ahead(preview_q16, whole):
    """By so many whole ticks, rounded up."""
    bench = Bench()
    assert bench.upload(model(preview_ticks_q16=preview_q16)).status == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.INVERSE) == wire.Status.OK
    assert bench.set_path(0, swing=20 * UM) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, 0, 50, 0))
    bench.ok(wire.ArmRequest(0))
    started = bench.ok(wire.StartRequest(1))
    assert started.first_tick - started.tick == 1 + 50 + whole


def test_on_target_needs_its_window_for_long_enough():
    bench = holding(mode=wire.Mode.PID, velocity=0, acceleration=0, jerk=0, window_q16=UM, window_ticks=100)
    bench.run(250)
    assert bench.ok(wire.WhereRequest()).on_target == 1
    assert queue(bench, x=move_to(bench.ok(wire.WhereRequest()).reference[0] + 5 * UM, 50)) == wire.Status.OK
    bench.run(100)  # the sensor's code stays where it was
    assert bench.ok(wire.WhereRequest()).on_target == 0


def test_gains_change_without_a_bump():
    bench = holding(mode=wire.Mode.PID)
    bench.run(100, adc=19_900)
    before = bench.run(1, adc=19_900)[0, 0]
    bench.firmware.write(bench.frame(wire.SetGainsRequest(0, V // 5, 1 << 20, 0, 0x7FFFFFFF)))
    after = bench.run(1, adc=19_900)[0, 0]
    assert abs(int(after) - int(before)) <= 2
    assert bench.status_of(wire.SetGainsRequest(0, -1, 0, 0, 1)) == wire.Status.BAD_VALUE


def test_joins_need_a_path_that_can_have_them(bench):
    assert bench.status_of(wire.SetJoinsRequest(0, 0, 10, 10)) == wire.Status.BAD_VALUE
    assert bench.set_axis(0) == wire.Status.OK
    assert bench.set_path(0) == wire.Status.OK
    assert (
        bench.status_of(wire.SetJoinsRequest(0, HERE, 10, 10)) == wire.Status.BAD_VALUE
    )  # a sine begins at its offset
    assert bench.status_of(wire.MotionRequest(0, 0, 0, 0, -1, 0)) == wire.Status.BAD_VALUE


# ---------------------------------------------------------------- a waveform that comes while the axis is held
def points_of(seed):
    return np.random.default_rng(seed).integers(0, 1 << 30, 1024, endpoint=True).astype("<i4").tobytes()


def send(bench, data, axis=0):
    """The statuses of a first chunk and of a commit, those between left out where it is refused."""
    first = bench.status_of(wire.WaveChunkRequest(axis, 0, data[:1024]))
    for at in range(1024, len(data), 1024):
        if first == wire.Status.OK:
            bench.ok(wire.WaveChunkRequest(axis, at // 4, data[at : at + 1024]))
    return first, bench.status_of(wire.WaveCommitRequest(axis, crc32(data)))


def wave_of(bench, axis=0):
    """Its points as they are read back; none of one that is incomplete."""
    region, data = wire.Region.WAVE_X + axis, b""
    while (reply := bench.ok(wire.SnapshotReadRequest(region, len(data), 1024))).data:
        data += reply.data
    return data


def wave(swing):
    """A point a tick."""
    return wire.Segment(wire.PathKind.WAVE, 0, swing, 0, 2**54, 0, 200, 200)


def test_a_waveform_is_taken_while_the_axis_holds_or_plays_something_else():
    bench = holding()
    bench.ok(wire.StreamStopRequest())
    bench.samples.clear()
    first_tick = bench.ok(wire.StreamStartRequest(wire.Channel.REFERENCE, 1, 1)).tick
    assert send(bench, points_of(1)) == (wire.Status.OK,) * 2
    assert wave_of(bench) == points_of(1)
    assert queue(bench, x=sine(V // 4, 0, 5, 0)) == wire.Status.OK
    bench.run(300)
    assert send(bench, points_of(2)) == (wire.Status.OK,) * 2
    begin = bench.firmware.tick + 10
    assert queue(bench, at_once=1, begin_tick=begin, x=wave(V // 8)) == wire.Status.OK
    bench.run(1000)
    played = np.frombuffer(points_of(2), "<i4")[:500] * (V // 8 / 2**30)
    first = references(bench)["x"][begin + 200 - first_tick :][:500]
    assert np.abs(first - played).max() <= 1


def test_points_of_a_waveform_that_is_played_queued_or_left_are_not_written_over():
    """Each is refused, and not a point has changed; once the axis holds it is taken."""
    bench = holding()
    assert send(bench, points_of(1)) == (wire.Status.OK,) * 2

    def is_kept():
        asked = wire.WaveChunkRequest(0, 0, points_of(2)[:1024]), wire.WaveCommitRequest(0, crc32(points_of(1)))
        return {bench.status_of(one) for one in asked} == {wire.Status.BUSY} and wave_of(bench) == points_of(1)

    assert queue(bench, begin_tick=bench.firmware.tick + 100, x=wave(V // 8)) == wire.Status.OK
    assert is_kept()  # it waits
    bench.run(400)
    assert is_kept()  # it is played
    assert send(bench, points_of(2), axis=1) == (wire.Status.OK,) * 2  # of another axis
    assert queue(bench, at_once=1, x=hold(flags=HERE, enter=200)) == wire.Status.OK
    bench.run(20)
    assert is_kept()  # it is left
    bench.run(200)
    assert send(bench, points_of(2)) == (wire.Status.OK,) * 2
    assert wave_of(bench) == points_of(2)


def test_an_incomplete_waveform_cannot_be_queued():
    bench = holding()
    assert send(bench, points_of(1)) == (wire.Status.OK,) * 2
    bench.ok(wire.WaveChunkRequest(0, 3, bytes(4)))
    assert queue(bench, x=wave(V // 8)) == wire.Status.BAD_VALUE
    assert wave_of(bench) == b""
