"""Firmware over the wire: received, put on trial, confirmed or given up; and the power cut at every byte of it.

A device in this process runs its own code whatever the image holds, but it starts as a bootloader would, with the same
code, and says the build id of the image that was chosen.
"""

import struct
from zlib import crc32

import pytest
from device_bench import Bench, V, model

from phaselead.device import wire

HEADER = struct.Struct("<5I24s20s")
MAGIC = 0x31494C50
SLOTS = (0x0802_0000, 0x0804_0000)
SLOT_SIZE, RECORD_SIZE, OWN_SIZE = 2048, 16384, 4 * 4096
CELLS = OWN_SIZE + 2 * SLOT_SIZE + RECORD_SIZE
IMAGE_SIZE = 0x200 + 40
TRIAL_TICKS, RESTART_TICKS, ATTEMPTS = 50_000, 100, 3
OLD, NEW, NEWER = (bytes([digit]) * 20 for digit in (0x11, 0x22, 0x33))
CONFIRMED, TRIAL, ROLLED_BACK = wire.UpdateStanding


def image(build_id, slot, target=b"host", size=IMAGE_SIZE, **header):
    body = bytes((i * 7 + build_id[0]) & 0xFF for i in range(size - HEADER.size))
    fields = {"magic": MAGIC, "crc": 0, "length": size, "address": SLOTS[slot], "version": 256} | header
    head = HEADER.pack(*fields.values(), target, build_id)
    crc = header.get("crc", crc32(head[8:] + body))
    return head[:4] + struct.pack("<I", crc) + head[8:] + body


def entry(kind, slot, image_crc=0):
    head = struct.pack("<3I", 0x4C42_0000 | kind << 8 | slot, image_crc, 0)
    return head + struct.pack("<I", crc32(head))


def flashed(*, a=b"", b=b"", record=b""):
    """Cells of a device with these images and entries, none in doubt."""
    cells = b"\xff" * OWN_SIZE + a.ljust(SLOT_SIZE, b"\xff") + b.ljust(SLOT_SIZE, b"\xff")
    return (cells + record.ljust(RECORD_SIZE, b"\xff")).ljust(2 * CELLS, b"\0") + struct.pack("<I", 1)


def factory():
    """As a debugger leaves it."""
    return flashed(a=image(OLD, 0), record=entry(3, 0) * 2)


def boot(cells):
    return Bench(flash=cells, hello=False)


def running(bench):
    """The build id that it says it is."""
    return bench.ok(wire.HelloRequest()).build_id


def info(bench):
    return bench.ok(wire.UpdateInfoRequest())


def steps(new, chunk=200):
    """The commands of an update, up to the restart."""
    yield wire.UpdateBeginRequest(new[: HEADER.size])
    for at in range(HEADER.size, len(new), chunk):
        yield wire.UpdateChunkRequest(at, new[at : at + chunk])
    yield wire.UpdateCommitRequest()


def receive(bench, new):
    for command in steps(new):
        bench.ok(command)


def restart(bench):
    bench.ok(wire.UpdateRestartRequest())
    bench.run(RESTART_TICKS + 1)


def updated(cells, build_id, slot):
    bench = boot(cells)
    bench.ok(wire.HelloRequest())
    receive(bench, image(build_id, slot))
    restart(bench)
    assert running(bench) == build_id
    assert bench.ok(wire.UpdateConfirmRequest(build_id))
    return bench.firmware.cells()


def test_a_debugger_leaves_an_image_that_is_confirmed():
    bench = boot(factory())
    assert running(bench) == OLD
    said = info(bench)
    assert (said.slot, said.standing, said.free_address, said.slot_size) == (0, CONFIRMED, SLOTS[1], SLOT_SIZE)
    assert (said.version, said.trial_ticks, said.attempts) == (256, TRIAL_TICKS, ATTEMPTS)
    bench.ok(wire.ArmRequest(0))


