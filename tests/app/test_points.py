"""Paths whose points come while they are played: a table's very bits, and whatever the host does, no kick."""

from zlib import crc32

import numpy as np
import pytest
from device_bench import MID_CODE, UM, Bench, V, model
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.stream import decode_samples

RING = 1024
ONE = 1 << 30
PIECE = 90
HERE = wire.PathFlag.FROM_HERE


def step_of(log2):
    return 2**54 >> log2


def sent(numbers):
    return np.asarray(numbers, "<i4").tobytes()


class Source:
    """Shares of the swing in q30 by the number of their point, sent piece by piece."""

    def __init__(self, bench, shares, *, first, log2=0, axes=1, length_ticks=0, steepest=ONE):
        self.bench, self.shares, self.first, self.next = bench, shares, first, first
        self.axes, self.length_ticks = axes, length_ticks
        self.begun = bench.status_of(wire.PointsBeginRequest(2**axes - 1, log2, first, (steepest,) * 3))
        self.reply = None

    def put(self, count):
        """The reply's status."""
        numbers = range(self.next, self.next + count)
        data = b"".join(sent([self.shares(axis, n) for n in numbers]) for axis in range(self.axes))
        request = wire.PointsRequest(2**self.axes - 1, self.next, self.length_ticks, data)
        self.reply = self.bench.ask(request)
        if self.reply.status == wire.Status.OK:
            self.next += count
        return wire.Status(self.reply.status)

    def fill(self, upto):
        while self.next < upto:
            assert self.put(min(PIECE, upto - self.next)) == wire.Status.OK


def wave(points):
    return lambda _axis, n: int(points[n % len(points)])


def waves(points):
    """One of its own for each axis."""
    return lambda axis, n: int(points[axis][n % len(points[axis])])


def begin(bench, *, mode=wire.Mode.OPEN, unit=V, log2=0, axes=1, enter=100, leave=100, swing=4, offset=1, ticks=0):
    """Path and joins, armed and started; the recorder runs from before."""
    for axis in range(axes):
        path = wire.PathKind.WAVE
        status = bench.set_path(axis, path, swing * unit, offset * unit, step_of(log2), ticks)
        assert status == wire.Status.OK
        assert bench.status_of(wire.SetJoinsRequest(axis, 0, enter, leave)) == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.run(-bench.firmware.tick % 3 + 3)
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(wire.Channel.REFERENCE | wire.Channel.DAC, 2**axes - 1, 1))
    return bench.ok(wire.StartRequest(2**axes - 1)).first_tick


class Alive(Bench):
    """Its sensor never gives one code for long, which a loop would call frozen."""

    def run(self, ticks=1, adc=None):
        moving = MID_CODE + (self.firmware.tick + np.arange(ticks))[:, None] % 3
        return super().run(ticks, moving if adc is None else adc)


