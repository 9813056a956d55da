"""A thousand saves, most of them cut short: after an erase, between two bytes, within one. What was on its way reads
either way from then on, each time anew. The newest whole record loads, or the device says that a save was lost and is
armed by name alone; and once a save was acknowledged nothing of what went before is to be seen.

tests/emulated/test_storage_cut.py does a sample of it in the ELF.
"""

import random
from zlib import crc32

import pytest
from device_bench import Bench, model
from test_flash import FALLBACK, LOADED, MARK, PERSISTED, SAVE_BYTES, SLOT

from phaselead.device import wire

SAVES = 1000
SEEDS = 4
BLOBS = [model(number).pack() for number in range(8)]
CRCS = [crc32(blob) for blob in BLOBS]


def reseeded(cells, random_source):
    return cells[:-4] + random_source.getrandbits(31).to_bytes(4, "little")


def boot(cells, random_source):
    bench = Bench(flash=reseeded(cells, random_source), hello=False)
    return bench, bench.ok(wire.HelloRequest())


def where(random_source):
    """A byte at which the power goes, and None for never; around the steps' ends more often than elsewhere."""
    steps = (1, MARK, MARK + SLOT, MARK + SLOT + wire.Model.SIZE, SAVE_BYTES)
    near = [step + offset for step in steps for offset in range(-2, 6)]
    anywhere = random_source.randrange(1, SAVE_BYTES + SLOT)
    return random_source.choice([None, None, anywhere, random_source.choice(near), random_source.choice(near)])


class Expected:
    """What may load: the last save that was acknowledged, or one that was begun after it; and what was there before."""

    def __init__(self):
        self.acknowledged, self.begun = 0, set()
        self.earlier = set()

    def save(self, crc, acknowledged):
        if acknowledged:
            self.earlier |= {self.acknowledged} | self.begun
            self.acknowledged, self.begun = crc, set()
        else:
            self.begun.add(crc)

    def check(self, hello):
        crc, flags = hello.model_crc, hello.model_flags
        if crc == 0:
            assert flags == 0
            assert self.begun or self.acknowledged == 0
        elif flags & FALLBACK:
            assert flags == LOADED | FALLBACK | PERSISTED
            assert self.begun, "a false flag: nothing was lost"
            assert crc in self.earlier | self.begun | {self.acknowledged}
        else:
            assert flags == LOADED | PERSISTED
            assert crc in self.begun | {self.acknowledged}


@pytest.mark.parametrize("seed", range(SEEDS))
def test_the_newest_whole_record_loads_or_the_device_must_be_armed_by_name(seed):
    source = random.Random(seed)
    expected, cells, cuts, lost = Expected(), None, 0, 0
    for _ in range(SAVES // SEEDS):
        bench, hello = (Bench(), None) if cells is None else boot(cells, source)
        if hello is not None:
            expected.check(hello)
            lost += bool(hello.model_flags & FALLBACK)
            if hello.model_flags & FALLBACK:
                assert bench.status_of(wire.ArmRequest(0)) == wire.Status.MUST_NAME_MODEL
        number = source.randrange(len(BLOBS))
        bench.upload(BLOBS[number])
        at = where(source)
        if at is not None:
            bench.firmware.cut_power_after(at)
            cuts += 1
        writes = bench.firmware.flash()[1]
        acknowledged = bench.status_of(wire.ModelPersistRequest()) == wire.Status.OK
        if bench.firmware.flash()[1] > writes:
            expected.save(CRCS[number], acknowledged)
        cells = bench.firmware.cells()
        for _ in range(2):  # the next starts read what is in doubt anew
            expected.check(boot(cells, source)[1])
    assert cuts > SAVES // SEEDS // 3
    assert lost > SAVES // SEEDS // 20


def test_a_save_that_was_repeated_after_a_cut_is_clean_ever_after():
    """Both slots hold what was cut short; the next save leaves nothing of it that could be read."""
    source = random.Random(9)
    for at in range(1, SAVE_BYTES + SLOT, 61):
        bench = Bench()
        bench.upload(BLOBS[0])
        bench.ok(wire.ModelPersistRequest())
        cells = bench.firmware.cells()
        for number in (1, 2):
            bench, _ = boot(cells, source)
            bench.upload(BLOBS[number])
            bench.firmware.cut_power_after(at)
            bench.status_of(wire.ModelPersistRequest())
            cells = bench.firmware.cells()
        bench, _ = boot(cells, source)
        bench.upload(BLOBS[3])
        bench.ok(wire.ModelPersistRequest())
        for _ in range(4):
            hello = boot(bench.firmware.cells(), source)[1]
            assert (hello.model_crc, hello.model_flags) == (CRCS[3], LOADED | PERSISTED), at


def test_two_records_that_read_as_none_today_do_not_read_as_the_newest_tomorrow():
    """Both saves were cut in their last byte. A save that left the other slot alone would be the older one."""
    source, neither = random.Random(1), 0
    for _ in range(60):
        cells = None
        for number, end in ((1, SAVE_BYTES - MARK), (2, SAVE_BYTES)):
            bench = Bench() if cells is None else boot(cells, source)[0]
            bench.upload(BLOBS[number])
            bench.firmware.cut_power_after(end if bench.ok(wire.InfoRequest()).flash_sequence else SAVE_BYTES - MARK)
            bench.status_of(wire.ModelPersistRequest())
            cells = bench.firmware.cells()
        bench, hello = boot(cells, source)
        neither += hello.model_flags == 0
        bench.upload(BLOBS[3])
        bench.ok(wire.ModelPersistRequest())
        for _ in range(30):
            hello = boot(bench.firmware.cells(), source)[1]
            assert (hello.model_crc, hello.model_flags) == (CRCS[3], LOADED | PERSISTED)
    assert neither > 10
