"""The board when every part takes as long as its data sheet allows: each of these delays once kept it from starting, or
would have ended in a fault that is none. docs/emulation.md gives the figures and their sources."""

import struct

import numpy as np
import pytest
from talker import UM, Talker, V
from test_board_faults import BRANCH_TO_ITSELF, IWDG_RELOAD, RELOAD_AT_RESET, ZERO_V, assert_ramps_home, symbol

from phaselead.control.gains import PAPER_GAINS
from phaselead.device import wire
from phaselead.errors import PhaseleadError
from phaselead.sim.emulated import BOARDS, Injection

ADC_SILENT, NO_CONVERSION = 0, 2
"""Details of converter_silent."""
LOCKED_FOR_A_WHILE = struct.pack("<HHHHHHHH", 0xB672, 0xF64F, 0x73FF, 0x3B01, 0xD1FD, 0xB662, 0x2000, 0x4770)
"""cpsid i; movw r3, #65535; 1: subs r3, #1; bne 1b; cpsie i; movs r0, #0; bx lr: about a millisecond without a tick."""


UNUSED_RAM = 0x2001_FFF0
SLOW_ONCE = struct.pack(
    "<10HI", 0xB40C, 0x4A04, 0x6813, 0xB113, 0x3B01, 0xD1FD, 0x6013, 0xBC0C, 0x4770, 0xBF00, UNUSED_RAM
)
"""push {r2, r3}; ldr r2, =UNUSED_RAM; ldr r3, [r2]; cbz r3, 2f; 1: subs r3, #1; bne 1b; str r3, [r2]; 2: pop {r2, r3};
bx lr: takes as long as the word in memory says, once."""


def info(talker):
    return talker.ok(wire.InfoRequest())


def status(talker):
    return talker.ok(wire.StatusRequest())


@pytest.fixture
def idle(start):
    """A board that has just come up."""
    talker = Talker(start())
    talker.ok(wire.HelloRequest())
    return talker


@pytest.fixture
def running(idle):
    idle.drive(swing=8 * V, f_Hz=20)
    idle.run(60)
    idle.device.codes()
    return idle


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("delays", [True, False])
def test_it_comes_up_without_a_fault_and_samples(start, board, delays):
    device = start(board, delays=delays)
    talker = Talker(device)
    talker.ok(wire.HelloRequest())
    talker.run(500)
    said = status(talker)
    assert (said.state, said.fault, said.overruns) == (wire.State.PARKED, wire.Fault.NONE, 0)
    adc, _ = device.codes()
    assert np.abs(adc[-1].astype(int) - said.adc_codes).max() < 20
    assert min(said.adc_codes) > 1000
    facts = info(talker)
    assert (facts.latched_late, facts.lost_ticks) == (0, 0)