def ready(mode=wire.Mode.OPEN, axes=1):
    bench = Alive()
    if mode != wire.Mode.OPEN:
        assert bench.upload(model()).status == wire.Status.OK
    for axis in range(axes):
        gains = {"kp": V // 500} if "PID" in mode.name else {}
        assert bench.set_axis(axis, mode, **gains) == wire.Status.OK
    return bench


def recorded(bench):
    stopped = bench.ok(wire.StreamStopRequest())
    bench.run(10)
    head = bytes(wire.HEADER.size)
    return decode_samples([head + batch.pack() for batch in bench.samples], 0, stopped.sent_ticks).axes


def smooth(seed, length=RING):
    """A random path that closes after so many points, 0 .. 2^30."""
    rng = np.random.default_rng(seed)
    turns, most = np.arange(length) / length, 8 * length // RING
    path = sum(rng.normal() / n**2 * np.sin(2 * np.pi * (n * turns + rng.uniform())) for n in range(1, most))
    return np.rint((path - path.min()) / np.ptp(path) * ONE).astype(np.int64)


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 3),
    st.sampled_from([wire.Mode.OPEN, wire.Mode.PID, wire.Mode.INVERSE, wire.Mode.INVERSE_PID]),
    st.integers(1, 200),
    st.integers(1, 3),
)
def test_a_path_that_comes_in_points_is_the_table_bit_for_bit(seed, log2, mode, enter, axes):
    """Reference and DAC code, the joins at both ends included; each axis has points of its own."""
    points, ticks = [np.roll(smooth(seed), 100 * axis) for axis in range(axes)], 1500
    needed = (ticks + 120 >> log2) + 3
    unit = V if mode == wire.Mode.OPEN else 8 * UM

    def run(streamed):
        bench = ready(mode, axes)
        if streamed:
            source = Source(bench, waves(points), first=-enter // 2**log2, log2=log2, axes=axes)
            source.length_ticks = ticks
            source.fill(min(source.first + RING, needed))
        else:
            for axis in range(axes):
                for at in range(0, RING, 256):
                    bench.ok(wire.WaveChunkRequest(axis, at, sent(points[axis][at : at + 256])))
                bench.ok(wire.WaveCommitRequest(axis, crc32(sent(points[axis]))))
        begin(bench, mode=mode, unit=unit, log2=log2, axes=axes, enter=enter, ticks=0 if streamed else ticks)
        ran = 0
        while ran < ticks + 800:
            if streamed and source.next < needed:
                assert source.put(min(PIECE, needed - source.next)) in (wire.Status.OK, wire.Status.BUSY)
                ran += 1
            bench.run(37)
            ran += 37
        return recorded(bench)

    table, ring = run(False), run(True)
    for axis in table:
        n = min(len(table[axis].reference), len(ring[axis].reference))
        assert n > ticks
        assert np.array_equal(table[axis].reference[:n], ring[axis].reference[:n])
        assert np.array_equal(table[axis].dac[:n], ring[axis].dac[:n])


stalls = st.lists(st.tuples(st.integers(1, 120), st.integers(0, 500)), max_size=12)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 2**32 - 1), st.integers(0, 2), stalls, st.integers(60, 150), st.booleans())
@example(0, 1, [(1, 0)] * 4 + [(69, 0)] + [(120, 0)] * 5, 60, False)  # the ring is full when its path ends
def test_a_host_that_stalls_anywhere_stops_it_without_a_kick(seed, log2, asked, leave, ends):
    """Pieces of any size, pauses of any length. Neither speed nor its change is ever above what path and joins
    may have by motion_bounds.h; a path that runs out of points says so and holds; one that does not, does not."""
    points, bench = smooth(seed, 4 * RING), ready()  # of a ring the points before are no good
    length = 700 if ends else 0
    source = Source(bench, wave(points), first=-(100 >> log2) - 1, log2=log2, length_ticks=length)
    source.fill(300)
    begin(bench, log2=log2, enter=100, leave=leave)
    for count, pause in asked:
        status = source.put(count)
        assert status in (wire.Status.OK, wire.Status.BUSY, wire.Status.WRONG_STATE)
        bench.run(1 + pause)
    bench.run(1500 << log2)
    where = bench.ok(wire.WhereRequest())
    played = length and (source.next - 2 << log2) - leave - 4 >= length
    assert (where.moving, where.dry) == (0, 0 if played else 1)
    assert source.put(1) == wire.Status.WRONG_STATE
    reference = recorded(bench)["x"].reference.astype(np.int64)[4:]  # what was asked before the start is not driven
    swing, own = 4 * V, np.abs(np.diff(points, append=points[:1])).max() / ONE / 2**log2
    bend = np.abs(np.diff(points, 2)).max() / ONE / 2**log2
    velocity = [own + 15 / 8 * 1.3 / join for join in (100, leave)]
    acceleration = [bend + 2 * 15 / 8 * own / join + 10 / 3**0.5 * 1.3 / join**2 for join in (100, leave)]
    assert np.abs(np.diff(reference)).max() <= swing * max(velocity) + 4
    assert np.abs(np.diff(reference, 2)).max() <= swing * max(acceleration) + 8


@pytest.mark.parametrize("axes", [2, 3])
def test_axes_that_run_dry_stop_in_the_same_tick(axes):
    points, bench = smooth(1), ready(axes=axes)
    source = Source(bench, wave(points), first=-101, axes=axes)
    source.fill(200)
    begin(bench, axes=axes)
    bench.run(1000)
    where = bench.ok(wire.WhereRequest())
    assert where.dry == 2**axes - 1
    assert len(set(where.dry_ticks[:axes])) == 1
    assert where.dry_ticks[0] > 0


def test_a_path_that_ran_dry_is_joined_again_where_it_stopped():
    """With a new ring, from the hold, without a stop of the device."""
    points, bench = smooth(3, 4 * RING), ready()
    source = Source(bench, wave(points), first=-101)
    source.fill(400)
    begin(bench)
    bench.run(1000)
    stopped = bench.ok(wire.WhereRequest())
    assert (stopped.dry, stopped.moving) == (1, 0)
    again = Source(bench, lambda _axis, n: int(points[n + 350]), first=-101, length_ticks=300)
    assert again.begun == wire.Status.OK
    again.fill(600)
    path = wire.Segment(wire.PathKind.WAVE, 0, 4 * V, V, step_of(0), 0, 100, 100)
    nothing = wire.Segment(wire.PathKind.HOLD, 0, 0, 0, 0, 0, 0, 0)
    assert bench.status_of(wire.QueueRequest(1, 0, 0, (path, nothing, nothing))) == wire.Status.OK
    bench.run(1000)
    where = bench.ok(wire.WhereRequest())
    assert (where.dry, where.moving) == (0, 0)
    reference = recorded(bench)["x"].reference.astype(np.int64)[4:]
    assert np.abs(np.diff(reference)).max() < 5 * V * (2 / 100 + 0.03)
    asked = V + np.rint(4 * V * (points[350 : 350 + 300] / ONE)).astype(np.int64)
    plain = [np.abs(reference[at : at + 300] - asked).max() for at in range(len(reference) - 300)]
    assert min(plain) <= 1


