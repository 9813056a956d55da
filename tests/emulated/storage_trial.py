"""A thousand saves in the ELF, most of them cut short: make storage-trial.

python tests/emulated/storage_trial.py [--saves 1000] [--seed 1]    exits 1 where another model was loaded than may be

As tests/app/test_storage_attack.py does with the same code in this process: the power goes within a byte of the mark,
the erase, the blob or the header. Bits that were on their way read either way from then on: another board goes on with
the flash, each time with other ones of them turned.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from zlib import crc32

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "app")]

from talker import Talker, stage_model, upload  # noqa: E402
from test_storage_attack import FALLBACK, Expected  # noqa: E402

from phaselead.device import wire  # noqa: E402
from phaselead.sim.emulated import BOOTLOADER_SIZE, EmulatedDevice, Injection  # noqa: E402
from phaselead.sim.plant import built_in, plant_parameters  # noqa: E402

BOARD = "nucleo_f446re"
SLOTS = (0x10000 - BOOTLOADER_SIZE, 0x60000 - BOOTLOADER_SIZE)
SIZES = (0x10000, 0x20000)
"""Sectors 4 and 7, as docs/firmware.md has them."""
MAGIC, HEADER, MARK = 0x5230_4C50, struct.Struct("<4I"), 4
SAVE_TICKS, PIECE_TICKS = 12_000, 250
"""Two erases take less: 1 s and 0.55 s."""
ONES = 0xFF


def blob(number: int) -> bytes:
    changed = bytearray(stage_model())
    changed[4] ^= number  # another stage file's hash
    return bytes(changed)


BLOBS = [blob(number) for number in range(8)]
CRCS = [crc32(one) for one in BLOBS]


class Cells:
    """Flash, and which of its bits read either way."""

    def __init__(self, content: bytes) -> None:
        self.bits, self.doubtful = bytearray(content), bytearray(len(content))

    def read(self, random: Random) -> bytes:
        out = bytearray(self.bits)
        for at, doubt in enumerate(self.doubtful):
            if doubt:
                out[at] ^= doubt & random.getrandbits(8)
        return bytes(out)

    def take(self, content: bytes) -> None:
        self.bits = bytearray(content)


def record_in(content: bytes, slot: int) -> int | None:
    """The sequence number of the whole record in a slot."""
    head = content[SLOTS[slot] : SLOTS[slot] + HEADER.size]
    magic, sequence, size, crc = HEADER.unpack(head)
    body = content[SLOTS[slot] + HEADER.size :][: wire.Model.SIZE]
    whole = magic == MAGIC and sequence and size == wire.Model.SIZE and crc == crc32(head[4:12] + body)
    return sequence if whole else None


def is_blank(content: bytes, slot: int) -> bool:
    return set(content[SLOTS[slot] :][: HEADER.size + wire.Model.SIZE]) == {ONES}


def steps_of_a_save(content: bytes, saved: bytes) -> Iterator[tuple[int, bytes]]:
    """Where and what the firmware writes, in its order: as app/model_store.c says it does."""
    sequences = [record_in(content, slot) for slot in range(2)]
    newest = max((slot for slot in range(2) if sequences[slot]), key=lambda slot: sequences[slot] or 0, default=None)
    into = 0 if newest is None else 1 - newest
    sequence = 1 if newest is None else (sequences[newest] or 0) + 1
    if newest is None and not all(is_blank(content, slot) for slot in range(2)):
        yield SLOTS[1 - into], bytes([ONES]) * SIZES[1 - into]
    if newest is not None:
        yield SLOTS[newest] + HEADER.size + wire.Model.SIZE, bytes(MARK)
    yield SLOTS[into], bytes([ONES]) * SIZES[into]
    yield SLOTS[into] + HEADER.size, saved
    head = struct.pack("<2I", sequence, wire.Model.SIZE)
    yield SLOTS[into], struct.pack("<I", MAGIC) + head + struct.pack("<I", crc32(head + saved))


def settle(cells: Cells, before: bytes, steps: list[tuple[int, bytes]], cut: int | None) -> None:
    """Notes which bits are certain and which doubtful once the power went with the ``cut``-th byte."""
    done = 0
    for at, target in steps:
        erases = len(target) > wire.Model.SIZE
        for offset, to in enumerate(target):
            place, done = at + offset, done + 1
            if cut is None or done < cut:
                cells.doubtful[place] &= 0 if erases else to
                continue
            if erases:
                for left in range(place, at + len(target)):
                    cells.doubtful[left] |= ~cells.bits[left] & ONES
            cells.doubtful[place] |= before[place] ^ (to if erases else before[place] & to)
            return


def where(random: Random, lengths: list[int]) -> int | None:
    """A byte at which the power goes, and None for never; around the steps' ends more often than elsewhere."""
    ends = [sum(lengths[: i + 1]) for i in range(len(lengths))]
    near = [end + offset for end in [1, *ends] for offset in range(-2, 6)]
    at = random.choice([None, None, random.randint(1, ends[-1]), random.choice(near), random.choice(near)])
    return None if at is None else min(max(at, 1), ends[-1])


