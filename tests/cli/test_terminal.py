"""Commands from separate processes against one device on a pseudo-terminal, and against ports that are none."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import serial

COMMAND = (sys.executable, "-m", "phaselead")


def phaselead(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[str]:
    """A device on a pseudo-terminal; the path of the port."""
    link = tmp_path_factory.mktemp("port") / "stage"
    server = subprocess.Popen([*COMMAND, "sim", "--pty", "--link", str(link)], stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    assert server.stdout.readline(), "the server says where it serves before anyone connects"
    yield str(link)
    server.send_signal(signal.SIGINT)
    assert server.wait(timeout=30) in (0, 130)
    assert not link.exists()


def state(port: str) -> str:
    outcome = phaselead("status", "--port", port, "--json", "-")
    assert outcome.returncode == 0, outcome.stderr
    return str(json.loads(outcome.stdout)["state"])


def test_what_one_process_armed_the_next_one_finds_parked(served):
    armed = phaselead("arm", "--port", served, "--json", "-")
    assert json.loads(armed.stdout)["state"] == "armed"
    assert state(served) in ("parked", "stopping")
    assert phaselead("park", "--port", served).returncode == 0
    assert state(served) == "parked"


def test_stop_needs_no_session(served):
    assert phaselead("arm", "--port", served).returncode == 0
    outcome = phaselead("stop", "--port", served, "--json", "-")
    assert outcome.returncode == 0, outcome.stderr
    assert json.loads(outcome.stdout)["stopped"] is True
    assert state(served) in ("parked", "stopping")


def test_track_over_the_terminal_drops_nothing_and_replays(served, tmp_path):
    output = tmp_path / "run.h5"
    arguments = ("sine:40um@10Hz", "--mode", "pid", "--duration", 0.5, "-o", output, "--json", "-")
    outcome = phaselead("track", *arguments, "--port", served)
    assert outcome.returncode == 0, outcome.stderr
    figures = json.loads(outcome.stdout)
    assert figures["ticks"] == 2500
    assert figures["dropped"] == 0
    assert phaselead("replay", output).returncode == 0


def test_a_port_in_use_is_told(served):
    with serial.Serial(served, exclusive=True):
        outcome = phaselead("status", "--port", served)
    assert outcome.returncode == 3
    assert outcome.stderr.count("\n") == 1
    assert "in use" in outcome.stderr or "busy" in outcome.stderr


def tracking(served, output, journal):
    """A process that tracks, once some of it is in its journal."""
    arguments = ["track", "sine:40um@1Hz", "--mode", "pid", "--duration", "60", "-o", str(output), "--port", served]
    running = subprocess.Popen([*COMMAND, *arguments], stderr=subprocess.PIPE, text=True)
    while not journal.exists() or journal.stat().st_size < 50_000:  # bounded by the wait for the process
        assert running.poll() is None
    return running


def test_interrupt_leaves_the_output_parked_and_the_journal_recoverable(served, tmp_path):
    output, journal = tmp_path / "run.h5", tmp_path / "run.h5.journal"
    running = tracking(served, output, journal)
    running.send_signal(signal.SIGINT)
    _, error = running.communicate(timeout=60)
    assert running.returncode == 130
    assert error.strip().splitlines()[-1].startswith("phaselead: interrupted")
    assert state(served) == "parked"
    assert not output.exists()
    recovered = phaselead("log", "recover", journal, "-o", output, "--json", "-")
    assert recovered.returncode == 0, recovered.stderr
    assert json.loads(recovered.stdout)["samples"] > 0


def test_kill_9_leaves_a_device_that_goes_home_by_itself_and_a_journal(served, tmp_path):
    output, journal = tmp_path / "run.h5", tmp_path / "run.h5.journal"
    running = tracking(served, output, journal)
    running.kill()
    running.communicate(timeout=60)
    assert running.returncode == -signal.SIGKILL
    told = phaselead("status", "--port", served, "--json", "-")  # waits until the device has given its host up
    assert told.returncode == 0, told.stderr
    assert (json.loads(told.stdout)["state"], json.loads(told.stdout)["fault"]) == ("fault", "host_timeout")
    assert phaselead("park", "--port", served).returncode == 0
    assert not output.exists()
    recovered = phaselead("log", "recover", journal, "-o", output, "--json", "-")
    assert recovered.returncode == 0, recovered.stderr
    assert json.loads(recovered.stdout)["samples"] > 0


@contextmanager
def line(answer: bytes) -> Iterator[str]:
    """A terminal that answers everything with these bytes (nothing, when there are none)."""
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    port = os.ttyname(theirs)

    def talk() -> None:
        try:
            while os.read(ours, 4096):
                if answer:
                    os.write(ours, answer)
        except OSError:
            return

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    try:
        yield port
    finally:
        os.close(theirs)
        os.close(ours)
        thread.join(timeout=10)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", ("nothing answers", "cable")),
        (b"ok 25.1 C\r\nok 25.2 C\r\n", ("not phaselead", "other firmware")),
    ],
)
def test_a_line_on_which_something_else_lives(answer, words):
    with line(answer) as port:
        outcome = phaselead("status", "--port", port)
    assert outcome.returncode == 3
    assert outcome.stderr.count("\n") == 1
    for word in words:
        assert word in outcome.stderr