def test_an_update_is_tried_and_confirmed():
    bench = boot(factory())
    assert running(bench) == OLD
    receive(bench, image(NEW, 1))
    assert running(bench) == OLD
    assert info(bench).standing == CONFIRMED
    restart(bench)
    hello = bench.ok(wire.HelloRequest())
    assert (hello.build_id, hello.reset_cause) == (NEW, wire.ResetCause.SOFTWARE)
    assert (info(bench).slot, info(bench).standing) == (1, TRIAL)
    assert bench.status_of(wire.ArmRequest(0)) == wire.Status.BUSY
    assert bench.status_of(wire.UpdateConfirmRequest(OLD)) == wire.Status.BAD_VALUE
    bench.ok(wire.UpdateConfirmRequest(NEW))
    assert info(bench).standing == CONFIRMED
    bench.ok(wire.ArmRequest(0))
    bench.park()
    bench.run(TRIAL_TICKS + 10)
    assert info(bench).standing == CONFIRMED
    again = boot(bench.firmware.cells())
    assert running(again) == NEW
    assert info(again).standing == CONFIRMED


def test_updates_go_from_slot_to_slot():
    cells = factory()
    for number in range(1, 9):
        cells = updated(cells, bytes([number]) * 20, number % 2)
    assert running(boot(cells)) == bytes([8]) * 20


def test_an_image_that_is_not_confirmed_is_given_up_after_three_starts():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    receive(bench, image(NEW, 1))
    restart(bench)
    for _ in range(ATTEMPTS):
        assert running(bench) == NEW
        bench.run(TRIAL_TICKS)
    assert running(bench) == OLD
    assert info(bench).standing == ROLLED_BACK
    bench.ok(wire.ArmRequest(0))
    bench.park()
    assert running(boot(bench.firmware.cells())) == OLD
    receive(bench, image(NEWER, 1))
    restart(bench)
    assert running(bench) == NEWER


def test_every_start_of_an_image_on_trial_counts():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    receive(bench, image(NEW, 1))
    cells = bench.firmware.cells()
    for _ in range(ATTEMPTS):
        bench = boot(cells)
        assert running(bench) == NEW
        cells = bench.firmware.cells()
    assert running(boot(cells)) == OLD


def test_an_image_that_is_damaged_is_not_started():
    whole = image(NEW, 1)
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    receive(bench, whole)
    cells = bytearray(bench.firmware.cells())
    for at in (*range(0, HEADER.size), HEADER.size + 100, IMAGE_SIZE - 1):
        damaged = bytearray(cells)
        damaged[OWN_SIZE + SLOT_SIZE + at] ^= 0x10
        assert running(boot(bytes(damaged))) == OLD, at


def test_any_whole_image_is_better_than_none():
    a, b = image(OLD, 0), image(NEW, 1)
    assert running(boot(flashed(b=b))) == NEW
    assert running(boot(flashed(a=a))) == OLD
    assert running(boot(flashed(a=a, b=b))) == OLD
    assert running(boot(flashed(a=a[:-1], b=b, record=entry(3, 0)))) == NEW
    assert running(boot(flashed(a=a, record=entry(3, 1)))) == OLD
    assert running(boot(flashed(a=a, b=b, record=entry(3, 1)))) == NEW
    assert running(boot(flashed(a=a, b=b, record=b"\0" * RECORD_SIZE))) == OLD
    assert running(boot(flashed(a=image(OLD, 1), b=b))) == NEW  # linked for the other slot