def save(board: EmulatedDevice, talker: Talker, cut: int | None) -> bool:
    """True when it was acknowledged. A board whose power went says that it knows no session."""
    if cut is not None:
        board.inject(Injection.FLASH_CUT, cut)
    board.write(talker.frame(wire.ModelPersistRequest()))
    asked = talker.last_id
    for _ in range(SAVE_TICKS // PIECE_TICKS):
        talker.run(PIECE_TICKS)
        if asked in talker.replies:
            return talker.replies[asked][wire.HEADER.size] == wire.Status.OK
        if any(body[wire.HEADER.size] == wire.Status.NO_SESSION for body in talker.replies.values()):
            return False
        board.write(talker.frame(wire.StatusRequest()))
    raise AssertionError(f"the save neither ended nor was cut at {cut}")


def trial(saves: int, seed: int, progress: Callable[[dict[str, int]], None] | None = None) -> dict[str, int]:
    """Raises AssertionError where another model is loaded than may be."""
    random, expected, seen = Random(seed), Expected(), Counter[str]()
    plant = plant_parameters(built_in("xyz250"))
    first = EmulatedDevice(BOARD, plant, delays=False)
    Talker(first).run(200)
    cells = Cells(first.flash()[0])
    first.close()
    for _ in range(saves):
        board = EmulatedDevice(BOARD, plant, flash=cells.read(random), delays=False)
        talker = Talker(board)
        hello = talker.ok(wire.HelloRequest())
        expected.check(hello)
        seen["saves"] += 1
        if progress and seen["saves"] % 50 == 0:
            progress(dict(seen))
        if hello.model_flags & FALLBACK:
            seen["fallbacks"] += 1
            assert talker.ask(wire.ArmRequest(0)) == wire.Status.MUST_NAME_MODEL
        elif hello.model_flags == 0:
            seen["without a model"] += 1
        number = random.randrange(len(BLOBS))
        talker.ok(*upload(BLOBS[number]))
        talker.run(PIECE_TICKS)
        before = board.flash()[0]
        steps = list(steps_of_a_save(before, BLOBS[number]))
        cut = where(random, [len(target) for _, target in steps])
        unchanged = hello.model_crc == CRCS[number] and not hello.model_flags & FALLBACK
        acknowledged = save(board, talker, None if unchanged else cut)
        cells.take(board.flash()[0])
        board.close()
        if unchanged:
            assert acknowledged
            continue
        expected.save(CRCS[number], acknowledged)
        seen["cuts"] += cut is not None
        assert acknowledged == (cut is None), cut
        settle(cells, before, steps, cut)
    return dict(seen)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--saves", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    try:
        print(json.dumps(trial(arguments.saves, arguments.seed, lambda seen: print(seen, file=sys.stderr, flush=True))))
    except AssertionError as broken:
        print(f"broken: {broken!r}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
