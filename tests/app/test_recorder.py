"""The recorder: every tick is either in a batch or counted as dropped."""

import numpy as np
import pytest
from device_bench import Bench, V
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.sim.device import VirtualDevice, load_library
from phaselead.sim.plant import built_in, plant_parameters

ALL = 31
TICK_SIZES = {1: 4, 2: 2, 4: 2, 8: 2, 16: 2}
DATA_SIZE = 1152 - 20


def tick_size(channels, axis_mask):
    return bin(axis_mask).count("1") * sum(size for bit, size in TICK_SIZES.items() if channels & bit)


def recorded_ticks(samples):
    ticks = []
    for batch in samples:
        count = len(batch.data) // tick_size(batch.channels, batch.axis_mask)
        ticks += range(batch.first_tick, batch.first_tick + count * batch.decimation, batch.decimation)
    return ticks


@settings(max_examples=40, deadline=None)
@given(
    channels=st.integers(1, 31), axis_mask=st.integers(1, 7), decimation=st.integers(1, 700), ticks=st.integers(1, 1500)
)
def test_every_chosen_tick_is_there_once(channels, axis_mask, decimation, ticks):
    bench = Bench()
    start = bench.ok(wire.StreamStartRequest(channels, axis_mask, decimation))
    bench.run(ticks)
    stop = bench.ok(wire.StreamStopRequest())
    bench.run(2)
    expected = list(range(start.tick, stop.tick, decimation))
    assert recorded_ticks(bench.samples) == expected
    assert (stop.sent_ticks, stop.dropped_ticks) == (len(expected), 0)
    assert [batch.sequence for batch in bench.samples] == list(range(len(bench.samples)))
    assert {(b.channels, b.axis_mask, b.decimation) for b in bench.samples} <= {(channels, axis_mask, decimation)}


def test_the_samples_are_what_the_converters_saw(bench):
    bench.drive(swing=8 * V)
    start = bench.ok(wire.StreamStartRequest(ALL, 5, 1)).tick
    adc = 30_000 + np.random.default_rng(3).integers(-8000, 8000, (500, 3))
    bench.run(500, adc)
    bench.ok(wire.StreamStopRequest())
    bench.run(1)
    one = np.dtype([("reference", "<i4"), ("adc", "<u2"), ("dac", "<u2"), ("ff", "<i2"), ("fb", "<i2")])
    ticks = np.frombuffer(b"".join(b.data for b in bench.samples), [("x", one), ("z", one)])
    assert np.array_equal(ticks["x"]["dac"], bench.dac[start : start + len(ticks), 0])
    assert np.array_equal(ticks["z"]["dac"], bench.dac[start : start + len(ticks), 2])
    assert np.array_equal(ticks["x"]["adc"][1:501], adc[:, 0])
    assert np.array_equal(ticks["z"]["adc"][1:501], adc[:, 2])
    assert abs(ticks["x"]["reference"] / 2**24 - ticks["x"]["ff"] / 2**11).max() < 2**-11
    assert not ticks["x"]["fb"].any()


@pytest.mark.parametrize("bad", [(0, 1, 1), (64, 1, 1), (1, 0, 1), (1, 8, 1), (1, 1, 0)])
def test_a_stream_the_line_cannot_name_is_refused(bench, bad):
    assert bench.status_of(wire.StreamStartRequest(*bad)) == wire.Status.BAD_VALUE


def test_everything_of_three_axes_fits_two_megabaud(bench):
    reply = bench.ok(wire.StreamStartRequest(ALL, 7, 1))
    assert 36 * 5000 < reply.bytes_per_s < reply.budget_bytes_per_s < 200_000


def test_a_stream_beyond_the_line_is_refused_with_the_arithmetic():
    bench = Bench(baud=115_200)
    reply = bench.ask(wire.StreamStartRequest(ALL, 1, 1))
    assert reply.status == wire.Status.BAUD_BUDGET
    assert reply.bytes_per_s > 12 * 5000 > reply.budget_bytes_per_s
    assert bench.ask(wire.StreamStartRequest(ALL, 1, 10)).status == wire.Status.OK


@pytest.mark.parametrize(("channels", "axis_mask", "decimation"), [(31, 7, 1), (4, 1, 1), (31, 1, 7), (2, 7, 400)])
def test_the_arithmetic_is_what_really_goes_over_the_line(channels, axis_mask, decimation):
    bench = Bench()
    promised = bench.ok(wire.StreamStartRequest(channels, axis_mask, decimation)).bytes_per_s
    bench.reader.received = 0
    for _ in range(10):
        bench.run(5_000)
    assert bench.reader.received == pytest.approx(promised * 10, rel=0.03)


class SlowReader:
    """A simulated device whose line nobody empties for a while."""

    def __init__(self):
        self.device = VirtualDevice(plant_parameters(built_in("xyz250")))
        self.bench = Bench(hello=False)
        self.bench.firmware = self.device  # the frames and their sorting are the same
        self.command(wire.HelloRequest())

    def command(self, request):
        self.bench.replies.clear()
        self.device.write(self.bench.frame(request))
        for _ in range(400):
            self.device.run(20)
            self.bench._sort()
            if self.bench.replies:
                return request.REPLY.unpack(self.bench.replies[0][wire.HEADER.size :])
        raise AssertionError("no reply")


def test_what_a_slow_reader_misses_is_counted_on_the_way():
    slow = SlowReader()
    start = slow.command(wire.StreamStartRequest(ALL, 7, 1))
    slow.device.run(60_000)  # 12 s: the adapter holds 5 s of it, the ring 0.17 s
    first_lot = list(slow.bench.samples)
    slow.bench._sort()
    slow.device.run(2_000)
    stop = slow.command(wire.StreamStopRequest())
    for _ in range(60):
        slow.device.run(500)
        slow.bench._sort()
    ticks = recorded_ticks(slow.bench.samples)
    assert stop.dropped_ticks > 1000
    assert len(ticks) == stop.sent_ticks
    assert stop.sent_ticks + stop.dropped_ticks == stop.tick - start.tick
    assert len(set(ticks)) == len(ticks)
    missing = set(range(start.tick, stop.tick)) - set(ticks)
    assert len(missing) == stop.dropped_ticks
    for batch in slow.bench.samples:  # each says how many were lost before it
        assert batch.dropped == sum(tick < batch.first_tick for tick in missing)
    assert any(event.kind == wire.EventKind.STREAM_OVERFLOW for event in slow.bench.events)
    assert len(first_lot) < len(slow.bench.samples)


def test_a_new_session_ends_the_old_stream(bench):
    bench.ok(wire.StreamStartRequest(ALL, 1, 1))
    bench.run(50)
    bench.session ^= 1
    bench.ok(wire.HelloRequest())
    bench.samples.clear()
    bench.run(500)
    assert bench.samples == []


def test_the_device_fits_the_smallest_board():
    assert load_library().host_device_size() <= 120 * 1024
