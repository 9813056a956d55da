"""What the device keeps of its own survives power cuts at every byte, and says so when it could not."""

import random
from dataclasses import replace
from zlib import crc32

import pytest
from device_bench import Bench, V
from hypothesis import given, settings
from hypothesis import strategies as st
from test_hard_limits import FREE, limits_set

from phaselead.device import wire

SECTOR, RECORD = 4096, 72
JOURNAL = 2 * SECTOR
"""Behind the models' slots."""
PLACES = SECTOR // RECORD
SPARE = 2000
"""More bytes than anything but an erase writes."""


def to_V(volts):
    return replace(FREE, dac_max=32768 + round(3200 * volts))


def limits_of(bench):
    reply = bench.ok(wire.LimitsReadRequest())
    return None if reply.limits_lost else reply.limits[0]


def started(flash):
    """A device that has come up, its start written."""
    bench = Bench(flash=flash)
    bench.run(3)
    return bench


def kept(bench):
    return bench.firmware.cells()


def with_limits(*volts, flash=None):
    bench = started(flash)
    for volt in volts:
        bench.ok(limits_set(to_V(volt)))
    return kept(bench)


def cut_set(flash, volts, at):
    bench = started(flash)
    bench.firmware.cut_power_after(at)
    status = bench.status_of(limits_set(to_V(volts)))
    assert status in (wire.Status.OK, wire.Status.FLASH_FAILED)
    return kept(bench), status == wire.Status.OK


def test_every_start_is_counted():
    flash = None
    for count in range(1, 2 * PLACES):  # round both sectors
        bench = started(flash)
        assert bench.ok(wire.FaultLogRequest()).power_cycle == count
        flash = kept(bench)


def test_the_first_start_of_all_writes_one_record_and_erases_nothing():
    """An erase takes a second."""
    assert started(None).firmware.flash()[1] == 1


@pytest.mark.parametrize("places", [1, PLACES - 3, PLACES - 2, PLACES - 1, PLACES, PLACES + 1])
def test_a_cut_at_any_byte_leaves_the_old_limits_or_the_new(places):
    """Around the end of a sector too, where everything is copied to the other one."""
    flash = with_limits(*[3] * places)
    for at in [*range(1, RECORD + 3), *range(RECORD + 3, SECTOR, 211), *range(SECTOR - 2, SECTOR + RECORD + 2)]:
        torn, acknowledged = cut_set(flash, 7, at)
        for _ in range(3):  # and it stays so
            bench = started(torn)
            found = limits_of(bench)
            assert found in ([to_V(7)] if acknowledged else [to_V(3), to_V(7)]), at
            bench.ok(wire.ArmRequest(0))
            bench.park()
            torn = kept(bench)


def test_a_cut_in_the_very_first_write_is_no_loss():
    for at in range(RECORD + 2):
        bench = Bench(hello=False)
        bench.firmware.cut_power_after(at)
        bench.run(3)
        bench = started(kept(bench))
        assert limits_of(bench) == FREE
        bench.ok(wire.ArmRequest(0))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_whatever_is_cut_in_a_row(seed):
    """Starts, faults and limits, power going at any byte: the last acknowledged, or one asked later. What a start
    finds is settled once its record is in flash; a start that could not write it says FLASH_ERROR."""
    chance, flash, possible = random.Random(seed), None, {FREE}
    for _ in range(40):
        bench = Bench(flash=flash, hello=False)
        if chance.random() < 0.5:
            bench.firmware.cut_power_after(chance.choice([chance.randrange(RECORD * 4), chance.randrange(2 * SECTOR)]))
        bench.ok(wire.HelloRequest())
        found = limits_of(bench)
        assert found in possible
        bench.run(3)
        if bench.status().fault != wire.Fault.FLASH_ERROR:
            possible = {found}
        for _ in range(chance.randrange(30)):
            if chance.random() < 0.3:
                bench.firmware.inject(wire.Fault.INTERLOCK)
                bench.run(4)
                bench.ask(wire.ClearFaultRequest())
                continue
            asked = to_V(chance.randrange(1, 10))
            status = bench.status_of(limits_set(asked))
            if status == wire.Status.OK:
                possible = {asked}
            elif status == wire.Status.FLASH_FAILED:
                possible.add(asked)
        flash = kept(bench)


