"""The power is cut at every single byte of every save: what loads afterwards is the old model or the new one."""

from zlib import crc32

import pytest
from device_bench import Bench, model

from phaselead.device import wire

SLOT = 4096
MARK = 4
SAVE_BYTES = MARK + SLOT + wire.Model.SIZE + 16
"""Mark on the record before, erase, blob, header."""
LOADED, FALLBACK, PERSISTED = 1, 2, 4


def crc_of(hash_byte):
    return crc32(model(hash_byte).pack())


def saved(*hash_bytes, flash=None):
    """A flash image in which these models have been saved one after another."""
    for hash_byte in hash_bytes:
        bench = Bench(flash=flash)
        bench.upload(model(hash_byte))
        bench.ok(wire.ModelPersistRequest())
        flash = bench.firmware.cells()
    return flash


def boot(flash):
    bench = Bench(flash=flash, hello=False)
    return bench, bench.ok(wire.HelloRequest())


def cut_save(flash, hash_byte, at):
    """The image when the power goes at byte ``at`` of a save, and whether the save was acknowledged."""
    bench = Bench(flash=flash)
    bench.upload(model(hash_byte))
    bench.firmware.cut_power_after(at)
    status = bench.status_of(wire.ModelPersistRequest())
    assert status in (wire.Status.OK, wire.Status.FLASH_FAILED)
    return bench.firmware.cells(), status == wire.Status.OK


def test_an_erased_device_has_no_model():
    assert boot(None)[1].model_flags == 0


def test_the_newest_save_loads():
    flash = None
    for count in range(1, 6):
        flash = saved(count, flash=flash)
        bench, hello = boot(flash)
        assert (hello.model_flags, hello.model_crc) == (LOADED | PERSISTED, crc_of(count))
        assert bench.ok(wire.InfoRequest()).flash_sequence == count
        bench.ok(wire.ArmRequest(0))


@pytest.mark.parametrize("before", [(), (1,), (1, 2), (1, 2, 3)], ids=lambda before: f"{len(before)} saves before")
def test_a_save_cut_at_any_byte_leaves_the_old_or_the_new_model(before):
    flash, new = saved(*before), 99
    old = crc_of(before[-1]) if before else 0
    for at in (
        *range(0, SLOT - 20, 37),
        *range(SLOT - 20, SLOT + 40),
        *range(SLOT + 40, SAVE_BYTES - 40, 7),
        *range(SAVE_BYTES - 40, SAVE_BYTES + 2),
    ):  # around the ends of erase, header and record every byte
        torn, acknowledged = cut_save(flash, new, at)
        hello = boot(torn)[1]
        assert hello.model_crc in ({crc_of(new)} if acknowledged else {old, crc_of(new)}), at
        assert bool(hello.model_flags & LOADED) == (hello.model_crc != 0), at
        if hello.model_crc == old and before and at > MARK:
            assert hello.model_flags & FALLBACK, at  # this one is not what was asked for


def test_the_save_after_a_torn_one_heals():
    flash = saved(1, 2)
    for at in (1, 2800, SLOT, SLOT + 1500, SAVE_BYTES - 1):
        torn, _ = cut_save(flash, 9, at)
        healed = saved(5, flash=torn)
        assert boot(healed)[1].model_crc == crc_of(5)
        again, _ = cut_save(healed, 6, 1100)
        assert boot(again)[1].model_crc == crc_of(5)


def test_a_fallback_must_be_named_to_arm():
    torn, _ = cut_save(saved(1, 2), 3, 1300)
    bench, hello = boot(torn)
    assert hello.model_flags == LOADED | FALLBACK | PERSISTED
    assert bench.status_of(wire.ArmRequest(0)) == wire.Status.MUST_NAME_MODEL
    assert bench.status_of(wire.ArmRequest(crc_of(3))) == wire.Status.MUST_NAME_MODEL
    bench.ok(wire.ArmRequest(crc_of(2)))
    bench.park()
    bench.upload(model(4))
    bench.ok(wire.ArmRequest(0))


