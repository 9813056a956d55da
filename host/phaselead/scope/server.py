"""The page's server: static files, saved files, and one websocket for each tab; on this computer alone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import Message
from starlette.websockets import WebSocket, WebSocketDisconnect

from phaselead import interrupt
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model import StageLike, as_stage
from phaselead.scope.access import Access, Guard
from phaselead.scope.hub import Hub
from phaselead.scope.jobs import JOBS
from phaselead.scope.orders import ORDERS
from phaselead.scope.tabs import Tabs
from phaselead.scope.view import View
from phaselead.serial_ports import default_port

ADDRESS = "127.0.0.1"
FRAME_S = 1 / 60
STATE_S = 0.1
SLOW_S = 0.25
"""Between two spectra, or two loops."""
UNSEEN_FRAMES = 2
"""So many are under way at most: a browser that draws slower gets fewer and larger ones, not older ones."""
PING_S, PONG_S = 3.0, 5.0
"""A browser that does not answer is taken for gone."""
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' ws://127.0.0.1:* ws://localhost:*; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


FILE_HEADERS = {
    "Content-Security-Policy": "sandbox allow-scripts",  # a report may not act as the page does
    "X-Content-Type-Options": "nosniff",
}


class Site:
    """The routes of one hub's page."""

    def __init__(self, hub: Hub, access: Access) -> None:
        self.hub, self.access, self.tabs = hub, access, Tabs()
        self._static = Path(str(files("phaselead.scope").joinpath("static")))

    def app(self) -> Starlette:
        return Starlette(
            routes=[
                Route("/", self.index),
                Route("/link", self.link, methods=["POST"]),
                Route("/files/{name}", self.file),
                Mount("/static", StaticFiles(directory=self._static)),
                WebSocketRoute("/ws", self.socket),
            ],
            middleware=[Middleware(Guard, access=self.access)],
        )

    async def index(self, request: Request) -> Response:
        """The page; with a token that has not been used, a cookie and the page's own address."""
        token = request.query_params.get("token")
        if token is None:
            return FileResponse(self._static / "index.html", headers=HEADERS)
        value = self.access.use(token)
        if value is None:
            return PlainTextResponse("this link has been used, or never was one; start `phaselead scope` again\n", 403)
        answer = RedirectResponse("/", 303, HEADERS)
        answer.set_cookie(self.access.cookie, value, httponly=True, samesite="lax")
        return answer

    async def link(self, request: Request) -> Response:
        """Another link, for another browser of this computer."""
        return PlainTextResponse(f"http://{request.headers['host']}/?token={self.access.new_token()}\n")

    async def file(self, request: Request) -> Response:
        """What an order has written."""
        name = request.path_params["name"]
        path = self.hub.folder / name
        if name not in self.hub.files or not path.is_file():
            return PlainTextResponse("no such file was written here\n", 404)
        return FileResponse(path, headers=FILE_HEADERS)

    async def socket(self, socket: WebSocket) -> None:
        """One tab, until it closes."""
        await socket.accept()
        tab = _Tab(socket, self.hub, self.tabs)
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
            await tab.run()