@pytest.mark.parametrize("before", [1, PLACES - 6, PLACES - 5, PLACES - 4])
def test_limits_that_read_either_way_are_settled_by_the_first_start_that_can_write(before):
    """A record whose last byte is in doubt, and starts that are cut before they have written which one they read. At
    the end of a sector too, where what settles it is in the other one."""
    torn, acknowledged = cut_set(with_limits(*[3] * before), 7, RECORD)
    assert not acknowledged
    seen = set()
    for _ in range(300):  # a start in some twenty reads it as whole
        cut = Bench(flash=torn, hello=False)
        cut.firmware.cut_power_after(0)
        cut.ok(wire.HelloRequest())
        found = limits_of(cut)
        assert found in (to_V(3), to_V(7))
        seen.add(found.dac_max)
        cut.run(3)
        assert cut.status().fault == wire.Fault.FLASH_ERROR
        torn = kept(cut)
        settled = started(torn)
        for _ in range(3):
            again = started(kept(settled))
            assert limits_of(again) == limits_of(settled)
            settled = again
    assert len(seen) == 2


@pytest.mark.parametrize("ahead", [1, 2, PLACES, PLACES + 20])
def test_what_a_start_left_half_written_elsewhere_does_not_come_back(ahead):
    """In the other sector, where it went because its own did not take it: whole only after limits that are newer."""
    flash = bytearray(with_limits(7, 3))
    places = [flash[at : at + RECORD] for at in range(JOURNAL, JOURNAL + SECTOR, RECORD)]
    with_seven = next(one for one in places if wire.DeviceRecord.unpack(bytes(one[:-4])).limits[0] == to_V(7))
    newest = max(int.from_bytes(one[4:8], "little") for one in places if one[:1] != b"\xff")
    torn = bytearray(with_seven)
    torn[4:8] = (newest + ahead).to_bytes(4, "little")
    torn[-4:] = crc32(bytes(torn[:-4])).to_bytes(4, "little")
    other = JOURNAL + SECTOR
    flash[other : other + RECORD] = torn[:-1] + bytes([torn[-1] ^ 1])
    bench = started(bytes(flash))
    assert limits_of(bench) == to_V(3)
    bench.ok(limits_set(to_V(5)))
    later = bytearray(kept(bench))
    later[other : other + RECORD] = torn
    assert limits_of(started(bytes(later))) == to_V(5)


def marginal(image, at, chance):
    """Bits of the record under way that read either way."""
    noisy = bytearray(image)
    for place in range(at, at + RECORD):
        noisy[place] |= chance.getrandbits(8) & chance.getrandbits(8)
    return bytes(noisy)


def test_a_write_that_was_cut_and_reads_either_way():
    """Blank at one start, half written at the next: the place is passed over, and nothing is lost."""
    chance = random.Random(5)
    flash = with_limits(3)
    for at in range(2, RECORD, 3):  # of the first byte nothing is certain yet
        torn, _ = cut_set(flash, 7, at)
        began = kept(started(flash))
        place = JOURNAL + next(
            i for i in range(0, SECTOR, RECORD) if torn[JOURNAL + i :][:RECORD] != began[JOURNAL + i :][:RECORD]
        )
        blank = torn[:place] + b"\xff" * RECORD + torn[place + RECORD :]
        bench = started(blank)
        bench.ok(limits_set(to_V(5)))
        after = bytearray(kept(bench))
        assert after[place : place + RECORD] == b"\xff" * RECORD
        after[place : place + RECORD] = torn[place : place + RECORD]
        assert limits_of(started(marginal(bytes(after), place, chance))) == to_V(5)


@pytest.mark.parametrize("volts", [(), (3,), tuple([3] * PLACES)])
def test_one_damaged_record_costs_no_more_than_itself(volts):
    flash = with_limits(*volts, 7)
    for at in range(JOURNAL, JOURNAL + 2 * SECTOR, 97):
        damaged = bytearray(flash)
        damaged[at] ^= 0x10
        assert limits_of(Bench(flash=bytes(damaged))) in [to_V(7), *map(to_V, volts[-1:]), FREE][: 2 if volts else 3]