def test_saving_a_fallback_again_repairs_the_other_slot():
    torn, _ = cut_save(saved(1, 2), 3, 1300)
    for again in (False, True):
        bench, _ = boot(torn)
        if again:
            bench.upload(model(2))  # the same model, uploaded: still has to be saved
        bench.ok(wire.ModelPersistRequest())
        assert boot(bench.firmware.cells())[1].model_flags == LOADED | PERSISTED


def test_nothing_is_erased_for_what_is_there_already():
    bench, _ = boot(saved(1))
    writes = bench.firmware.flash()[1]
    assert bench.ok(wire.ModelPersistRequest()).sequence == 1
    assert bench.firmware.flash()[1] == writes


def test_saving_needs_a_model(bench):
    assert bench.status_of(wire.ModelPersistRequest()) == wire.Status.NO_MODEL


def test_a_failed_save_is_a_fault(bench):
    bench.upload(model())
    bench.firmware.cut_power_after(1200)
    assert bench.status_of(wire.ModelPersistRequest()) == wire.Status.FLASH_FAILED
    assert bench.status().fault == wire.Fault.FLASH_ERROR


@pytest.mark.parametrize("slot", [0, 1])
def test_a_damaged_record_is_never_taken(slot):
    flash = bytearray(saved(1, 2))
    for at in range(0, 16 + wire.Model.SIZE, 19):
        damaged = bytearray(flash)
        damaged[slot * SLOT + at] ^= 0x10
        hello = boot(bytes(damaged))[1]
        assert hello.model_crc == crc_of(1 if slot == 1 else 2)
        assert bool(hello.model_flags & FALLBACK) == (slot == 1)  # the older one may go bad: nothing is lost with it


def test_two_damaged_records_are_no_model():
    flash = bytearray(saved(1, 2))
    flash[100] ^= 1
    flash[SLOT + 100] ^= 1
    assert boot(bytes(flash))[1].model_flags == 0


@pytest.mark.parametrize("hits", [(100, SLOT + 100), (0, SLOT), (SLOT + 3,)])
def test_the_save_after_damage_to_both_leaves_no_false_flag(hits):
    """The other slot once still held its damaged record, and the newest model was called a fallback ever after."""
    flash = bytearray(saved(1, 2) if len(hits) == 2 else saved(1))
    for at in hits:
        flash[at] ^= 1
    if len(hits) == 1:
        flash[100] ^= 1
    assert boot(bytes(flash))[1].model_flags == 0
    for count in (3, 4, 5):
        flash = saved(count, flash=bytes(flash))
        _, hello = boot(flash)
        assert (hello.model_flags, hello.model_crc) == (LOADED | PERSISTED, crc_of(count))


def test_a_cut_in_the_save_after_damage_to_both_is_no_model_or_the_new_one():
    flash = bytearray(saved(1, 2))
    flash[100] ^= 1
    flash[SLOT + 100] ^= 1
    for at in (1, 500, SLOT - 1, SLOT, SLOT + 1, 2 * SLOT - 1, 2 * SLOT, 2 * SLOT + 900, SLOT + SAVE_BYTES - 1):
        torn, acknowledged = cut_save(bytes(flash), 9, at)
        hello = boot(torn)[1]
        assert hello.model_crc in ({crc_of(9)} if acknowledged else {0, crc_of(9)}), at
        assert hello.model_flags in (0, LOADED | PERSISTED), at


def test_sequence_numbers_may_wrap():
    flash = bytearray(saved(1, 2))
    for slot, sequence in ((0, 2**32 - 2), (1, 2**32 - 1)):
        at = slot * SLOT
        blob = bytes(flash[at + 16 : at + 16 + wire.Model.SIZE])
        head = sequence.to_bytes(4, "little") + wire.Model.SIZE.to_bytes(4, "little")
        flash[at + 4 : at + 12] = head
        flash[at + 12 : at + 16] = crc32(head + blob).to_bytes(4, "little")
    assert boot(bytes(flash))[1].model_crc == crc_of(2)
    flash = saved(3, flash=bytes(flash))
    assert boot(flash)[1].model_crc == crc_of(3)
    assert boot(saved(4, flash=flash))[1].model_crc == crc_of(4)
