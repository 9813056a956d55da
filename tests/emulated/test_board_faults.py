"""Faults of the hardware, made to happen on the emulated board, on the ELF that a board would run.

Each reaction is measured at the model of the DAC: it begins within one tick of detection and never moves the output
faster than the slew limit, unless the core is lost.
"""

import itertools
import re
import struct
import subprocess

import numpy as np
import pytest
from talker import Talker, V, stage_model, upload

from phaselead.device import wire
from phaselead.sim.emulated import Injection, find_firmware

ZERO_V = 32768
SLEW_CODES, RAMP_CODES = 640, 32
"""0.2 V and 0.01 V a tick, in codes of 0.3125 mV."""
WATCHDOG_AND_BOOT_TICKS = 100
"""20 ms."""
IWDG_RELOAD, RELOAD_AT_RESET = 0x4000_3008, struct.pack("<I", 0xFFF)
BRANCH_TO_ITSELF = struct.pack("<H", 0xE7FE)
UNDEFINED = struct.pack("<H", 0xDEFF)
BREAKPOINT = struct.pack("<H", 0xBE00)  # a HardFault where no debugger listens
NOWHERE = struct.pack("<HHH", 0x2005, 0x0740, 0x6800)  # reads from 0xA0000000, where nothing answers
RECURSE = struct.pack("<HHH", 0xB5FF, 0xF7FF, 0xFFFD)  # push {r0-r7, lr}; bl to the push


def symbol(name):
    text = subprocess.run(["arm-none-eabi-nm", find_firmware("nucleo_f446re")], capture_output=True, text=True).stdout
    return int(re.search(rf"^([0-9a-f]+) \w {name}$", text, re.M)[1], 16) & ~1


@pytest.fixture
def running(start):
    """A board that drives axis x with a sine, and what was written to the DAC so far is forgotten."""
    board = start()
    talker = Talker(board)
    talker.ok(wire.HelloRequest())
    talker.drive(swing=8 * V, f_Hz=20)
    talker.run(60)
    board.codes()
    return talker


def dac(talker, ticks):
    """DAC codes of axis x in the ticks to come."""
    talker.run(ticks)
    return talker.device.codes()[1][:, 0].astype(int)


def assert_ramps_home(codes, within):
    """From tick ``within`` on only downwards by the ramp, until it is at 0 V."""
    steps = np.diff(codes)
    assert np.all(np.abs(steps) <= SLEW_CODES)
    assert np.all((steps[within:] <= 0) & (steps[within:] >= -RAMP_CODES - 1))
    assert np.any(steps[within:] < 0)


def info(talker):
    return talker.ok(wire.InfoRequest())


@pytest.mark.parametrize(
    ("injection", "fault", "detection_ticks"),
    [
        (Injection.ADC_SILENT, wire.Fault.CONVERTER_SILENT, 2),
        (Injection.DAC_SILENT, wire.Fault.CONVERTER_SILENT, 8),
        (Injection.INTERLOCK, wire.Fault.INTERLOCK, 3),
    ],
)
def test_a_rig_that_fails_is_ramped_home(running, injection, fault, detection_ticks):
    running.device.inject(injection, 1)
    codes = dac(running, 300)
    if injection == Injection.DAC_SILENT:  # a DAC that hears nothing stays where it is
        assert np.all(codes[1:] == codes[1])
        running.device.inject(injection, 0)
        heard = np.r_[codes[-1], dac(running, 900)]
        assert_ramps_home(heard, 0)
        assert heard[-1] == ZERO_V != heard[0]
    else:
        assert_ramps_home(codes, detection_ticks + 1)
    assert running.state == wire.State.FAULT
    assert info(running).last_fault == fault
    status = running.ok(wire.StatusRequest())
    assert status.fault == fault


@pytest.mark.parametrize("stream", [False, True])
def test_a_dac_that_hears_nothing_is_noticed_within_nine_ticks(start, stream):
    """The main loop asks it, however much it has to send."""
    board = start()
    talker = Talker(board)
    talker.ok(wire.HelloRequest())
    talker.drive(swing=8 * V, f_Hz=20)
    before = board.time()[1] - talker.ok(wire.StatusRequest()).tick
    if stream:
        talker.ok(wire.StreamStartRequest(31, 7, 1))
    for wait in range(60, 67):
        talker.run(wait)
        from_tick = board.time()[1] - before
        board.inject(Injection.DAC_SILENT, 1)
        talker.run(40)
        board.inject(Injection.DAC_SILENT, 0)
        status = talker.ok(wire.StatusRequest())
        assert status.fault == wire.Fault.CONVERTER_SILENT
        assert status.fault_tick - from_tick <= 9
        talker.run(1500)
        talker.ok(wire.ClearFaultRequest(), wire.ArmRequest(0), wire.StartRequest(1))


