"""Faults that wait to be written to flash when a reset comes."""

import random

import pytest
from device_bench import Bench, V
from test_own_records_journal import FAULTS, RECORD, kept, latch, logged, started

from phaselead.device import wire

WAITING = 16
"""FAULT_LOG_WAITING of fault_log.h."""
WORDS = 6
"""Of a fault there."""
WAY_HOME = 100
"""Ticks after a fault: outputs are still far from 0 V."""


def on_the_way_home(flash=None):
    """A device that met a fault while it ran; its tick."""
    bench = started(flash)
    bench.drive(swing=8 * V)
    bench.run(300)
    bench.firmware.inject(wire.Fault.INTERLOCK, 1)
    bench.run(WAY_HOME)
    assert bench.status().at_rest != 7
    return bench, bench.status().fault_tick


def with_many_waiting(count):
    """So many faults that wait: nothing is written while it is recorded."""
    bench = started(None)
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    return bench, [latch(bench, fault) for fault in (FAULTS * count)[:count]]


def after(bench):
    """Its log in flash, and nothing else of it: power was lost."""
    return Bench(flash=kept(bench)).ok(wire.FaultLogRequest())


def entries(log):
    return [(one.power_cycle, one.tick, one.fault, one.axis, one.state) for one in log.faults[: log.count]]


def test_a_reset_on_the_way_home_loses_no_fault():
    bench, tick = on_the_way_home()
    bench.firmware.reset()
    bench.run(1)
    assert entries(after(bench)) == [(1, tick, wire.Fault.INTERLOCK, 1, wire.State.RUNNING)]
    bench.ok(wire.HelloRequest())
    assert bench.ok(wire.FaultLogRequest()).power_cycle == 2


def test_a_watchdog_adds_its_own_to_the_one_that_waited():
    bench, tick = on_the_way_home()
    bench.firmware.inject(wire.Fault.CORE_LOST)
    bench.run(1)
    assert entries(after(bench)) == [
        (1, tick, wire.Fault.INTERLOCK, 1, wire.State.RUNNING),
        (2, 0, wire.Fault.CORE_LOST, 255, wire.State.PARKED),
    ]


def test_a_loss_of_power_loses_what_waited_and_nothing_else():
    bench, _ = on_the_way_home(kept(on_the_way_home()[0]))
    assert logged(Bench(flash=kept(bench))) == []


def test_all_that_waited_is_written_before_the_first_command():
    bench, faults = with_many_waiting(WAITING - 1)
    writes = bench.firmware.flash()[1]
    bench.firmware.reset()
    bench.run(1)
    assert bench.firmware.flash()[1] == writes + WAITING - 1
    assert logged(Bench(flash=kept(bench))) == faults


def test_the_newest_are_kept_where_one_more_comes_with_the_reset():
    bench, faults = with_many_waiting(WAITING)
    bench.firmware.inject(wire.Fault.CORE_LOST)
    bench.run(1)
    assert logged(Bench(flash=kept(bench))) == [*faults[1:], (0, wire.Fault.CORE_LOST)]


def test_what_is_read_is_the_newest_of_what_is_in_flash_and_what_waits():
    bench, faults = with_many_waiting(WAITING)
    bench.ok(wire.StreamStopRequest())
    bench.run(300)
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    for fault in FAULTS:
        faults.append(latch(bench, fault))
        assert logged(bench) == faults[-16:]


def test_starts_that_were_never_written_are_counted_apart():
    bench = started(None)
    for _ in range(3):
        bench.firmware.inject(wire.Fault.CORE_LOST)  # and again, before it could write
    bench.run(1)
    log = after(bench)
    assert [one.power_cycle for one in log.faults[: log.count]] == [2, 3, 4]
    assert log.power_cycle == 5


@pytest.mark.parametrize("cut", range(1, RECORD + 2))
def test_a_reset_in_the_middle_of_writing_neither_loses_nor_doubles_it(cut):
    """At every byte; after the last one the record is whole, and its fault waits all the same."""
    bench, tick = on_the_way_home()
    waiting = bench.firmware.kept_memory()
    bench.firmware.cut_power_after(cut)
    bench.run(1000)
    again = Bench(flash=kept(bench), hello=False)
    again.firmware.reset(waiting)
    again.ok(wire.HelloRequest())
    for _ in range(3):
        assert logged(again) == [(tick, wire.Fault.INTERLOCK)]
        again.firmware.reset()
        again.ok(wire.HelloRequest())
    assert logged(Bench(flash=kept(again))) == [(tick, wire.Fault.INTERLOCK)]


def test_what_was_written_does_not_come_back_from_memory():
    bench, faults = with_many_waiting(5)
    bench.ok(wire.StreamStopRequest())
    bench.run(300)
    for _ in range(3):
        bench.firmware.reset()
        bench.ok(wire.HelloRequest())
        assert logged(bench) == faults
    erased = Bench(hello=False)  # the journal is not what keeps it away
    erased.firmware.reset(bench.firmware.kept_memory())
    erased.ok(wire.HelloRequest())
    assert logged(erased) == []


def reset_with(memory):
    bench = Bench(hello=False)
    bench.firmware.reset(memory)
    bench.ok(wire.HelloRequest())
    return bench


def test_memory_that_forgot_is_no_fault():
    size, chance = len(Bench().firmware.kept_memory()), random.Random(3)
    contents = [bytes(size), b"\xff" * size, b"\xa5\x5a" * (size // 2)]
    for memory in [*contents, *(chance.randbytes(size) for _ in range(300))]:
        assert logged(reset_with(memory)) == []
    for number in range(WAITING + 1):  # counters that would fit
        memory = chance.randbytes(size - 8) + (number + 7).to_bytes(4, "little") + (7).to_bytes(4, "little")
        bench = reset_with(memory)
        assert logged(bench) == []
        assert bench.ok(wire.FaultLogRequest()).power_cycle == 1


def turned(memory, *bits):
    other = bytearray(memory)
    for bit in bits:
        other[bit // 8] ^= 1 << bit % 8
    return bytes(other)


def is_part(found, faults):
    """Some of them in their order, none twice."""
    left = iter(faults)
    return all(one in left for one in found)


def test_bits_that_turned_make_no_fault_that_never_was():
    bench, faults = with_many_waiting(4)
    memory, chance = bench.firmware.kept_memory(), random.Random(4)
    assert logged(reset_with(memory)) == faults
    size = 8 * len(memory)
    sets = [[bit] for bit in range(size)]
    sets += [[first, first + words * 32] for first in range(2 * WORDS * 32) for words in range(1, WORDS)]
    sets += [[chance.randrange(size) for _ in range(chance.randrange(2, 60))] for _ in range(500)]
    for bits in sets:
        found = logged(reset_with(turned(memory, *bits)))
        assert is_part(found, faults), bits


def test_bits_that_turned_bring_back_nothing_that_was_written():
    bench, faults = with_many_waiting(WAITING)
    bench.ok(wire.StreamStopRequest())
    bench.run(300)
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    faults += [latch(bench, wire.Fault.INTERLOCK), latch(bench, wire.Fault.TICK_OVERRUN)]
    flash, memory = kept(bench), bench.firmware.kept_memory()
    counted = [memory[:-4] + written.to_bytes(4, "little") for written in range(20)]
    for other in [*counted, *(turned(memory, bit) for bit in range(8 * len(memory)))]:
        again = Bench(flash=flash, hello=False)
        again.firmware.reset(other)
        again.ok(wire.HelloRequest())
        assert is_part(logged(again), faults), other
