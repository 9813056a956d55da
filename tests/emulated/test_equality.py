"""The ELF on the emulated boards and the same source in this process: the same bits, for 100,000 ticks."""

import runpy
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from talker import UM, Talker, V, stage_model, upload

from phaselead.control.gains import PAPER_GAINS
from phaselead.device import wire
from phaselead.sim.device import VirtualDevice
from phaselead.sim.emulated import BOARDS

ALL_CHANNELS = 31
TICKS = 100_000
BUDGET = Path(__file__).parents[2] / "benchmarks" / "budget.py"
MODEL_SLOT, MODEL_SLOT_SIZE = 0xC000, 0x10000
"""The first one, sector 4, in an image that begins with sector 1."""
JOURNAL, JOURNAL_SIZE = 0x4000, 2 * 0x4000
"""Sectors 2 and 3 in it."""
OWN_SECTOR = 4096
"""What the journal uses of a sector, and all there is of it in the process."""
RECORD_SIZE = 16 + wire.Model.SIZE


def step(f_Hz):
    return round(f_Hz / 5000 * 2**64)


ONE = 1 << 26
NEAR_ONE = wire.Biquad(ONE + 4, -ONE // 4 - 4, 2, -ONE // 4, 2)
SLOWER = wire.Biquad(ONE - ONE // 16, -ONE // 2, 0, -ONE // 2 - ONE // 16, 0)
"""Sections that the loops can stand."""


def with_gains(axis, mode):
    gains = PAPER_GAINS
    kp, ki_ts = round(gains.kp_V_per_um * V), round(gains.ki_V_per_um_s / 5000 * 2**32)
    return wire.SetAxisRequest(axis, mode, kp, ki_ts, round(gains.kd_V_s_per_um * 5000 * V), 0x7FFFFFFF)


def points(talker):
    """A waveform on axis z, in chunks."""
    wave = (np.abs(np.linspace(-1, 1, 1024)) * 2**30).astype("<i4").tobytes()
    chunks = [wire.WaveChunkRequest(2, at // 4, wave[at : at + 1024]) for at in range(0, len(wave), 1024)]
    talker.ok(*chunks, wire.WaveCommitRequest(2, crc32(wave)))


def queued(kind, flags, swing, offset, step_turn64, ticks, enter, leave):
    """The same path for all axes, begun together."""
    segment = wire.Segment(kind, flags, swing, offset, step_turn64, ticks, enter, leave)
    return wire.QueueRequest(7, 0, 0, (segment,) * 3)


def paths_one_after_another(talker):
    """In three modes with three leads: a hold, a move, a sine that is entered and left, a move that is broken off."""
    here = wire.PathFlag.FROM_HERE
    for axis, mode in enumerate((wire.Mode.FF_PID, wire.Mode.INVERSE_PID, wire.Mode.INVERSE)):
        hold = wire.SetPathRequest(axis, wire.PathKind.HOLD, 0, 0, 0, 0)
        talker.ok(with_gains(axis, mode), hold, wire.SetJoinsRequest(axis, here, 300, 0))
    talker.ok(wire.ArmRequest(0), wire.StartRequest(7))
    talker.run(400)
    talker.ok(
        queued(wire.PathKind.MOVE, here, 40 * UM, 0, 2**64 // 100 + 1, 0, 0, 0),
        queued(wire.PathKind.SINE, 0, 60 * UM, 10 * UM, step(20), 1062, 200, 200),
        queued(wire.PathKind.MOVE, here | wire.PathFlag.MORE, 90 * UM, 0, 2**64 // 3000, 0, 77, 0),
    )
    talker.run(3500)
    hold = queued(wire.PathKind.HOLD, here, 0, 0, 0, 0, 150, 0)
    gains = wire.SetGainsRequest(0, V // 100, 1 << 20, 0, 0x7FFFFFFF, (SLOWER, NEAR_ONE))
    talker.ok(replace(hold, at_once=1), gains, wire.WhereRequest())
    talker.run(400)
    talker.ok(wire.ParkRequest())
    talker.run(2500)


def script(talker):
    """Tables, inverse, feedback, a move, a waveform, saturations, changes of mode, paths one after another; then the
    model is kept in flash."""
    talker.ok(wire.HelloRequest(), wire.SetTimeoutRequest(0), *upload(stage_model()))
    points(talker)
    talker.ok(wire.StreamStartRequest(ALL_CHANNELS, 7, 1))
    talker.ok(
        with_gains(0, wire.Mode.FF_PID),
        wire.SetPathRequest(0, wire.PathKind.SINE, 60 * UM, 0, step(5), 0),
        with_gains(1, wire.Mode.PID),
        wire.SetPathRequest(1, wire.PathKind.MOVE, 80 * UM, 0, 2**64 // 9000, 0),
        wire.SetAxisRequest(2, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
        wire.SetPathRequest(2, wire.PathKind.WAVE, 9 * V, 0, step(7), 0),
        wire.ArmRequest(0),
        wire.StartRequest(7),
    )
    talker.run(TICKS // 2)
    talker.ok(wire.ParkRequest())
    talker.run(2500)
    paths_one_after_another(talker)
    talker.ok(
        replace(with_gains(0, wire.Mode.PID), filters=(NEAR_ONE, SLOWER)),
        # Once that has ended x is held while y shakes it: a fault after half a second.
        wire.SetPathRequest(0, wire.PathKind.SINE, 20 * UM, 10 * UM, step(80), 48_500),
        wire.SetAxisRequest(1, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
        wire.SetPathRequest(1, wire.PathKind.SINE, 11 * V, -1 * V, step(60), 0),  # faster than the slew limit
        with_gains(2, wire.Mode.INVERSE_PID),
        wire.SetPathRequest(2, wire.PathKind.WAVE, 40 * UM, 0, step(3), 0),
        wire.ArmRequest(0),
        wire.StartRequest(7),
    )
    talker.run(TICKS // 2)
    talker.ok(wire.ParkRequest())
    talker.run(2500)
    talker.ok(wire.StreamStopRequest())
    talker.run(100)
    before_flash = talker.ticks[-1]
    assert talker.ask(wire.ModelPersistRequest(), ticks=20_000).status == wire.Status.OK
    return before_flash


def repeat(board, stage, erasing_from):
    """The same commands, each before the tick at which the board obeyed it, on a device in this process. From tick
    ``erasing_from`` on, ticks that go by on a board while flash is erased are left out."""
    device = VirtualDevice(stage)
    talker = Talker(device)
    for frame, tick in zip(board.frames, board.ticks, strict=True):
        talker.run(min(tick, erasing_from) - device.tick)
        device.write(frame)
    talker.run(200)
    return talker


@pytest.mark.parametrize("board", BOARDS)
def test_board_and_process_say_the_same_bits(board, stage, start):
    emulated = start(board)
    talker = Talker(emulated, pause=60)
    last = script(talker)
    assert last > TICKS
    adc, dac = emulated.codes()
    twin = repeat(talker, stage, talker.ticks[-2])

    one, other = (np.concatenate([np.frombuffer(batch.data, np.uint8) for batch in t.samples]) for t in (talker, twin))
    assert len(one) == len(other) >= TICKS * 36
    assert np.array_equal(one, other)
    assert [replace(batch, data=b"") for batch in talker.samples] == [replace(b, data=b"") for b in twin.samples]
    assert talker.events == twin.events
    assert talker.reader.errors == twin.reader.errors == 0

    # What went through the converters' serial words is what the stream says.
    ticks = np.frombuffer(one.tobytes(), np.dtype([("r", "<i4"), ("adc", "<u2"), ("dac", "<u2"), ("ff_fb", "<i4")]))
    first = talker.samples[0].first_tick
    ticks = ticks.reshape(-1, 3)
    assert np.array_equal(ticks["adc"], adc[first : first + len(ticks)])
    assert np.array_equal(ticks["dac"], dac[first : first + len(ticks)])
    assert len(np.unique(ticks["dac"], axis=0)) > 1000  # something did move

    image, _ = emulated.flash()
    own, _ = twin.device.flash()
    slot = image[MODEL_SLOT:]
    assert slot[:RECORD_SIZE] == own[:RECORD_SIZE] != b"\xff" * RECORD_SIZE
    assert set(slot[RECORD_SIZE:MODEL_SLOT_SIZE]) == {0xFF}
    journal, own_journal = image[JOURNAL:][:JOURNAL_SIZE], own[2 * OWN_SECTOR :]
    assert journal[:OWN_SECTOR] == own_journal[:OWN_SECTOR] != b"\xff" * OWN_SECTOR
    assert set(journal[OWN_SECTOR:]) == {0xFF}


def test_every_place_of_a_model_says_the_same_bits(stage, start):
    talker = Talker(start("nucleo_f446re"), pause=60)
    full = runpy.run_path(str(BUDGET))["full"]()  # 32 plays, 24 dead zones, 8 creep terms, 7 sections an axis
    talker.ok(wire.HelloRequest(), wire.SetTimeoutRequest(0), *upload(full))
    talker.ok(wire.StreamStartRequest(ALL_CHANNELS, 7, 1))
    for axis, f_Hz in enumerate((3, 17, 60)):
        path = wire.SetPathRequest(axis, wire.PathKind.SINE, 40 * UM, 5 * UM, step(f_Hz), 0)
        talker.ok(with_gains(axis, wire.Mode.INVERSE_PID), path)
    talker.ok(wire.ArmRequest(0), wire.StartRequest(7))
    talker.run(10_000)
    talker.ok(wire.ParkRequest())
    talker.run(1000)
    talker.ok(wire.StreamStopRequest())
    talker.run(100)
    twin = repeat(talker, stage, talker.ticks[-1])
    one, other = (b"".join(batch.data for batch in t.samples) for t in (talker, twin))
    assert one == other
    dac = np.frombuffer(one, np.dtype([("r", "<i4"), ("adc", "<u2"), ("dac", "<u2"), ("ff_fb", "<i4")]))["dac"]
    assert all(len(np.unique(dac[axis::3])) > 500 for axis in range(3))
