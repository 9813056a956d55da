"""The recorder that is always on: what led to a trigger, to the tick, and what was not run shows as a gap."""

from dataclasses import dataclass

import numpy as np
import pytest
from device_bench import MID_CODE, Bench, V
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire

ENTRIES, AFTER = 400, 100
ENTRY = np.dtype(
    [("tick", "<u4"), ("axes", [("reference", "<i4"), ("adc", "<u2"), ("dac", "<u2"), ("ff", "<i2"), ("fb", "<i2")], 3)]
)


def arm(trigger, axis=0, channel=wire.Channel.ADC, falling=0, level=0, decimation=1, after=AFTER):
    return wire.TransientArmRequest(trigger, axis, channel, falling, level, decimation, after)


@dataclass
class Frozen:
    head: wire.TransientReadReply
    entries: np.ndarray


def pull(bench):
    data, head = b"", bench.ok(wire.TransientReadRequest(0, 1000))
    while len(data) < head.size:
        data += bench.ok(wire.TransientReadRequest(len(data), 1000)).data
    return Frozen(head, np.frombuffer(data, ENTRY))


def walk(bench, ticks, seed=1, up_to=40_000):
    """Runs against random codes; gives them."""
    codes = np.random.default_rng(seed).integers(20_000, up_to, (ticks, 3)).astype(np.uint16)
    bench.run(ticks, adc=codes)
    return codes


def test_without_any_word_a_fault_freezes_what_led_to_it():
    bench = Bench()
    bench.drive(swing=8 * V)
    first = len(bench.dac)
    codes = walk(bench, 700, up_to=36_000)
    bench.firmware.inject(wire.Fault.INTERLOCK, 1)
    after = walk(bench, 150, seed=2)
    frozen = pull(bench)
    fault_tick = bench.status().fault_tick
    assert (frozen.head.state, frozen.head.cause) == (wire.TransientState.FROZEN, wire.Trigger.FAULT)
    assert frozen.head.trigger_tick == fault_tick == first + 700
    ticks = frozen.entries["tick"]
    assert np.array_equal(ticks, np.arange(fault_tick + AFTER - ENTRIES + 1, fault_tick + AFTER + 1))
    every = np.concatenate([codes, after])
    assert np.array_equal(frozen.entries["axes"]["adc"], every[ticks - first])
    assert np.array_equal(frozen.entries["axes"]["dac"], bench.dac[ticks])
    assert frozen.head.modes[0] == wire.Mode.OPEN


def test_it_is_on_in_every_state_and_stays_frozen_until_it_is_armed_or_a_run_begins():
    bench = Bench()
    bench.run(50)
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(300)
    first = pull(bench)
    bench.ok(wire.ClearFaultRequest())
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(300)
    bench.ok(wire.ClearFaultRequest())
    assert pull(bench).head.trigger_tick == first.head.trigger_tick  # the first one counts
    bench.drive()
    assert bench.ok(wire.TransientReadRequest(0, 1000)).state == wire.TransientState.WAITING
    bench.park()
    bench.ok(arm(wire.Trigger.FAULT))
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(300)
    assert pull(bench).head.trigger_tick > first.head.trigger_tick


def test_before_it_is_frozen_there_is_nothing_to_read():
    bench = Bench()
    bench.run(100)
    reply = bench.ok(wire.TransientReadRequest(0, 1000))
    assert (reply.state, reply.size, reply.data) == (wire.TransientState.WAITING, 0, b"")


@settings(max_examples=40, deadline=None)
@given(
    axis=st.integers(0, 2),
    falling=st.integers(0, 1),
    level=st.integers(21_000, 39_000),
    after=st.integers(0, ENTRIES),
    decimation=st.integers(1, 7),
    seed=st.integers(0, 100),
)
def test_a_threshold_triggers_in_the_tick_that_crosses_it(axis, falling, level, after, decimation, seed):
    bench = Bench()
    bench.ok(arm(wire.Trigger.THRESHOLD, axis, wire.Channel.ADC, falling, level, decimation, after))
    first = len(bench.dac)
    codes = walk(bench, 300, seed).astype(int)
    bench.run(ENTRIES * decimation)
    now = codes[:, axis]
    before = np.concatenate([[MID_CODE], now[:-1]])  # the tick that the command took
    crossed = (before > level) & (now <= level) if falling else (before < level) & (now >= level)
    frozen = pull(bench)
    assert frozen.head.trigger_tick == first + int(np.flatnonzero(crossed)[0])
    assert frozen.head.cause == wire.Trigger.THRESHOLD
    ticks = frozen.entries["tick"].astype(int)
    assert (np.diff(ticks) == decimation).all()
    assert 0 <= (ticks > frozen.head.trigger_tick).sum() - after <= 1
    assert len(ticks) <= ENTRIES


