"""Faults of the emulated board that a reset keeps from being written, in memory that it leaves as it is."""

import subprocess
from random import Random

import pytest
from talker import Talker, V

from phaselead.device import wire
from phaselead.sim.emulated import Injection, find_firmware

RECORD = 72
"""Bytes, of 16 us each."""
INTERLOCK = (1, wire.Fault.INTERLOCK, wire.State.RUNNING)


def running(board):
    talker = Talker(board)
    talker.ok(wire.HelloRequest())
    talker.drive(swing=8 * V)
    talker.run(300)
    return talker


def at_fault(board):
    """On its way home, some 2 V from it."""
    talker = running(board)
    talker.device.inject(Injection.INTERLOCK)
    talker.run(100)
    talker.device.inject(Injection.INTERLOCK, 0)
    status = talker.ok(wire.StatusRequest())
    assert (status.fault, status.at_rest == 7) == (wire.Fault.INTERLOCK, False)
    return talker


def log_of(talker):
    talker.ok(wire.HelloRequest())
    log = talker.ok(wire.FaultLogRequest())
    return [(one.power_cycle, one.fault, one.state) for one in log.faults[: log.count]]


def kept_in_flash(start, talker):
    """What another board finds in its flash."""
    return log_of(Talker(start(flash=talker.device.flash()[0], delays=False)))


def kept_memory():
    elf = find_firmware("nucleo_f446re")
    text = subprocess.run(["arm-none-eabi-nm", "-S", elf], capture_output=True, text=True, check=True).stdout
    at, size = next(line.split()[:2] for line in text.splitlines() if line.split()[-1] == "fault_log")
    return int(at, 16), int(size, 16)


def test_the_reset_pin_on_the_way_home_loses_no_fault(start):
    talker = at_fault(start())
    talker.device.inject(Injection.RESET_PIN)
    talker.run(300)
    assert log_of(talker) == [INTERLOCK]
    assert kept_in_flash(start, talker) == [INTERLOCK]


def test_a_program_that_is_lost_on_the_way_home_is_told_after_what_went_before(start):
    talker = at_fault(start())
    talker.device.inject(Injection.CRYSTAL_STOPS)
    talker.run(300)
    assert log_of(talker) == [INTERLOCK, (2, wire.Fault.CORE_LOST, wire.State.PARKED)]


def test_memory_without_power_is_no_fault(start):
    """A brown-out: memory holds anything, by a pattern here and at random."""
    talker = at_fault(start())
    talker.device.inject(Injection.BROWN_OUT)
    talker.run(300)
    assert log_of(talker) == []
    chance, (address, size) = Random(6), kept_memory()
    for _ in range(5):
        talker.device.poke(address, chance.randbytes(size - 8) + b"\x09\0\0\0\2\0\0\0")  # seven would wait
        talker.device.inject(Injection.RESET_PIN)
        talker.run(300)
        assert log_of(talker) == []


@pytest.mark.parametrize("phase", range(7))
def test_a_reset_while_it_is_written_neither_loses_nor_doubles_it(start, phase):
    """It takes five ticks more."""
    talker = at_fault(start(delays=False))
    before = talker.device.flash()[1]
    while talker.device.flash()[1] == before:
        talker.run(1)
    talker.run(phase)
    assert (talker.device.flash()[1] - before < RECORD) == (phase < 5)
    talker.device.inject(Injection.RESET_PIN)
    talker.run(300)
    assert log_of(talker) == [INTERLOCK]
    assert kept_in_flash(start, talker) == [INTERLOCK]
