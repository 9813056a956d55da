"""A controller leaves the device parked, however it is left."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable

import pytest

import phaselead as pl
from phaselead.device import Device

PRINTS_STATE = """
import os, signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored, and stays so
import phaselead as pl
from phaselead.device import Device

close = Device.close

def close_and_print(self):
    print(self.status().state, flush=True)
    close(self)

Device.close = close_and_print
"""
"""A program that says in which state a device is when its port is closed."""


@pytest.fixture(name="left")
def _left(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The state of each device when its port was closed."""
    states: list[str] = []
    close = Device.close

    def close_and_note(device: Device) -> None:
        states.append(device.status().state)
        close(device)

    monkeypatch.setattr(Device, "close", close_and_note)
    return states


def interrupted(_done: float) -> None:
    raise KeyboardInterrupt


def failing(_done: float) -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(("ends", "error"), [(interrupted, KeyboardInterrupt), (failing, ZeroDivisionError)])
def test_while_it_tracks(left: list[str], ends: Callable[[float], None], error: type[BaseException]) -> None:
    with pytest.raises(error), pl.connect() as dev:
        dev.track("sine:60um@5Hz", mode="pid", on_progress=ends)
    assert left == ["parked"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_between_commands(left: list[str], error: type[BaseException]) -> None:
    def program() -> None:
        with pl.connect() as dev:
            assert dev.arm().state == "armed"
            raise error

    with pytest.raises(error):
        program()
    assert left == ["parked"]


def test_at_the_end_of_the_block(left: list[str]) -> None:
    with pl.connect() as dev:
        dev.arm()
    assert left == ["parked"]


def test_close_parks_once(left: list[str]) -> None:
    dev = pl.connect()
    dev.arm()
    dev.close()
    dev.close()
    assert left == ["parked"]


def test_it_stays_armed_where_that_is_asked_for(left: list[str]) -> None:
    with pl.connect(park_on_exit=False) as dev:
        dev.arm()
    assert left == ["armed"]


def test_a_refused_upload_moves_nothing_and_parks(left: list[str]) -> None:
    with pytest.raises(pl.BadInput), pl.connect() as dev:
        dev.upload("nowhere.toml")
    assert left == ["parked"]


@pytest.mark.parametrize(
    ("program", "status"),
    [
        ("dev = pl.connect(); dev.arm()", 0),
        ("with pl.connect() as dev:\n    dev.arm()\n    os.kill(os.getpid(), signal.SIGTERM)", 128 + signal.SIGTERM),
        ("with pl.connect() as dev:\n    dev.arm()\n    os.kill(os.getpid(), signal.SIGHUP)", 128 + signal.SIGHUP),
        ("dev = pl.connect(); dev.arm(); raise SystemExit(3)", 3),
    ],
)
def test_when_the_program_ends(program: str, status: int) -> None:
    done = subprocess.run([sys.executable, "-c", PRINTS_STATE + program], capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.returncode) == (["parked"], status), done.stderr


def test_signals_are_given_back() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)]
    with pl.connect():
        pass
    assert [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)] == before