def test_limits_that_cannot_be_read_any_more_bar_arming():
    flash = with_limits(3, 7)
    wrecked = bytearray(flash)
    for at in range(JOURNAL, JOURNAL + SECTOR, RECORD):
        wrecked[at] = 0
    flash = bytes(wrecked)
    for _ in range(3):  # not forgotten by a start
        bench = started(flash)
        assert limits_of(bench) is None
        assert bench.status_of(wire.ArmRequest(0)) == wire.Status.LIMITS_LOST
        flash = kept(bench)
    for at in (1, 60, 71, 100, 500):
        torn, _ = cut_set(flash, 2, at)
        assert limits_of(started(torn)) in (None, to_V(2))
    bench.ok(limits_set(to_V(2)))
    bench.ok(wire.ArmRequest(0))
    assert limits_of(started(kept(bench))) == to_V(2)


@pytest.mark.parametrize("sectors", [(0,), (1,), (0, 1)])
def test_that_they_are_lost_is_not_forgotten_by_a_cut(sectors):
    flash = bytearray(with_limits(3))
    flash[JOURNAL:] = b"\xff" * 2 * SECTOR
    for sector in sectors:
        at = JOURNAL + sector * SECTOR
        flash[at : at + 5 * RECORD] = b"\x5a" * 5 * RECORD
    for at in [*range(0, 2 * SECTOR, 301), *range(SECTOR - 1, SECTOR + RECORD + 1)]:
        bench = Bench(flash=bytes(flash), hello=False)
        bench.firmware.cut_power_after(at)
        bench.run(3)
        assert limits_of(started(kept(bench))) is None, at


def test_a_first_write_that_is_cut_twice_is_no_loss():
    bench = Bench(hello=False)
    bench.firmware.cut_power_after(30)
    bench.run(3)
    for at in [*range(0, SECTOR, 301), *range(SECTOR - 1, SECTOR + RECORD + 1)]:
        again = Bench(flash=kept(bench), hello=False)
        again.firmware.cut_power_after(at)
        again.run(3)
        assert limits_of(started(kept(again))) == FREE, at


@pytest.mark.parametrize("before", [1, 3, 2 * PLACES + 1, 2 * PLACES + 2, 2 * PLACES + 3, 4 * PLACES + 4])
def test_sequence_numbers_may_wrap(before):
    bench = started(None)
    image = bytearray(kept(bench))
    record = image[JOURNAL : JOURNAL + RECORD]
    record[4:8] = (2**32 - before).to_bytes(4, "little")
    record[-4:] = crc32(bytes(record[:-4])).to_bytes(4, "little")
    image[JOURNAL : JOURNAL + RECORD] = record
    flash = bytes(image)
    for volts in (2, 3, 4, 5):
        flash = with_limits(volts, flash=flash)
        assert limits_of(started(flash)) == to_V(volts)


def test_a_flash_that_cannot_be_written_is_a_fault_and_the_old_limits_hold():
    bench = Bench(flash=with_limits(3))
    bench.run(3)
    bench.firmware.cut_power_after(10)
    assert bench.status_of(limits_set(to_V(7))) == wire.Status.FLASH_FAILED
    assert bench.status().fault == wire.Fault.FLASH_ERROR
    assert limits_of(bench) == to_V(3)


def drive_into(bench, fault):
    bench.drive(swing=2 * V)
    bench.run(20)
    bench.firmware.inject(fault, 1)
    bench.run(1500)
    tick = bench.status().fault_tick
    bench.ok(wire.ParkRequest())
    bench.run(1000)
    bench.ok(wire.ClearFaultRequest())
    bench.run(5)
    return tick


