"""The power cut at every byte of an update, and of what a bootloader writes: the old image starts, or the new one.

Bits that were on their way read either way from then on, each time anew. tests/emulated/test_update_board.py cuts at a
sample of the steps in the ELF.
"""

import pytest
from device_bench import Bench
from test_update import (
    HEADER,
    IMAGE_SIZE,
    NEW,
    NEWER,
    OLD,
    RECORD_SIZE,
    SLOT_SIZE,
    boot,
    entry,
    factory,
    flashed,
    image,
    running,
    steps,
)

from phaselead.device import wire

ENTRY = 16
BEGUN, SENT = SLOT_SIZE, SLOT_SIZE + IMAGE_SIZE - HEADER.size
TRIED = SENT + HEADER.size + ENTRY
STARTED = TRIED + ENTRY
CONFIRMED = STARTED + 2 * ENTRY
"""Bytes that have changed after each step: erase, body, header and trial, start, confirmation."""


def reseeded(cells, seed):
    return cells[:-4] + seed.to_bytes(4, "little")


def cut(cells, at, new, build_id):
    """What is in flash when the power goes at byte ``at``, and the last thing that was acknowledged."""
    bench = Bench(flash=cells)
    bench.firmware.cut_power_after(at)
    done = "nothing"
    for command in steps(new):
        if bench.status_of(command) != wire.Status.OK:
            return bench.firmware.cells(), done
    done = "commit"
    if bench.status_of(wire.UpdateRestartRequest()) != wire.Status.OK:
        return bench.firmware.cells(), done
    bench.run(110)
    if running(bench) == build_id and bench.status_of(wire.UpdateConfirmRequest(build_id)) == wire.Status.OK:
        done = "confirm"
    return bench.firmware.cells(), done


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_old_or_the_new_image_starts_wherever_the_power_goes(seed):
    cells, new = factory(), image(NEW, 1)
    for at in range(1, CONFIRMED + 2):
        left, done = cut(cells, at, new, NEW)
        again = boot(reseeded(left, seed * at))
        runs = running(again)
        assert runs in (OLD, NEW), at
        if at < TRIED - ENTRY:
            assert runs == OLD, at
        if done == "confirm":
            assert runs == NEW, at
            assert again.ok(wire.UpdateInfoRequest()).standing == wire.UpdateStanding.CONFIRMED


@pytest.mark.parametrize("seed", [1, 2])
def test_what_starts_after_a_cut_goes_on_starting(seed):
    """Doubtful bits read one way today and another tomorrow; what was confirmed stays, and what is on trial ends."""
    cells, new = factory(), image(NEW, 1)
    for at in (*range(BEGUN, SENT, 97), *range(SENT, CONFIRMED + 2, 3)):
        left, _ = cut(cells, at, new, NEW)
        seen = []
        for start in range(8):
            bench = boot(reseeded(left, seed * 1000 + 13 * at + start))
            seen.append(running(bench))
            standing = bench.ok(wire.UpdateInfoRequest()).standing
            left = bench.firmware.cells()
        assert set(seen) <= {OLD, NEW}, at
        assert standing != wire.UpdateStanding.TRIAL, at
        assert seen[-3:] in ([OLD] * 3, [NEW] * 3), at


def test_an_update_after_a_cut_one_heals():
    cells, new = factory(), image(NEW, 1)
    for at in range(1, CONFIRMED + 2, 7):
        left, _ = cut(cells, at, new, NEW)
        bench = boot(reseeded(left, at))
        runs = running(bench)
        bench.status_of(wire.UpdateConfirmRequest(runs))
        for command in steps(image(NEWER, 1 if runs == OLD else 0)):
            bench.ok(command)
        again = boot(bench.firmware.cells())
        assert running(again) == NEWER, at
        again.ok(wire.UpdateConfirmRequest(NEWER))
        assert running(boot(again.firmware.cells())) == NEWER, at


@pytest.mark.parametrize("slot", [0, 1])
def test_a_cut_while_a_full_record_is_written_anew_leaves_what_runs(slot):
    before = entry(3, 0) * 2 + entry(1, 1, 5) + entry(3, 1) + entry(3, slot) * 2
    images = image(OLD, 0), image(NEWER, 1)
    cells = flashed(a=images[0], b=images[1], record=before.ljust(RECORD_SIZE - 31 * ENTRY, b"\0"))
    old, new, end = (OLD, NEWER)[slot], image(NEW, 1 - slot), SLOT_SIZE + RECORD_SIZE
    for at in (1, 900, *range(SLOT_SIZE, end, 1501), *range(end - 2, end + 2 * ENTRY + 2)):
        left, _ = cut(cells, at, new, NEW)
        for seed in (1, 2, 3):
            assert running(boot(reseeded(left, seed))) == old, at