def test_without_a_main_loop_the_tick_asks_the_dac(running):
    """It would jump to where the path is once it hears again."""
    running.device.poke(symbol("serial_poll"), BRANCH_TO_ITSELF)
    running.device.inject(Injection.DAC_SILENT, 1)
    held = dac(running, 60)
    running.device.inject(Injection.DAC_SILENT, 0)
    codes = np.r_[held[-1], dac(running, 200)]
    assert np.all(held[1:] == held[-1])
    assert np.abs(np.diff(codes)).max() <= RAMP_CODES + 1
    assert codes[-1] != codes[0]


def test_a_spike_on_the_interlock_is_no_fault(running):
    running.device.inject(Injection.INTERLOCK, 1)
    running.run(2)
    running.device.inject(Injection.INTERLOCK, 0)
    running.run(50)
    assert running.state == wire.State.RUNNING


def test_an_open_interlock_is_not_cleared_away(running):
    """Once a fault could be cleared, and a path started, with the contact still open."""
    running.device.inject(Injection.INTERLOCK, 1)
    running.run(1000)
    running.ok(wire.ParkRequest(), wire.ClearFaultRequest())
    running.run(5)
    assert running.ask(wire.ArmRequest(0)) == wire.Status.FAULT_LATCHED
    assert running.ok(wire.StatusRequest()).fault == wire.Fault.INTERLOCK
    running.device.inject(Injection.INTERLOCK, 0)
    running.ok(wire.ClearFaultRequest())
    running.run(5)
    assert running.state == wire.State.PARKED


def test_noise_on_the_line_costs_frames_and_nothing_else(running):
    running.device.inject(Injection.NOISE, 10)
    running.device.write(running.frame(wire.StatusRequest()))
    running.run(20)
    assert running.state == wire.State.RUNNING
    status = running.ok(wire.StatusRequest())
    assert status.rx_errors >= 1
    assert status.fault == wire.Fault.NONE


def until_reset(talker, address, code):
    """Puts code in the program's place until that has ended in a reset; the next boot is a healthy one."""
    original = talker.device.peek(address, len(code))
    talker.device.poke(address, code)
    for _ in range(700):
        talker.run(1)
        if talker.device.peek(IWDG_RELOAD, 4) == RELOAD_AT_RESET:
            break
    talker.device.poke(address, original)


def lost_core(talker, ticks=WATCHDOG_AND_BOOT_TICKS + 100):
    """The DAC's codes from now on, and the state of the device when it is back."""
    codes = dac(talker, ticks)
    talker.ok(wire.HelloRequest())
    return codes, talker.state


def back_at_zero(codes, within):
    """At 0 V within so many ticks of the injection, and then for good."""
    at_zero = np.flatnonzero(codes != ZERO_V)
    return len(at_zero) == 0 or at_zero[-1] < within


@pytest.mark.parametrize(
    ("place", "code", "loss", "within"),
    [
        ("serial_poll", UNDEFINED, wire.CoreLoss.USAGE_FAULT, 2),
        ("serial_poll", BREAKPOINT, wire.CoreLoss.HARD_FAULT, 2),
        ("tick_interrupt", BREAKPOINT, wire.CoreLoss.HARD_FAULT, 2),
        ("serial_poll", NOWHERE, wire.CoreLoss.BUS_FAULT, 2),
        ("serial_poll", RECURSE, wire.CoreLoss.STACK_OVERFLOW, 2),
        ("tick_interrupt", UNDEFINED, wire.CoreLoss.USAGE_FAULT, 2),
        ("tick_interrupt", BRANCH_TO_ITSELF, wire.CoreLoss.WATCHDOG, WATCHDOG_AND_BOOT_TICKS),
    ],
)
def test_a_lost_program_leaves_zero_volts_and_its_cause(running, place, code, loss, within):
    until_reset(running, symbol(place), code)
    codes, state = lost_core(running)
    assert back_at_zero(codes, within + 1)
    assert state == wire.State.FAULT
    reply = info(running)
    assert reply.last_fault == wire.Fault.CORE_LOST
    assert reply.last_fault_detail >> 28 == loss


