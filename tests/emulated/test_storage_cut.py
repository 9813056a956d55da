"""The power cut in a save, in the ELF: a sample of what tests/app/test_storage_attack.py does to the same code."""

from zlib import crc32

import pytest
from storage_trial import trial
from talker import Talker, stage_model, upload

from phaselead.device import wire
from phaselead.sim.device import VirtualDevice
from phaselead.sim.emulated import BOOTLOADER_SIZE, Injection

SLOTS, SLOT_SIZES, HOST_SLOT = (0x10000, 0x60000), (0x10000, 0x20000), 4096
"""Sectors 4 and 7, from the beginning of flash, and where the same is in a simulated device."""
MARK, HEADER = 4, 16
LOADED, FALLBACK, PERSISTED = 1, 2, 4


def blob(number):
    changed = bytearray(stage_model())
    changed[4] ^= number  # another stage file's hash
    return bytes(changed)


@pytest.fixture(scope="module")
def saved(stage):
    """A simulated device's flash after three saves: the fourth goes to sector 7 and the fifth to sector 4."""
    flash = {}
    device = VirtualDevice(stage)
    talker = Talker(device)
    talker.ok(wire.HelloRequest())
    for number in range(1, 5):
        talker.ok(*upload(blob(number)), wire.ModelPersistRequest())
        flash[number] = device.flash()[0]
    device.close()
    return flash


def on_a_board(fresh, models):
    """A board's flash with a simulated device's models in it."""
    cells = bytearray(fresh)
    for slot, at in enumerate(SLOTS):
        record = models[slot * HOST_SLOT : (slot + 1) * HOST_SLOT]
        cells[at - BOOTLOADER_SIZE : at - BOOTLOADER_SIZE + len(record)] = record
    return bytes(cells)


def steps(erased):
    header = MARK + erased + wire.Model.SIZE
    return {"mark": 2, "erase": MARK + 99, "erased": MARK + erased, "blob": header - 700, "header": header + HEADER - 2}


@pytest.mark.parametrize("before", [3, 4])
@pytest.mark.parametrize("where", steps(0))
def test_the_model_before_is_loaded_and_flagged_until_the_next_save(start, saved, before, where):
    into = before % 2
    board = start(delays=False)
    board = start(flash=on_a_board(board.flash()[0], saved[before]), delays=False)
    talker = Talker(board)
    hello = talker.ok(wire.HelloRequest())
    assert (hello.model_flags, hello.model_crc) == (LOADED | PERSISTED, crc32(blob(before)))
    talker.ok(*upload(blob(9)))
    board.inject(Injection.FLASH_CUT, steps(SLOT_SIZES[into])[where])
    board.write(talker.frame(wire.ModelPersistRequest()))
    talker.run(6000)

    again = start(flash=board.flash()[0], delays=False)
    talker = Talker(again)
    hello = talker.ok(wire.HelloRequest())
    assert (hello.model_flags, hello.model_crc) == (LOADED | FALLBACK | PERSISTED, crc32(blob(before)))
    assert talker.ask(wire.ArmRequest(0)) == wire.Status.MUST_NAME_MODEL
    if where in ("mark", "header"):
        talker.ok(*upload(blob(10)))
        assert talker.ask(wire.ModelPersistRequest(), ticks=20_000).status == wire.Status.OK
        last = Talker(start(flash=again.flash()[0], delays=False)).ok(wire.HelloRequest())
        assert (last.model_flags, last.model_crc) == (LOADED | PERSISTED, crc32(blob(10)))


def test_some_saves_in_a_row_with_bits_that_read_either_way():
    """``make storage-trial`` does a thousand."""
    seen = trial(12, seed=3)
    assert seen["saves"] == 12
    assert seen["cuts"] >= 4
    assert seen["fallbacks"] >= 1