@pytest.mark.parametrize("falling", [0, 1])
def test_to_reach_a_threshold_is_to_cross_it_and_to_leave_it_is_not(falling):
    """Random codes hardly ever are the level itself."""
    beyond = -1 if falling else 1
    bench = Bench()
    bench.run(len(bench.dac) % 2)
    bench.ok(arm(wire.Trigger.THRESHOLD, falling=falling, level=MID_CODE))  # which is what this tick sees
    bench.run(5, adc=MID_CODE + beyond)
    bench.run(5, adc=MID_CODE - beyond)
    reached = len(bench.dac)
    bench.run(200, adc=MID_CODE)
    assert pull(bench).head.trigger_tick == reached


@pytest.mark.parametrize(("channel", "level"), [(wire.Channel.DAC, 32768 + 3200), (wire.Channel.REFERENCE, V)])
def test_output_and_reference_have_thresholds_too(channel, level):
    bench = Bench()
    bench.ok(arm(wire.Trigger.THRESHOLD, 0, channel, 0, level))
    bench.drive(swing=8 * V)
    bench.run(800)
    frozen = pull(bench)
    at = int(np.flatnonzero(frozen.entries["tick"] == frozen.head.trigger_tick)[0])
    values = frozen.entries["axes"]["dac" if channel == wire.Channel.DAC else "reference"][:, 0].astype(int)
    assert values[at - 1] < level <= values[at]


def test_a_set_point_triggers():
    bench = Bench()
    bench.ok(arm(wire.Trigger.SET_POINT))
    bench.run(100)
    bench.drive()
    started = bench.ok(wire.StatusRequest()).tick
    bench.run(200)
    frozen = pull(bench)
    assert frozen.head.cause == wire.Trigger.SET_POINT
    assert 0 <= started - frozen.head.trigger_tick < 3


def test_a_path_out_of_the_queue_triggers_in_the_tick_in_which_it_begins():
    bench = Bench()
    bench.drive(path=wire.PathKind.HOLD, swing=0)
    bench.ok(arm(wire.Trigger.SET_POINT))
    move = wire.Segment(wire.PathKind.MOVE, wire.PathFlag.FROM_HERE, 4 * V, 0, 2**64 // 50, 0, 0, 0)
    begin = bench.status().tick + 150
    bench.ok(wire.QueueRequest(1, 0, begin, (move,) * 3))
    bench.run(400)
    frozen = pull(bench)
    assert (frozen.head.cause, frozen.head.trigger_tick) == (wire.Trigger.SET_POINT, begin)
    moved = frozen.entries["tick"][np.flatnonzero(np.diff(frozen.entries["axes"]["reference"][:, 0]))]
    assert moved[0] == begin  # its first value is the one that was held


def test_an_input_triggers_when_it_was_chosen_and_a_fault_in_any_case():
    for trigger, cause in ((wire.Trigger.INPUT, wire.Trigger.INPUT), (wire.Trigger.SET_POINT, wire.Trigger.FAULT)):
        bench = Bench()
        bench.ok(arm(trigger))
        bench.run(100)
        bench.firmware.inject(wire.Fault.INTERLOCK)
        bench.run(200)
        assert pull(bench).head.cause == cause


@pytest.mark.parametrize(
    "bad",
    [
        arm(9),
        arm(wire.Trigger.THRESHOLD, axis=3),
        arm(wire.Trigger.THRESHOLD, channel=wire.Channel.FEEDBACK),
        arm(wire.Trigger.FAULT, decimation=0),
        arm(wire.Trigger.FAULT, after=ENTRIES + 1),
        arm(wire.Trigger.FAULT, falling=2),
    ],
)
def test_what_makes_no_sense_is_refused(bad):
    assert Bench().status_of(bad) == wire.Status.BAD_VALUE


def test_a_read_beyond_the_end_is_refused():
    bench = Bench()
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(300)
    size = pull(bench).head.size
    assert bench.ok(wire.TransientReadRequest(size, 100)).data == b""
    assert bench.status_of(wire.TransientReadRequest(size + 1, 100)) == wire.Status.BAD_VALUE
    assert bench.status_of(wire.TransientReadRequest(0, 1150)) == wire.Status.BAD_VALUE