class _Tab:
    """One websocket: sends frames as fast as it takes them, at most 60 a second, and passes orders on."""

    def __init__(self, socket: WebSocket, hub: Hub, tabs: Tabs) -> None:
        self.socket, self.hub, self.tabs = socket, hub, tabs
        self.view, self.name = View(), ""
        self._unseen = 0
        self._pending: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        try:
            first = _parsed(await self.socket.receive_text())
            self.name = self.tabs.enter(str(first.get("tab", ""))[:40])
            self.hub.somebody_looks(len(self.tabs.open))
            jobs = [
                {"name": n, "title": j.title, "what": j.what, "fields": [vars(f) for f in j.fields]}
                for n, j in JOBS.items()
            ]
            await self._send({"welcome": {"tab": self.name, "axes": self.hub.samples.axes, "jobs": jobs}})
            async with asyncio.TaskGroup() as group:
                sending = group.create_task(self._frames())
                listening = group.create_task(self._listen())
                listening.add_done_callback(lambda _: sending.cancel())
        except* (WebSocketDisconnect, RuntimeError, OSError):
            pass
        finally:
            self.tabs.leave(self.name)
            self.hub.somebody_looks(len(self.tabs.open))

    async def _send(self, message: dict[str, Any]) -> None:
        await self.socket.send_text(json.dumps(message))

    async def _listen(self) -> None:
        while True:
            message: Message = await self.socket.receive()
            if message["type"] != "websocket.receive":
                return
            self._heard(_parsed(message.get("text") or ""))

    def _heard(self, message: dict[str, Any]) -> None:
        if message.get("stop"):
            self.hub.stop()
            return
        if "seen" in message:
            self._unseen = 0
            return
        task = asyncio.create_task(self._answer(message))
        self._pending.add(task)
        task.add_done_callback(self._pending.discard)

    async def _answer(self, message: dict[str, Any]) -> None:
        """Of a view, the wish to drive, or an order."""
        reply: dict[str, Any] = {"reply": message.get("id"), "ok": True, "said": ""}
        try:
            if "view" in message:
                self.view = View.of(message["view"] if isinstance(message["view"], dict) else {})
            elif "take" in message:
                if not self.tabs.take(self.name):
                    raise BadInput("another tab drives; close it first")
            elif message.get("order") in ORDERS:
                if self.tabs.driver != self.name:
                    raise BadInput("this tab looks on; the one that was opened first drives, and every tab can stop")
                done = self.hub.give(ORDERS[message["order"]], message)
                reply["said"] = await asyncio.wrap_future(done)
            else:
                raise BadInput(f"{message.get('order')!r} is no order")
        except PhaseleadError as error:
            reply |= {"ok": False, "said": " ".join(str(error).split())}
        with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
            await self._send(reply)

    async def _frames(self) -> None:
        loop = asyncio.get_running_loop()
        stated_s = slow_s = 0.0
        due_s = loop.time()
        said: dict[str, Any] = {}
        while True:
            now_s = loop.time()
            frames: list[bytes | None] = []
            if self._unseen < UNSEEN_FRAMES:
                frames.append(self.view.next(self.hub.samples, self.hub.trigger))
                self._unseen += frames[0] is not None
                if now_s - slow_s >= SLOW_S:
                    slow_s = now_s
                    frames += [self.view.spectrum_frame(self.hub.samples), self.view.loop_frame(self.hub.samples)]
            for frame in frames:
                if frame is not None:
                    await self.socket.send_bytes(frame)
            if now_s - stated_s >= STATE_S:
                stated_s = now_s
                drives = {"drives": self.tabs.driver == self.name, "may_take": self.tabs.may_take()}
                state = self.hub.state() | drives
                changed = {name: value for name, value in state.items() if said.get(name, said) != value}
                said = state
                if changed:
                    await self._send({"state": changed})
            due_s = max(due_s + FRAME_S, loop.time() - FRAME_S)
            await asyncio.sleep(max(0.001, due_s - loop.time()))


def _parsed(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def serve(
    port: str | None = None,
    *,
    axes: str = "xyz",
    model: StageLike | None = None,
    folder: Path = Path(),
    park_after_s: float = 10.0,
    page_port: int = 0,
    say: Callable[[str], None] = print,
    say_link: Callable[[str], None] = print,
) -> None:
    """Serves the scope of the device on ``port`` (default as for ``connect``) until Ctrl-C, which parks it.

    ``axes`` are streamed; ``model`` is what set-points and waveforms use, uploaded when something moves. What the page
    saves goes to ``folder``, which is made. ``page_port``: of 127.0.0.1, 0 for any that is free. ``say_link`` is given
    the link to open, which works once. When no page is open for ``park_after_s`` seconds the device is parked; 0:
    never.

    Raises BadInput for a folder that cannot be made or a page port that is taken; otherwise as ``connect``.
    """
    listener = _listener(page_port)
    with contextlib.closing(listener):
        _make(folder)
        stage = None if model is None else as_stage(model)
        hub = Hub(port or default_port(), axes=axes, stage=stage, folder=folder, park_after_s=park_after_s, say=say)
        try:
            number = listener.getsockname()[1]
            access = Access(number)
            hub.start()
            say_link(f"http://{ADDRESS}:{number}/?token={access.new_token()}")
            config = uvicorn.Config(
                Site(hub, access).app(),
                log_level="warning",
                lifespan="off",
                ws_ping_interval=PING_S,
                ws_ping_timeout=PONG_S,
                ws_per_message_deflate=False,
                timeout_graceful_shutdown=1,
            )
            uvicorn.Server(config).run(sockets=[listener])
        except KeyboardInterrupt:  # it has ended in order; what follows talks to the device
            interrupt.clear()
        finally:
            with interrupt.held(once=True):  # it parks
                say(hub.close())


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: no folder can be made there ({error.strerror}); choose another place") from None


def _listener(page_port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((ADDRESS, page_port))
        listener.listen()  # the link works from the moment that it is said
    except OSError as error:
        listener.close()
        raise BadInput(f"port {page_port} of {ADDRESS} cannot be used ({error.strerror}); choose another") from None
    return listener
