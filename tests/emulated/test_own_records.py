"""Hard limits and the fault log in the flash of the emulated board."""

from dataclasses import replace

import numpy as np
import pytest
from talker import Talker, V

from phaselead.device import wire
from phaselead.sim.emulated import Injection

FREE = wire.AxisLimits(0, 65535, 2**32 - 1, 0, 65535)
EIGHT_V = replace(FREE, dac_max=32768 + 8 * 3200)
RECORD, USED = 72, 4096
SECOND_SECTOR = 2 * 16 * 1024
"""Of the journal, sector 3, in an image that begins with sector 1."""


def limits(x):
    return wire.LimitsSetRequest((x, FREE, FREE))


def answered(board):
    talker = Talker(board)
    talker.ok(wire.HelloRequest())
    return talker


def test_limits_and_faults_survive_a_reset(start):
    talker = answered(start())
    talker.ok(limits(EIGHT_V))
    talker.drive(swing=2 * V)
    talker.run(100)
    assert talker.ask(limits(FREE)) == wire.Status.WRONG_STATE
    talker.device.inject(Injection.INTERLOCK)
    talker.run(1500)
    talker.device.inject(Injection.RESET_PIN)
    talker.run(300)
    talker.ok(wire.HelloRequest())
    log = talker.ok(wire.FaultLogRequest())
    assert log.power_cycle == 2
    first = log.faults[0]
    assert (first.fault, first.power_cycle, first.state) == (wire.Fault.INTERLOCK, 1, wire.State.RUNNING)
    assert talker.ok(wire.LimitsReadRequest()).limits == (EIGHT_V, FREE, FREE)


@pytest.mark.parametrize("at", [1, 40, RECORD - 1, RECORD])
def test_a_power_cut_leaves_the_old_limits_or_the_new(start, at):
    talker = answered(start())
    talker.ok(limits(EIGHT_V))
    talker.device.inject(Injection.FLASH_CUT, at)
    talker.device.write(talker.frame(limits(replace(FREE, dac_max=50_000))))
    talker.run(300)
    # Flash that lost its power takes no more bytes here: another board goes on with what is in it.
    talker = answered(start(flash=talker.device.flash()[0]))
    assert talker.ok(wire.LimitsReadRequest()).limits[0] in (EIGHT_V, replace(FREE, dac_max=50_000))
    talker.ok(wire.ArmRequest(0))


def test_a_full_sector_moves_on_and_the_board_still_starts_in_time(start):
    talker = answered(start())
    for _ in range(USED // RECORD):
        talker.ok(limits(EIGHT_V))
    flash, _ = talker.device.flash()
    assert flash[SECOND_SECTOR:][:RECORD] != b"\xff" * RECORD
    board = start(flash=flash, boot=False)
    board.run(200)
    ns, ticks = board.time()
    assert ns - ticks * 200_000 < 20_000_000
    assert answered(board).ok(wire.LimitsReadRequest()).limits[0] == EIGHT_V


def test_the_recorder_that_is_always_on_shows_the_ticks_that_flash_took(start):
    """Its trigger is the interlock's first open tick, some before the fault."""
    talker = answered(start())
    talker.ok(wire.TransientArmRequest(wire.Trigger.INPUT, 0, wire.Channel.ADC, 0, 0, 1, 50))
    talker.ok(limits(EIGHT_V))
    talker.run(100)
    talker.device.inject(Injection.INTERLOCK)
    talker.run(100)
    head = talker.ok(wire.TransientReadRequest(0, 0))
    assert (head.state, head.cause) == (wire.TransientState.FROZEN, wire.Trigger.INPUT)
    assert talker.ok(wire.StatusRequest()).fault_tick - head.trigger_tick in (2, 3)
    data = b"".join(talker.ok(wire.TransientReadRequest(at, 1000)).data for at in range(0, head.size, 1000))
    ticks = np.frombuffer(data, np.uint32).reshape(-1, 10)[:, 0].astype(int)
    steps = np.diff(ticks)
    assert (ticks > head.trigger_tick).sum() == 50
    assert max(steps) > 3  # 72 bytes of 16 us each
    assert (steps == 1).sum() >= len(steps) - 3
