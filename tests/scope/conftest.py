"""A scope of the virtual stage, and tabs that talk to it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketTestSession

from phaselead.scope.access import Access
from phaselead.scope.hub import Hub
from phaselead.scope.server import Site

PAGE = 8123
HERE = f"http://127.0.0.1:{PAGE}"
SOCKET = f"ws://127.0.0.1:{PAGE}/ws"
PATIENCE_S = 60.0


class Tab:
    """One websocket: keeps every frame and the newest state."""

    def __init__(self, socket: WebSocketTestSession, name: str = "") -> None:
        self.socket, self.state, self.frames = socket, {}, []
        self._number = 0
        self._replies: dict[int, dict[str, Any]] = {}
        self.socket.send_json({"tab": name})
        self.welcome = self.socket.receive_json()["welcome"]

    def hear(self) -> None:
        message = self.socket.receive()
        if message.get("bytes"):
            self.frames.append(message["bytes"])
            self.socket.send_json({"seen": True})
            return
        said = json.loads(message["text"])
        self.state |= said.get("state", {})
        if "reply" in said:
            self._replies[said["reply"]] = said

    def until(self, true: Callable[[], Any]) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not true():
            assert time.monotonic() < end_s, self.state
            self.hear()

    def ask(self, **message: Any) -> dict[str, Any]:
        self._number += 1
        number = self._number
        self.socket.send_json({**message, "id": number})
        self.until(lambda: number in self._replies)
        return self._replies[number]

    def order(self, name: str, /, **given: Any) -> str:
        """What a good order says."""
        reply = self.ask(order=name, **given)
        assert reply["ok"], reply
        return str(reply["said"])

    def refused(self, name: str, /, **given: Any) -> str:
        """The line of one that is refused."""
        reply = self.ask(order=name, **given)
        assert not reply["ok"], reply
        assert "\n" not in reply["said"]
        return str(reply["said"])


class Rig:
    """A hub, its site, a browser that has used the link."""

    def __init__(self, hub: Hub) -> None:
        self.hub, self.access = hub, Access(PAGE)
        self.site = Site(hub, self.access)
        self.stack = ExitStack()
        self.browser = self.stack.enter_context(TestClient(self.site.app(), base_url=HERE))
        self.browser.get("/", params={"token": self.access.new_token()})

    def stranger(self) -> TestClient:
        """A browser without the cookie."""
        return TestClient(self.site.app(), base_url=HERE)

    def open(self, name: str = "", origin: str = HERE) -> Tab:
        socket = self.stack.enter_context(self.browser.websocket_connect(SOCKET, headers={"origin": origin}))
        return Tab(socket, name)


@pytest.fixture
def make_rig(tmp_path: Path) -> Iterator[Callable[..., Rig]]:
    with ExitStack() as stack:

        def made(port: str = "sim://xyz250", **options: Any) -> Rig:
            hub = Hub(port, folder=tmp_path, **options)
            stack.callback(hub.close)
            hub.start()
            rig = Rig(hub)
            stack.callback(rig.stack.close)
            return rig

        yield made


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    return make_rig()