@pytest.mark.parametrize(
    "wrong",
    [
        {"target": b"generic_f405"},
        {"magic": MAGIC + 1},
        {"address": SLOTS[0]},
        {"length": SLOT_SIZE + 4},
        {"length": 0x200},
        {"length": IMAGE_SIZE + 1},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_an_image_that_does_not_belong_here_is_refused_before_anything_is_erased(wrong):
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    before = bench.firmware.cells()
    new = image(NEW, 1, **wrong)
    assert bench.status_of(wire.UpdateBeginRequest(new[: HEADER.size])) == wire.Status.BAD_VALUE
    assert bench.firmware.cells() == before


def test_an_image_with_another_crc_is_not_put_on_trial():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    *before, commit = steps(image(NEW, 1, crc=1))
    for command in before:
        bench.ok(command)
    assert bench.status_of(commit) == wire.Status.CRC_MISMATCH
    restart(bench)
    assert running(bench) == OLD


def test_chunks_belong_behind_the_header_and_inside_the_image():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    assert bench.status_of(wire.UpdateChunkRequest(64, b"x")) == wire.Status.WRONG_STATE
    assert bench.status_of(wire.UpdateCommitRequest()) == wire.Status.WRONG_STATE
    bench.ok(wire.UpdateBeginRequest(image(NEW, 1)[: HEADER.size]))
    for offset, size in ((0, 4), (63, 1), (IMAGE_SIZE - 3, 4), (2**32 - 1, 1), (IMAGE_SIZE + 4, 0)):
        assert bench.status_of(wire.UpdateChunkRequest(offset, bytes(size))) == wire.Status.BAD_VALUE
    bench.ok(wire.UpdateChunkRequest(IMAGE_SIZE - 4, bytes(4)))
    bench.ok(wire.UpdateChunkRequest(IMAGE_SIZE, b""))


def test_another_host_does_not_go_on_with_an_image_or_a_model():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.ok(wire.ModelBeginRequest(wire.Model.SIZE, 0))
    begin, chunk, *_, commit = steps(image(NEW, 1))
    for command in (begin, chunk):
        bench.ok(command)
    bench.session += 1
    bench.ok(wire.HelloRequest())
    for command in (chunk, commit, wire.ModelChunkRequest(0, b"1234"), wire.ModelCommitRequest()):
        assert bench.status_of(command) == wire.Status.WRONG_STATE


def test_nothing_is_updated_while_armed_or_running():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.drive()
    for command in (*steps(image(NEW, 1)), wire.UpdateRestartRequest()):
        assert bench.status_of(command) == wire.Status.WRONG_STATE
    bench.park()
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(next(steps(image(NEW, 1)))) == wire.Status.WRONG_STATE


def test_an_image_is_not_received_away_from_zero():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.upload(model(u_park_q24=V))
    begin, chunk, *_, commit = steps(image(NEW, 1))
    bench.ok(begin)
    bench.ok(wire.ArmRequest(0))
    bench.park()
    before = bench.firmware.cells()
    for command in (chunk, commit):
        assert bench.status_of(command) == wire.Status.WRONG_STATE
    assert bench.firmware.cells() == before


def test_an_output_that_is_not_at_zero_is_ramped_there_first(park_at_one_volt):
    bench = park_at_one_volt
    before = bench.dac[-1, 0]
    assert before != 32768
    begin = next(steps(image(NEW, 1)))
    assert bench.status_of(wire.UpdateRestartRequest()) == wire.Status.BUSY
    assert bench.status_of(begin) == wire.Status.BUSY
    codes = bench.run(400)[:, 0].astype(int)
    assert codes[-1] == 32768
    assert abs(codes[1:] - codes[:-1]).max() <= 33  # the ramp
    receive(bench, image(NEW, 1))
    restart(bench)
    assert running(bench) == NEW
    assert (bench.dac[-RESTART_TICKS - 100 :] == 32768).all()


@pytest.fixture
def park_at_one_volt():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.upload(model(u_park_q24=V))
    bench.ok(wire.ArmRequest(0))
    bench.park()
    return bench


def test_a_full_record_is_written_anew():
    record = (entry(3, 0) * 2).ljust(RECORD_SIZE - 31 * 16, b"\0")
    cells = flashed(a=image(OLD, 0), record=record)
    for number in range(1, 4):
        cells = updated(cells, bytes([number]) * 20, number % 2)
    assert running(boot(cells)) == bytes([3]) * 20
    start = OWN_SIZE + 2 * SLOT_SIZE
    assert cells[start : start + 32] == entry(3, 0) * 2  # what ran when it was erased


def test_a_record_without_a_single_place_left_is_written_anew():
    """Where the second entry of a confirmation finds no room."""
    record = entry(3, 0).ljust(RECORD_SIZE, b"\0")
    cells = updated(flashed(a=image(OLD, 0), record=record), NEW, 1)
    assert running(boot(cells)) == NEW


BLANK = b"\xff" * 16


@pytest.mark.parametrize(
    ("record", "runs"),
    [
        (entry(3, 0) + BLANK + entry(3, 1), NEW),  # a place that was barely begun reads as blank
        (entry(3, 0) + entry(3, 1)[:-1] + b"\0", OLD),
        (entry(3, 0) + b"\0" * 16 + entry(3, 1), NEW),
        (entry(3, 0) + entry(1, 1, 0), OLD),  # on trial was another image
        (entry(3, 0) + entry(9, 1), OLD),
        (entry(3, 0) + entry(3, 7), OLD),
    ],
)
def test_entries_that_are_none_say_nothing(record, runs):
    assert running(boot(flashed(a=image(OLD, 0), b=image(NEW, 1), record=record))) == runs


def record_of(bench):
    start = OWN_SIZE + 2 * SLOT_SIZE
    return bench.firmware.cells()[start : start + RECORD_SIZE]


def test_a_confirmation_is_written_twice_at_the_latest_at_the_next_start():
    bench = boot(flashed(a=image(OLD, 0), record=entry(3, 0)))
    assert record_of(bench)[:48] == entry(3, 0) * 2 + BLANK
    assert record_of(boot(bench.firmware.cells()))[:48] == entry(3, 0) * 2 + BLANK
    elsewhere = boot(flashed(a=image(OLD, 0), record=entry(3, 1)))  # another one is confirmed than that which runs
    assert record_of(elsewhere)[:32] == entry(3, 1) + BLANK


@pytest.mark.parametrize("seed", range(1, 9))
def test_a_place_that_does_not_take_an_entry_is_passed_over(seed):
    cells = bytearray(factory())
    cells[CELLS + OWN_SIZE + 2 * SLOT_SIZE + 32] = 1  # the next place's first bit reads either way
    cells[-4:] = seed.to_bytes(4, "little")
    bench = boot(bytes(cells))
    bench.ok(wire.HelloRequest())
    receive(bench, image(NEW, 1))


def test_an_image_on_trial_takes_no_update():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    receive(bench, image(NEW, 1))
    restart(bench)
    bench.ok(wire.HelloRequest())
    assert bench.status_of(next(steps(image(NEWER, 0)))) == wire.Status.WRONG_STATE
    bench.run(ATTEMPTS * TRIAL_TICKS)
    assert running(bench) == OLD


def test_a_device_that_is_about_to_restart_is_not_armed():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.ok(wire.UpdateRestartRequest())
    assert bench.status_of(wire.ArmRequest(0)) == wire.Status.BUSY
    bench.run(RESTART_TICKS)
    bench.ok(wire.HelloRequest())
    bench.ok(wire.ArmRequest(0))


def test_a_fault_is_no_hindrance_at_zero_and_one_that_holds_keeps_its_output():
    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.firmware.inject(wire.Fault.CONVERTER_SILENT)
    bench.run(2)
    assert bench.state == wire.State.FAULT
    receive(bench, image(NEW, 1))
    restart(bench)
    assert running(bench) == NEW

    bench = boot(factory())
    bench.ok(wire.HelloRequest())
    bench.drive()
    bench.run(100)
    bench.firmware.inject(wire.Fault.TRACKING_ERROR)
    bench.run(2)
    held = bench.dac[-1, 0]
    assert bench.state == wire.State.FAULT
    assert held != 32768
    for command in (next(steps(image(NEW, 1))), wire.UpdateRestartRequest()):
        assert bench.status_of(command) == wire.Status.WRONG_STATE
    assert (bench.run(200)[:, 0] == held).all()


def test_a_device_whose_image_slots_are_empty_runs_its_own_code_confirmed():
    bench = Bench()
    assert running(bench) != bytes(20)
    assert info(bench).standing == CONFIRMED