def test_what_is_refused_moves_nothing():
    bench, ok, bad = ready(), wire.Status.OK, wire.Status.BAD_VALUE
    begun = lambda *asked: bench.status_of(wire.PointsBeginRequest(*asked, (ONE // 100,) * 3))  # noqa: E731
    put = lambda mask, first, values: bench.status_of(wire.PointsRequest(mask, first, 0, sent(values)))  # noqa: E731
    assert put(1, 0, [0]) == bad  # no ring
    assert [begun(0, 0, 0), begun(8, 0, 0), begun(1, 9, 0), begun(1, 0, 1), begun(1, 0, -1025)] == [bad] * 5
    assert begun(1, 1, -50) == ok
    assert bench.set_path(0, wire.PathKind.WAVE, 4 * V, V, step_of(1), 0) == bad  # nothing to play yet
    assert put(1, 0, [0]) == bad  # not the next ones
    assert put(1, -50, [-1]) == put(1, -50, [ONE + 1]) == put(1, -50, [0, ONE // 99]) == put(2, -50, [0]) == bad
    assert put(3, -50, [0, 0]) == bad  # y has none
    assert put(1, -50, [0] * 250) == ok
    assert put(1, 200, [ONE // 50]) == bad  # too far from the one before
    assert bench.set_path(0, wire.PathKind.WAVE, 4 * V, V, step_of(0), 0) == bad  # another rate
    assert bench.set_path(0, wire.PathKind.WAVE, 12 * V, V, step_of(1), 0) == wire.Status.OUTSIDE_LIMITS
    assert bench.set_path(0, wire.PathKind.WAVE, 4 * V, V, step_of(1), 0) == ok
    assert bench.status_of(wire.SetJoinsRequest(0, 0, 101, 0)) == bad  # no points for so long a join
    assert bench.status_of(wire.SetJoinsRequest(0, 0, 100, 397)) == bad  # nor for this one out of it
    assert bench.status_of(wire.SetJoinsRequest(0, 0, 100, 100)) == ok
    assert bench.set_path(0, wire.PathKind.WAVE, 4 * V, V, step_of(1), 0) == bad  # they are taken
    for piece in range(3):
        assert put(1, 200 + 250 * piece, [0] * 250) == ok
    assert put(1, 950, [0] * 25) == wire.Status.BUSY  # one too many
    assert put(1, 950, [0] * 24) == ok
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    bench.run(10)
    assert begun(1, 0, 0) == wire.Status.BUSY
    assert (bench.dac == bench.dac[0]).all(0)[1:].all()


def test_a_piece_goes_on_from_the_last_point_of_the_one_before():
    """From there, and not from what lies in the ring behind it, it may be as steep as was said."""
    bench, most = ready(), ONE // 100
    put = lambda first, values: bench.status_of(wire.PointsRequest(1, first, 0, sent(values)))  # noqa: E731
    bench.ok(wire.PointsBeginRequest(1, 0, -10, (most,) * 3))
    assert put(-10, [ONE // 2] * 10) == wire.Status.OK
    assert put(0, [ONE // 2 + most + 1]) == put(0, [ONE // 2 - most - 1]) == wire.Status.BAD_VALUE
    assert put(0, [ONE // 2 + most]) == wire.Status.OK
    assert put(1, [ONE // 2]) == wire.Status.OK


@pytest.mark.parametrize("mode", [wire.Mode.FF, wire.Mode.FF_PID])
def test_tables_do_not_know_such_a_path(mode):
    bench = ready(mode)
    Source(bench, wave(smooth(1)), first=-10).fill(300)
    assert bench.set_path(0, wire.PathKind.WAVE, 8 * UM, 8 * UM, step_of(0), 0) in (
        wire.Status.MODE_UNSUPPORTED,
        wire.Status.OUTSIDE_RECTANGLE,
    )


def test_it_is_left_no_later_than_its_points_suffice_for():
    """A longer join than its own is refused, and what is to follow waits until its end is known."""
    points, bench = smooth(5), ready()
    source = Source(bench, wave(points), first=-101)
    source.fill(500)
    begin(bench)
    bench.run(150)
    nothing = wire.Segment(wire.PathKind.HOLD, 0, 0, 0, 0, 0, 0, 0)

    def follow(join, at_once):
        hold = wire.Segment(wire.PathKind.HOLD, HERE, 0, 0, 0, 0, join, 0)
        return bench.status_of(wire.QueueRequest(1, at_once, 0, (hold, nothing, nothing)))

    assert follow(101, 1) == wire.Status.BAD_VALUE
    assert follow(100, 0) == wire.Status.WRONG_STATE
    assert follow(100, 1) == wire.Status.OK
    assert source.put(1) in (wire.Status.OK, wire.Status.WRONG_STATE)
    bench.run(300)
    where = bench.ok(wire.WhereRequest())
    assert (where.moving, where.dry) == (0, 0)
    assert source.put(1) == wire.Status.WRONG_STATE