def test_the_log_keeps_the_last_sixteen_over_resets():
    flash, expected = None, []
    faults = [wire.Fault.INTERLOCK, wire.Fault.TRACKING_ERROR, wire.Fault.CONVERTER_SILENT]
    for count in range(1, 26):
        bench = started(flash)
        fault = faults[count % 3]
        expected.append((count, drive_into(bench, fault), fault, 1, wire.State.RUNNING))
        flash = kept(bench)
        log = started(flash).ok(wire.FaultLogRequest())
        found = [(f.power_cycle, f.tick, f.fault, f.axis, f.state) for f in log.faults[: log.count]]
        assert found == expected[-16:]
        assert log.power_cycle == count + 1


def logged(bench):
    log = bench.ok(wire.FaultLogRequest())
    return [(fault.tick, fault.fault) for fault in log.faults[: log.count]]


def latch(bench, fault):
    """A fault of a parked device, cleared; tick and fault."""
    bench.firmware.inject(fault)
    bench.run(2)
    tick = bench.status().fault_tick
    bench.ok(wire.ClearFaultRequest())
    return tick, fault


FAULTS = (wire.Fault.INTERLOCK, wire.Fault.CONVERTER_SILENT, wire.Fault.TICK_OVERRUN)


def test_a_fault_that_is_there_twice_keeps_its_place_when_one_of_the_two_is_damaged():
    """A sector that is full stays, and its faults are copied to the other."""
    bench = started(None)
    faults = []
    for fault in FAULTS * 2:
        faults.append(latch(bench, fault))
        bench.run(3)
    for _ in range(PLACES):
        bench.ok(limits_set(to_V(3)))
    flash = kept(bench)
    for sector in range(2):
        for place in range(PLACES):
            damaged = bytearray(flash)
            damaged[JOURNAL + sector * SECTOR + place * RECORD + 40] ^= 0x10
            assert logged(started(bytes(damaged))) == faults, (sector, place)


def test_of_the_faults_that_cannot_be_written_yet_the_first_sixteen_are_kept():
    """As many as FAULT_LOG_WAITING of fault_log.h; nothing is written while it is recorded."""
    bench = started(None)
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    first = [latch(bench, fault) for fault in FAULTS * 6][:16]
    assert logged(bench) == first
    bench.run(300)
    assert logged(bench) == first
    assert logged(started(kept(bench))) == first


def test_a_lost_core_is_in_the_log():
    bench = started(None)
    bench.firmware.inject(wire.Fault.CORE_LOST)
    bench.run(5)
    bench.ok(wire.HelloRequest())
    log = bench.ok(wire.FaultLogRequest())
    assert (log.count, log.faults[0].fault, log.power_cycle, log.faults[0].power_cycle) == (
        1,
        wire.Fault.CORE_LOST,
        2,
        2,
    )


def test_the_log_waits_until_nothing_moves():
    """Writing would keep a ramp waiting."""
    bench = started(None)
    bench.drive(swing=8 * V)
    bench.run(300)
    writes = bench.firmware.flash()[1]
    bench.firmware.inject(wire.Fault.INTERLOCK)
    for _ in range(250):
        bench.run(1)
        assert bench.firmware.flash()[1] == writes
    bench.run(400)
    assert bench.firmware.flash()[1] > writes


def test_the_log_waits_until_nothing_is_recorded():
    """Writing takes ticks out of a stream."""
    bench = started(None)
    bench.drive(swing=8 * V)
    bench.run(100)
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    writes = bench.firmware.flash()[1]
    bench.firmware.inject(wire.Fault.INTERLOCK)
    for _ in range(248):
        bench.run(1)
        assert bench.firmware.flash()[1] == writes
    assert bench.dac[-1, 0] == 32768  # at rest for long, but the recorder goes on for 50 ms
    assert bench.ok(wire.FaultLogRequest()).count == 1  # it is told all the same
    bench.run(300)
    assert bench.firmware.flash()[1] > writes


def test_a_fault_that_holds_is_written_while_it_holds():
    bench = started(None)
    bench.drive(swing=8 * V)
    bench.run(300)
    bench.firmware.inject(wire.Fault.TRACKING_ERROR)
    bench.run(300)
    log = started(kept(bench)).ok(wire.FaultLogRequest())
    assert [fault.fault for fault in log.faults[: log.count]] == [wire.Fault.TRACKING_ERROR]
