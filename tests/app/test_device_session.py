"""Who may speak, and that saying it twice does nothing twice."""

import numpy as np
import pytest
from device_bench import SESSION, UM, Bench, V, model, step_of
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.errors import PhaseleadError

OTHER = 0x0BAD_CAFE_0000_0001
COMMANDS = [
    wire.StatusRequest(),
    wire.ArmRequest(0),
    wire.StartRequest(1),
    wire.ParkRequest(),
    wire.ClearFaultRequest(),
    wire.SetAxisRequest(0, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
    wire.SetPathRequest(0, wire.PathKind.SINE, 4 * V, 0, step_of(5), 0),
    wire.WaveChunkRequest(0, 0, bytes(8)),
    wire.WaveCommitRequest(0, 0),
    wire.ModelBeginRequest(wire.Model.SIZE, 0),
    wire.ModelChunkRequest(0, bytes(4)),
    wire.ModelCommitRequest(),
    wire.ModelReadRequest(0, 100),
    wire.ModelPersistRequest(),
    wire.StreamStartRequest(wire.Channel.DAC, 1, 1),
    wire.StreamStopRequest(),
    wire.SnapshotReadRequest(wire.Region.STATE, 0, 100),
    wire.SetTimeoutRequest(1000),
    wire.InfoRequest(),
    wire.MotionRequest(0, 0, 0, 0, UM, 10),
    wire.QueueRequest(1, 0, 0, (wire.Segment(wire.PathKind.HOLD, 1, 0, 0, 0, 0, 100, 0),) * 3),
    wire.SetJoinsRequest(0, 0, 100, 100),
    wire.PointsBeginRequest(1, 0, -100, (1, 1, 1)),
    wire.PointsRequest(1, 0, 0, bytes(8)),
    wire.SetGainsRequest(0, V, 0, 0, 1),
    wire.TriggerSetRequest(0, wire.Mark.TIME, 0, 0, 10, 0),
    wire.WhereRequest(),
    wire.UpdateInfoRequest(),
    wire.UpdateBeginRequest(bytes(64)),
    wire.UpdateChunkRequest(64, bytes(4)),
    wire.UpdateCommitRequest(),
    wire.UpdateConfirmRequest(bytes(20)),
    wire.UpdateRestartRequest(),
    wire.LimitsSetRequest((wire.AxisLimits(0, 65535, 2**32 - 1, 0, 65535),) * 3),
    wire.LimitsReadRequest(),
    wire.FaultLogRequest(),
    wire.TransientArmRequest(wire.Trigger.FAULT, 0, wire.Channel.ADC, 0, 0, 1, 100),
    wire.TransientReadRequest(0, 0),
]


def test_the_list_above_is_complete():
    numbers = {type(command).NUMBER for command in COMMANDS} | {wire.HelloRequest.NUMBER, wire.StopRequest.NUMBER}
    assert numbers == {c.NUMBER for c in wire.Command.__subclasses__()}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.NAME)
def test_without_a_session_only_hello_and_stop_are_heard(command):
    bench = Bench(hello=False)
    assert bench.status_of(command) == wire.Status.NO_SESSION
    bench.ok(wire.StopRequest())
    bench.ok(wire.HelloRequest())
    assert bench.status_of(command, session=OTHER) == wire.Status.NO_SESSION
    assert bench.state == wire.State.PARKED


def test_a_nonce_of_zero_is_no_session():
    bench = Bench(hello=False)
    assert bench.status_of(wire.HelloRequest(), session=0) == wire.Status.BAD_VALUE
    assert bench.status_of(wire.StatusRequest(), session=0) == wire.Status.NO_SESSION


def test_a_second_host_cannot_take_a_device_that_is_being_driven(bench):
    bench.drive()
    assert bench.status_of(wire.HelloRequest(), session=OTHER) == wire.Status.BUSY
    assert bench.status_of(wire.SetTimeoutRequest(0), session=OTHER) == wire.Status.NO_SESSION
    assert bench.state == wire.State.RUNNING