def test_nothing_is_late_while_three_axes_move(idle):
    for axis in range(3):
        idle.ok(
            wire.SetAxisRequest(axis, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
            wire.SetPathRequest(axis, wire.PathKind.SINE, 8 * V, 0, round(20 / 5000 * 2**64), 0),
        )
    idle.ok(wire.SetTimeoutRequest(0), wire.ArmRequest(0), wire.StartRequest(7), wire.StreamStartRequest(31, 7, 1))
    idle.run(3000)
    facts = info(idle)
    assert (facts.latched_late, facts.lost_ticks, facts.overruns) == (0, 0, 0)
    assert status(idle).fault == wire.Fault.NONE


def test_a_reply_of_the_dac_that_is_missed_once_is_no_fault(running):
    """Whenever it happens: the DAC is asked every seventh to tenth tick."""
    for wait in range(9, 19):
        running.device.inject(Injection.DAC_SILENT, 1)
        running.run(1)
        running.device.inject(Injection.DAC_SILENT, 0)
        running.run(wait)
    assert status(running).fault == wire.Fault.NONE


def test_a_sample_that_is_missed_once_is_no_fault(running):
    for wait in (1, 2, 5):
        running.device.inject(Injection.ADC_SILENT, 1)
        running.run(1)
        running.device.inject(Injection.ADC_SILENT, 0)
        running.run(wait)
    assert status(running).fault == wire.Fault.NONE


def test_a_confused_adc_is_reset_and_answers_again(running):
    running.device.inject(Injection.ADC_CONFUSED)
    running.run(100)
    said = status(running)
    assert (said.fault, said.state) == (wire.Fault.CONVERTER_SILENT, wire.State.FAULT)
    assert info(running).last_fault_detail == ADC_SILENT
    running.run(1500)
    running.ok(wire.ClearFaultRequest())
    running.run(200)
    assert status(running).fault == wire.Fault.NONE


def test_a_converter_that_answers_without_converting_is_a_fault(running):
    """A broken CONVST wire: BUSY stays low, and FRSTDATA and words look healthy."""
    running.device.inject(Injection.NO_CONVERSION)
    running.run(300)
    codes = running.device.codes()[1][:, 0].astype(int)
    assert_ramps_home(codes, 3)
    assert status(running).fault == wire.Fault.CONVERTER_SILENT
    assert info(running).last_fault_detail == NO_CONVERSION


def test_ticks_that_were_lost_are_counted_and_a_fault(running):
    """The next one comes in time, so nothing but a free counter sees it."""
    before = running.ok(wire.StatusRequest())
    place = symbol("serial_poll")
    original = running.device.peek(place, len(LOCKED_FOR_A_WHILE))
    running.device.poke(place, LOCKED_FOR_A_WHILE)
    running.run(8)
    running.device.poke(place, original)
    running.run(20)
    said = running.ok(wire.StatusRequest())
    facts = info(running)
    assert before.fault == wire.Fault.NONE
    assert said.fault == wire.Fault.TICK_LOST
    assert facts.lost_ticks >= 4
    running.run(1500)
    assert status(running).at_rest == 7


def test_a_tick_that_takes_too_long_is_a_fault(running):
    running.device.poke(UNUSED_RAM, bytes(4))
    running.device.poke(symbol("tick_drive"), SLOW_ONCE)
    running.run(20)
    assert status(running).fault == wire.Fault.NONE
    running.device.poke(UNUSED_RAM, struct.pack("<I", 18_000))  # 0.3 ms
    running.run(1500)
    said = status(running)
    assert (said.fault, said.at_rest, said.overruns) == (wire.Fault.TICK_OVERRUN, 7, 1)


def test_a_sensor_that_freezes_under_feedback_ramps_home(idle):
    gains = PAPER_GAINS
    kp, ki_ts = round(gains.kp_V_per_um * V), round(gains.ki_V_per_um_s / 5000 * 2**32)
    idle.ok(
        wire.SetTimeoutRequest(0),
        wire.SetAxisRequest(0, wire.Mode.PID, kp, ki_ts, round(gains.kd_V_s_per_um * 5000 * V), 0x7FFFFFFF),
        wire.SetPathRequest(0, wire.PathKind.SINE, 60 * UM, 0, round(5 / 5000 * 2**64), 0),
        wire.ArmRequest(0),
        wire.StartRequest(1),
    )
    idle.run(1200)
    assert status(idle).fault == wire.Fault.NONE
    idle.device.inject(Injection.FROZEN, 1)
    idle.run(3000)
    said = status(idle)
    assert (said.fault, said.fault_axis, said.at_rest) == (wire.Fault.SENSOR_FROZEN, 0, 7)


def test_ticks_count_real_time_even_if_some_were_lost(running):
    """What a tick is called is what time it is: no tick number is given twice."""
    first_ns, _ = running.device.time()
    first = running.ok(wire.StatusRequest()).tick
    place = symbol("serial_poll")
    original = running.device.peek(place, len(LOCKED_FOR_A_WHILE))
    running.device.poke(place, LOCKED_FOR_A_WHILE)
    running.run(30)
    running.device.poke(place, original)
    running.run(30)
    last_ns, _ = running.device.time()
    last = running.ok(wire.StatusRequest()).tick
    assert last - first == pytest.approx((last_ns - first_ns) / 200_000, abs=3)


def test_a_brown_out_is_called_so_only_where_the_chip_can_see_it(start):
    """Chips come with their brown-out reset off: then a dip looks like power-on, and `info` says which it is."""
    for option, level, cause in ((3, 0, wire.ResetCause.POWER_ON), (0, 3, wire.ResetCause.BROWN_OUT)):
        board = start(boot=False)
        board.inject(Injection.BOR_LEVEL, option)
        talker = Talker(board)
        talker.run(100)
        board.inject(Injection.BROWN_OUT)
        talker.run(100)
        assert talker.ok(wire.HelloRequest()).reset_cause == cause
        assert info(talker).brown_out_level == level


def test_a_supply_that_falls_clears_the_output_before_the_program_errs(running):
    running.device.inject(Injection.SUPPLY_LOW, 1)
    running.run(300)
    codes = running.device.codes()[1][:, 0].astype(int)
    assert np.all(codes[2:] == ZERO_V)
    running.device.inject(Injection.SUPPLY_LOW, 0)
    running.run(200)
    running.ok(wire.HelloRequest())
    said = status(running)
    assert said.fault == wire.Fault.CORE_LOST
    assert info(running).last_fault_detail >> 28 == wire.CoreLoss.SUPPLY_LOW


def test_the_watchdog_has_its_new_reload_from_the_first_feed_on(start):
    """Fed before the reload had been taken over, it would have half a second of its old one."""
    board = start(boot=False)
    talker = Talker(board)
    talker.run(60)  # from 19 to 24 this start is written to flash, which nobody can read meanwhile
    place = symbol("tick_interrupt")
    original = board.peek(place, 2)
    board.poke(place, BRANCH_TO_ITSELF)
    for _ in range(100):
        talker.run(1)
        if board.peek(IWDG_RELOAD, 4) == RELOAD_AT_RESET:
            break
    board.poke(place, original)  # before the bootloader finds the image damaged
    talker.run(100)
    assert talker.ok(wire.HelloRequest()).reset_cause == wire.ResetCause.WATCHDOG


def test_what_silicon_does_not_forgive_ends_the_run(start):
    """A word for the DAC while another is on its way: else the tests above would prove little."""
    board = start()
    write_twice = struct.pack("<HHHHI", 0x4B01, 0x601B, 0x601B, 0xE7FE, 0x4000_380C)  # ldr r3, =SPI2->DR; str; str
    board.poke(symbol("tick_interrupt"), write_twice)
    with pytest.raises(PhaseleadError, match="while a word was on its way"):
        board.run(20)
