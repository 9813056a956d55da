"""Where it may be served, what is refused before anything is opened, and that it parks in the end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys

import pytest
import serial
from gcs_client import Line, Server

import phaselead as pl
from phaselead.gcs.lines import loopback


def test_only_this_computer_may_connect():
    assert loopback("127.0.0.1:50000") == ("127.0.0.1", 50000)
    assert loopback("localhost:0") == ("127.0.0.1", 0)
    assert loopback("[::1]:5") == ("::1", 5)
    for listen in ("0.0.0.0:50000", "192.168.1.5:50000", "[::]:50000"):
        with pytest.raises(pl.BadInput, match="only this computer"):
            loopback(listen)
    for listen in ("50000", "stage:50000", "127.0.0.1:", "127.0.0.1:99999", ""):
        with pytest.raises(pl.BadInput, match=r"write|is 0"):
            loopback(listen)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"link": "./pi"}, "--pty too"),
        ({"axes": "xz", "model": "sim"}, "no axis z"),
        ({"pty": True, "link": "nowhere/pi"}, "cannot be made"),
        ({"model": "nowhere.toml"}, "cannot be read"),
    ],
)
def test_what_makes_no_sense(options, words, tmp_path, monkeypatch, one_axis):
    monkeypatch.chdir(tmp_path)
    if options.get("model") == "sim":
        options = options | {"model": one_axis}
    with pytest.raises(pl.BadInput, match=words):
        pl.gcs("sim://xyz250", listen="127.0.0.1:0", say_ready=lambda served: pytest.fail(str(served)), **options)


@pytest.fixture(scope="module")
def one_axis():
    with pl.connect() as dev:
        return pl.fit(dev.record("sine:5V@5Hz", duration=1)).model


def test_a_port_that_is_taken():
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(pl.BadInput, match="cannot be used"):
        pl.gcs("sim://xyz250", listen=f"127.0.0.1:{taken.getsockname()[1]}")


def test_axes_and_mode_of_a_model(one_axis):
    server = Server(listen="127.0.0.1:0", axes=None, model=one_axis)
    line = Line(server.tcp_port)
    assert line.ask("SAI?") == "x\n"
    assert line.does("SVO x 1") == 0
    low, high = line.value("TMN? x"), line.value("TMX? x")
    assert low < 1 < 100 < high < 270  # what the inverse reaches, not what the sensor sees
    for um, code in ((high, 0), (high + 0.1, 7), (low - 0.1, 7)):
        assert line.does(f"MOV x {um:.5f}") == code
    assert line.value("VEL? x") > 1000
    line.close()
    server.close()


def test_a_terminal_is_read_by_one_program_after_another(tmp_path):
    server = Server(pty=True, link=tmp_path / "pi")
    assert server.where.listen is None
    for _ in range(2):
        with serial.Serial(str(tmp_path / "pi"), timeout=60) as port:
            port.write(b"SVO x 1\nERR?\n")
            assert port.readline() == b"0\n"
            port.write(b"\x07")
            assert port.readline() == b"\xb1\n"
    server.close()
    assert not (tmp_path / "pi").is_symlink()


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_the_command_parks_when_it_is_ended(ending, tmp_path):
    """The device is one that stays: it is asked afterwards."""
    words = [sys.executable, "-m", "phaselead"]
    with subprocess.Popen([*words, "sim", "--pty", "--json", "-"], stdout=subprocess.PIPE, text=True) as stage:
        lines = iter(stage.stdout.readline, "")
        port = next(line.split('"')[3] for line in lines if "port" in line)
        command = [*words, "gcs", "--port", port, "--listen", "127.0.0.1:0", "--json", "-"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ) as server:
            where = next(line.split('"')[3] for line in iter(server.stdout.readline, "") if "listen" in line)
            line = Line(int(where.rpartition(":")[2]))
            assert line.does("SVO x 1") == 0
            assert line.does("MOV x 30") == 0
            server.send_signal(ending)
            assert server.wait(60) in (0, 130, 143)
            line.close()
        with pl.connect(port) as dev:
            assert dev.status().state == "parked"
        stage.terminate()
        stage.wait(60)


def test_a_fault_switches_the_servos_off_and_is_told_once():
    """Gains that no stage stands."""
    server = Server(listen="127.0.0.1:0", axes="x", mode="pid", gains=(0.0, 400.0, 0.0))
    line, other = Line(server.tcp_port), Line(server.tcp_port)
    line.send("SVO x 1\nMOV x 60\n")
    line.until(lambda: line.ask("SVO? x") == "x=0\n")
    for one in (line, other):
        one.until(lambda one=one: one.error() == 1024)
        assert one.error() == 0
    assert line.does("MOV x 1") == 5
    assert any("fault" in said for said in server.said)
    for one in (line, other):
        one.close()
    server.close()


def test_a_port_that_goes_away_is_error_52_and_comes_back(tmp_path):
    words = [sys.executable, "-m", "phaselead", "sim", "--pty", "--link", str(tmp_path / "stage")]

    def stage():
        found = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert found.stdout.readline()
        return found

    first = stage()
    server = Server(listen="127.0.0.1:0", axes="x", port=str(tmp_path / "stage"))
    line = Line(server.tcp_port)
    assert line.does("SVO x 1") == 0
    first.kill()
    first.wait()
    line.until(lambda: line.does("SVO x 1") == 52)
    line.send(b"\x07")
    assert line.answer() == "\xb0\n"
    with stage() as second:
        line.until(lambda: line.does("SVO x 1") == 0)
        assert line.ask("SVO? x") == "x=1\n"
        line.close()
        server.close()
        second.terminate()