def test_a_second_host_may_have_it_when_the_first_has_timed_out(bench):
    bench.drive()
    bench.run(5001)
    bench.ok(wire.HelloRequest(), session=OTHER)
    assert bench.status_of(wire.StatusRequest()) == wire.Status.NO_SESSION  # the first one is out
    assert bench.ok(wire.StatusRequest(), session=OTHER).fault == wire.Fault.HOST_TIMEOUT


def test_anyone_may_stop(bench):
    bench.drive()
    bench.run(300)
    bench.ok(wire.StopRequest(), session=OTHER)
    bench.run(2000)
    assert bench.state == wire.State.PARKED


def test_a_new_session_inherits_no_settings_but_the_model(bench):
    assert bench.upload(model()).status == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.FF_PID, kp=V) == wire.Status.OK
    assert bench.set_path(0, swing=60 * UM) == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.session = OTHER
    hello = bench.ok(wire.HelloRequest())
    assert hello.model_flags & 1
    assert bench.status().modes == (0, 0, 0)
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(1)) == wire.Status.BAD_VALUE
    bench.run(5001)
    assert bench.status().fault == wire.Fault.HOST_TIMEOUT  # the timeout is back too


def test_hello_again_from_the_same_host_changes_nothing(bench):
    assert bench.set_axis(0, wire.Mode.PID, kp=V) == wire.Status.OK
    bench.ok(wire.HelloRequest())
    assert bench.status().modes == (wire.Mode.PID, 0, 0)
    bench.drive()
    bench.ok(wire.HelloRequest())
    assert bench.state == wire.State.RUNNING


def test_a_region_that_does_not_exist_is_refused(bench):
    bench.ok(wire.HelloRequest())
    for region in wire.Region:
        assert bench.ok(wire.SnapshotReadRequest(region, 0, 100)).size >= 0
    assert bench.status_of(wire.SnapshotReadRequest(len(wire.Region), 0, 100)) == wire.Status.BAD_VALUE


def state_of(bench):
    """Control state as a recording would carry it, less what time alone changes."""
    bench.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    reply = bench.ok(wire.SnapshotReadRequest(wire.Region.STATE, 0, 1024))
    bench.ok(wire.StreamStopRequest())
    return reply.data[24:]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.NAME)
def test_a_repeated_request_is_answered_alike_and_done_once(command):
    once, twice = Bench(), Bench()
    for bench in (once, twice):
        bench.set_axis()
        bench.set_path()
        bench.ok(wire.ArmRequest(0))
    frame = once.frame(command)
    assert twice.frame(command) == frame
    first_once, first_twice = once.raw(frame), twice.raw(frame)
    assert first_once == first_twice
    once.run(3)
    for _ in range(3):
        again = twice.raw(frame)
        if not isinstance(
            command, (wire.SnapshotReadRequest, wire.ModelReadRequest, wire.FaultLogRequest, wire.TransientReadRequest)
        ):  # reads may be done again
            assert again == first_twice
    assert state_of(once) == state_of(twice)


def test_a_repeated_start_does_not_restart_the_path(bench):
    bench.set_axis()
    bench.set_path()
    bench.ok(wire.ArmRequest(0))
    frame = bench.frame(wire.StartRequest(1))
    first = bench.raw(frame)
    bench.run(400)
    high = int(bench.dac[-1, 0])
    assert bench.raw(frame) == first
    assert abs(int(bench.dac[-1, 0]) - high) < 200


def test_the_same_number_with_another_content_is_another_command(bench):
    bench.set_axis()
    number = 77
    assert bench.status_of(wire.SetTimeoutRequest(5), id=number) == wire.Status.OK
    assert bench.ask(wire.StatusRequest(), id=number).state == wire.State.PARKED