def test_a_main_loop_that_hangs_is_found_out_by_the_watchdog(running):
    until_reset(running, symbol("serial_poll"), BRANCH_TO_ITSELF)
    codes, state = lost_core(running)
    assert np.all(np.abs(np.diff(codes[:400])) <= SLEW_CODES)  # the tick still drives
    assert back_at_zero(codes, 500 + WATCHDOG_AND_BOOT_TICKS)
    assert state == wire.State.FAULT
    assert info(running).last_fault == wire.Fault.CORE_LOST


def test_a_crystal_that_stops_ends_the_run_and_the_next_one_says_it_has_none(running):
    running.device.inject(Injection.CRYSTAL_STOPS)
    codes, state = lost_core(running)
    assert back_at_zero(codes, 2)
    assert state == wire.State.FAULT
    assert info(running).last_fault_detail >> 28 == wire.CoreLoss.CLOCK_STOPPED


def test_without_a_crystal_it_starts_on_the_internal_oscillator_and_says_so(start):
    board = start(boot=False)
    board.inject(Injection.NO_CRYSTAL)
    talker = Talker(board)
    talker.run(150)
    talker.ok(wire.HelloRequest())
    assert info(talker).last_fault_detail >> 28 == wire.CoreLoss.NO_CRYSTAL
    assert talker.state == wire.State.FAULT


def test_a_brown_out_is_a_fresh_start_that_is_called_by_its_name(running):
    running.device.inject(Injection.BOR_LEVEL, 0)  # as board.md asks for; test_delays.py has the other case
    running.device.inject(Injection.BROWN_OUT)
    codes = dac(running, 100)
    assert back_at_zero(codes, 2)
    hello = running.ok(wire.HelloRequest())
    assert hello.reset_cause == wire.ResetCause.BROWN_OUT
    assert running.state == wire.State.PARKED


def test_a_save_that_loses_power_falls_back_to_the_model_before(start):
    board = start()
    talker = Talker(board)
    talker.ok(wire.HelloRequest(), *upload(stage_model()))
    assert talker.ask(wire.ModelPersistRequest(), ticks=20_000).status == wire.Status.OK
    other = bytearray(stage_model())
    other[4] ^= 1  # another stage file's hash
    talker.ok(*upload(bytes(other)))
    board.inject(Injection.FLASH_CUT, 128 * 1024 + 100)  # in the middle of programming the record
    board.write(talker.frame(wire.ModelPersistRequest()))
    talker.run(6000)
    hello = talker.ok(wire.HelloRequest())
    assert hello.reset_cause == wire.ResetCause.POWER_ON
    assert hello.model_flags == 0b111  # loaded, a fallback, persisted
    talker.run(1)


@pytest.mark.parametrize("decimation", [1, 7])
def test_a_stream_says_which_ticks_went_by_while_flash_was_busy(start, decimation):
    """Every tick that was asked for is streamed or counted as dropped, and at its place."""
    talker = Talker(start())
    talker.ok(wire.HelloRequest(), *upload(stage_model()), wire.StreamStartRequest(31, 1, decimation))
    talker.run(300)
    assert talker.ask(wire.ModelPersistRequest(), ticks=20_000).status == wire.Status.OK
    talker.run(600)
    stopped = talker.ok(wire.StreamStopRequest())
    talker.run(100)
    assert stopped.dropped_ticks > 2500 / decimation  # an erase takes half a second
    for one, other in itertools.pairwise(talker.samples):
        rows = len(one.data) // 12 + other.dropped - one.dropped
        assert other.first_tick - one.first_tick == rows * decimation
    assert talker.samples[-1].dropped == stopped.dropped_ticks


def test_it_is_back_within_20_ms_with_a_model_in_both_slots(start):
    talker = Talker(start())
    talker.ok(wire.HelloRequest())
    for changed in (0, 1):
        model = bytearray(stage_model())
        model[4] ^= changed
        talker.ok(*upload(bytes(model)))
        assert talker.ask(wire.ModelPersistRequest(), ticks=20_000).status == wire.Status.OK
    flash, _ = talker.device.flash()
    board = start(flash=flash, boot=False)
    board.run(200)
    ns, ticks = board.time()
    assert ticks > 0
    assert ns - ticks * 200_000 < 20_000_000
