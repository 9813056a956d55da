"""`scope` and `gcs`, which end with Ctrl-C alone, interrupted or cut off from the device while a client drives it."""

from __future__ import annotations

import json
import signal
import socket
import threading
from contextlib import suppress
from random import Random
from urllib.parse import urlsplit
from urllib.request import HTTPCookieProcessor, build_opener

import pytest
import serial
from test_any_moment import (
    ZERO_V_CODE,
    VirtualDevice,
    Watched,
    again,
    device,  # noqa: F401
    state_of,
)
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from phaselead.device import wire

MOMENTS = 8
CALLS = 1500
"""Of the port, among which the moments lie: a server never ends by itself. A client has moved the stage by then."""
SERVERS = {"gcs": ["gcs", "--listen", "127.0.0.1:0", "--axis", "x"], "scope": ["scope", "--no-browser", "--axis", "x"]}
SILENCE = 5
"""Calls of a port that is gone, and then Ctrl-C: the servers look for it until then."""


def gcs_client(listen):
    """Holds x and moves it to and fro, until nobody answers."""
    host, _, port = listen.rpartition(":")
    with suppress(OSError), socket.create_connection((host, int(port)), 60) as line:
        answers = line.makefile("rb")
        line.sendall(b"SVO x 1\nERR?\n")
        target = 20
        while answers.readline():
            target = 70 - target
            line.sendall(b"MOV x %d\nPOS? x\n" % target)


def scope_client(link):
    """The same from a page."""
    browser = build_opener(HTTPCookieProcessor())
    with suppress(OSError, WebSocketException):
        place = urlsplit(link)
        jar = next(handler for handler in browser.handlers if isinstance(handler, HTTPCookieProcessor)).cookiejar
        browser.open(link, timeout=60).close()
        cookies = "; ".join(f"{cookie.name}={cookie.value}" for cookie in jar)
        with connect(
            f"ws://{place.netloc}/ws", origin=f"http://{place.netloc}", additional_headers={"cookie": cookies}
        ) as page:
            page.send(json.dumps({"tab": ""}))
            target, number = 20, 0
            while True:
                said = page.recv(60)
                if isinstance(said, bytes):
                    page.send(json.dumps({"seen": True}))
                elif "welcome" in said or '"reply"' in said:
                    target, number = 70 - target, number + 1
                    order = {"order": "move", "targets": {"x": f"{target}um"}, "mode": "pid", "id": number}
                    page.send(json.dumps(order))


CLIENTS = {"gcs": ("listen", gcs_client), "scope": ("link", scope_client)}


@pytest.fixture
def served(monkeypatch):
    """Clients begin where a server says that it can be reached, and have ended when the test has."""
    threads = []

    def announced(name):
        place, client = CLIENTS[name]

        def emit(figures, *_):
            threads.append(threading.Thread(target=client, args=(figures[place],)))
            threads[-1].start()

        return emit

    for name in SERVERS:
        monkeypatch.setattr(f"phaselead.cli.{name}.emit", announced(name))
    yield
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()


def words(name, folder):
    out = ["--out", str(folder)] if name == "scope" else []
    return [*SERVERS[name], *out, "--port", "sim://xyz250"]


def moments(name):
    random = Random(name)
    return sorted({1, CALLS} | {random.randint(1, CALLS) for _ in range(MOMENTS)})


def ctrl_c():
    """As from a terminal: the main thread is told, whichever thread is at the port."""
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


@pytest.mark.parametrize("name", SERVERS)
def test_ctrl_c_parks_at_any_moment(run, device, served, tmp_path, name):  # noqa: F811
    moved = 0
    for moment in moments(name):
        codes = []

        def end(codes=codes):
            codes.append(device.calls)
            ctrl_c()

        again(device, tmp_path, moment, end)
        outcome = run(*words(name, tmp_path))
        assert outcome.error is None, (moment, outcome)
        assert outcome.status in (0, 130), (moment, outcome)
        assert codes == [moment]
        status = state_of(device)
        assert status is not None, (moment, outcome.err)
        assert (status.state, status.dac_codes) == (wire.State.PARKED, (ZERO_V_CODE,) * 3), (moment, outcome.err)
        moved += any(one.number == wire.ArmRequest.NUMBER for one in device.take_obeyed())
    assert moved >= 3


@pytest.mark.parametrize("name", SERVERS)
def test_a_cable_that_is_pulled_at_any_moment_parks(run, device, served, tmp_path, monkeypatch, name):  # noqa: F811
    def pull():
        left = [SILENCE]

        def gone(*_):
            left[0] -= 1
            if left[0] == 0:
                ctrl_c()
            raise serial.SerialException("device disconnected")

        patch.setattr(Watched, "run", gone)
        patch.setattr(Watched, "write", gone)

    for moment in moments(name):
        with monkeypatch.context() as patch:
            again(device, tmp_path, moment, pull)
            outcome = run(*words(name, tmp_path))
        assert outcome.error is None, (moment, outcome)
        assert outcome.status in (0, 3, 130), (moment, outcome)
        VirtualDevice.run(device, 10_000)
        status = state_of(device)
        assert status is not None
        assert (status.at_rest, status.dac_codes) == (7, (ZERO_V_CODE,) * 3), (moment, outcome.err)