def test_strangers_do_not_feed_the_host_timeout(bench):
    bench.drive()
    for _ in range(6):
        bench.run(999)
        bench.ask(wire.StatusRequest(), session=OTHER)
        bench.ask(wire.HelloRequest(), session=OTHER + 1)
    assert bench.events[-1].value == wire.State.FAULT


def test_unknown_commands_and_wrong_lengths_are_refused(bench):
    def status(number, payload):
        body = wire.HEADER.pack(number, 9, SESSION) + payload
        (reply,) = bench.raw(wire_frame(body))
        return wire.Status(reply[wire.HEADER.size])

    assert status(0x60, b"") == wire.Status.UNKNOWN_COMMAND
    assert status(wire.Samples.NUMBER, b"") == wire.Status.UNKNOWN_COMMAND
    assert status(wire.ArmRequest.NUMBER, b"123") == wire.Status.BAD_LENGTH
    assert status(wire.ArmRequest.NUMBER, b"12345") == wire.Status.BAD_LENGTH
    assert status(wire.WaveChunkRequest.NUMBER, b"12") == wire.Status.BAD_LENGTH


def wire_frame(body):
    from phaselead.device.framing import encode_frame

    return encode_frame(body)


def test_damaged_frames_are_counted_and_not_answered(bench):
    frame = bytearray(bench.frame(wire.StatusRequest()))
    frame[3] ^= 0x41
    assert bench.raw(bytes(frame)) == []
    assert bench.raw(b"\x05\x01\0") == []
    assert bench.status().rx_errors == 2


@settings(max_examples=30, deadline=None)
@given(pieces=st.lists(st.integers(1, 40), min_size=1, max_size=12))
def test_frames_may_come_in_any_pieces(pieces):
    bench = Bench()
    line = b"".join(bench.frame(wire.SetTimeoutRequest(ticks)) for ticks in range(1, 9))
    bench.replies.clear()
    while line:
        size = pieces[len(line) % len(pieces)]
        bench.firmware.write(line[:size])
        line = line[size:]
    bench.run(20)
    assert [reply[wire.HEADER.size] for reply in bench.replies] == [wire.Status.OK] * 8


def test_a_copy_that_comes_late_is_not_carried_out_again(bench):
    """Only the last replies are kept; a copy of an older request was obeyed once more."""
    bench.firmware.take_obeyed()
    late = bench.frame(wire.SetTimeoutRequest(9))
    bench.raw(late)
    for ticks in range(100):
        bench.ok(wire.SetTimeoutRequest(1000 + ticks))
        assert len(bench.raw(late)) <= 1
    obeyed = [one.id for one in bench.firmware.take_obeyed()]
    assert len(obeyed) == len(set(obeyed)) == 101


def test_a_request_that_others_overtook_is_carried_out(bench):
    overtaken = [bench.frame(wire.SetTimeoutRequest(1000 + ticks)) for ticks in range(60)]
    bench.ok(wire.StatusRequest())
    bench.firmware.take_obeyed()
    for frame in reversed(overtaken):
        assert len(bench.raw(frame)) == 1
    assert len(bench.firmware.take_obeyed()) == 60


def test_numbers_may_wrap_around(bench):
    bench.firmware.take_obeyed()
    for id in (*range(0x7FF0, 0xFFF0, 0x400), *range(0xFFF0, 0x10000), *range(1, 20)):
        assert bench.status_of(wire.SetTimeoutRequest(1000 + id), id=id) == wire.Status.OK
    assert len(bench.firmware.take_obeyed()) == 32 + 16 + 19


def test_the_account_of_what_was_carried_out_says_when_it_is_not_whole(bench):
    bench.firmware.take_obeyed()
    for _ in range(4097):
        bench.firmware.write(bench.frame(wire.StopRequest()))
        bench.firmware.run_codes(np.full((1, 3), 20_000, np.uint16))
    with pytest.raises(PhaseleadError, match="4097 commands were carried out, only the last 4096 are known"):
        bench.firmware.take_obeyed()
