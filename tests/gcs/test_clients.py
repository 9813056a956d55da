"""Many clients, hostile ones, and those that vanish."""

from __future__ import annotations

import socket

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from phaselead.gcs.errors import Code


def test_one_drives_and_the_others_read_and_stop(connect):
    first, second = connect(), connect()
    assert first.does("SVO x 1") == 0
    assert second.does("MOV x 10") == Code.CONTROLLER_BUSY
    assert second.does("WGC 1 3") == Code.CONTROLLER_BUSY
    assert second.value("POS? x") < 1
    assert first.error() == 0
    first.does("VEL x 100")
    assert first.does("MOV x 100") == 0
    assert second.does("STP") == Code.STOP
    assert second.value("MOV? x") < 50
    assert first.error() == 0


def test_the_next_one_drives_when_the_first_has_left(connect):
    first, second = connect(), connect()
    assert first.does("SVO x 1 y 1 z 1") == 0
    first.send("MOV x 30\n")
    first.close()
    second.until(lambda: second.ask("ONT? x") == "x=1\n" and second.value("MOV? x") == 30)
    assert abs(second.value("POS? x") - 30) < 0.3
    second.until(lambda: second.does("MOV x 20") == 0)


def test_a_client_that_vanishes_in_a_move_leaves_the_stage_held(connect):
    first, second = connect(), connect()
    first.does("SVO x 1 y 1 z 1")
    first.does("VEL x 200")
    first.send("MOV x 80\nMOV x 9")  # and half a line
    first.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # a reset, not a goodbye
    first.close()
    second.until(lambda: second.ask("ONT? x") == "x=1\n" and second.value("MOV? x") == 80)
    assert abs(second.value("POS? x") - 80) < 0.3


def test_a_hundred_clients(connect):
    many = [connect() for _ in range(100)]
    for one in many:
        one.send("POS? x\nFOO\nERR?\n")
    for one in many:
        assert one.answer().startswith("x=")
        assert int(one.answer()) == Code.UNKNOWN_COMMAND


def test_errors_belong_to_their_client_and_are_forgotten_when_told(connect):
    first, second = connect(), connect()
    assert first.does("FOO") == Code.UNKNOWN_COMMAND
    first.send("FOO\n")
    assert second.error() == 0
    assert first.error() == Code.UNKNOWN_COMMAND
    assert first.error() == 0


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        (b"MOV x 1 y\n", Code.PARAM_NR),
        (b"MOV\n", Code.MISSING_PARAM),
        (b"MOV x nan\n", Code.PARAM_SYNTAX),
        (b"MOV x 1 X 2\n", Code.DOUBLE_AXIS),
        (b"SVO x 2\n", Code.PARAM_OUT_OF_RANGE),
        (b"POS? w\n", Code.INVALID_AXIS_IDENTIFIER),
        ("MOV µ 1\n".encode(), Code.PARAM_SYNTAX),
        (b"WAV 1 X PNT 1 1 " + b"9" * 70000 + b"\n", Code.COMMAND_TOO_LONG),
        (b"WAV 9 X PNT 1 1 1\n", Code.WAV_INDEX_ERROR),
        (b"WAV 1 X NOISE 1 1 1\n", Code.WAV_TYPE_NOT_SUPPORTED),
        (b"WAV 1 X SIN_P 100 1 1 200 0 50\n", Code.WAV_PARAMETER_OUT_OF_LIMIT),
        (b"WAV 1 X LIN 70000 1 0 70000 0 0\n", Code.WAV_LENGTH_EXCEEDS_LIMIT),
        (b"WAV 1 X PNT 1 3 1 2\n", Code.WAV_PARAMETER_NR),
        (b"GWD? 1 5 7\n", Code.WAV_NOT_DEFINED),
        (b"WGO 4 1\n", Code.WAV_INDEX_ERROR),
        (b"WGO 1 2\n", Code.WGO_BIT_NOT_SUPPORTED),
        (b"DRC 9 x 1\n", Code.INVALID_RECORDER_CHAN),
        (b"DRC 1 q 1\n", Code.INVALID_RECORDER_SRC_CHAN),
        (b"DRC 1 x 99\n", Code.INVALID_RECORDER_SRC_OPT),
        (b"DRR? 1 9999 1\n", Code.NOT_ENOUGH_RECORDED_DATA),
        (b"SPA? 1 0x1\n", Code.UNKNOWN_PARAMETER),
        (b"\x03\n", Code.UNKNOWN_COMMAND),
    ],
)
def test_what_makes_no_sense_has_its_number_and_moves_nothing(connect, sent, code):
    line = connect()
    line.send(sent)
    assert line.error() == code
    assert line.ask("SVO?") == "x=0 \ny=0 \nz=0\n"


def test_stop_is_heard_within_a_half_line(connect):
    line = connect()
    line.does("SVO x 1")
    line.does("VEL x 100")
    line.does("MOV x 100")
    line.send(b"MOV x 2")
    line.send(b"\x18")
    line.send(b"5\n")  # the half line is whole now
    assert line.error() in (0, Code.STOP)
    line.until(lambda: line.ask("ONT? x") == "x=1\n")
    assert line.value("POS? x") < 30


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=400))
def test_whatever_is_sent_the_server_lives_and_says_its_error(connect, data):
    line = connect()
    line.send(data + b"\nERR?\nCSV?\n")
    last = ""
    while last != "2.0\n":
        last = line.answer().splitlines(keepends=True)[-1]
    line.send("ERR?\n")
    assert int(line.answer()) in list(Code)
    line.close()
