"""Serves a stage to programs that speak PI's General Command Set."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from phaselead import interrupt
from phaselead.control import GainsLike, held_stage
from phaselead.errors import BadInput
from phaselead.gcs.axes import Axes
from phaselead.gcs.commands import Stage
from phaselead.gcs.lines import DEFAULT, Terminal, loopback, tcp
from phaselead.gcs.service import Service
from phaselead.model import StageLike, as_stage
from phaselead.scope import Hub
from phaselead.serial_ports import default_port
from phaselead.sim import linked


@dataclass(frozen=True)
class Served:
    """Where a stage can be reached."""

    listen: str | None
    terminal: str | None
    axes: str


def serve(
    port: str | None = None,
    *,
    listen: str | None = None,
    pty: bool = False,
    link: str | os.PathLike[str] | None = None,
    axes: str | None = None,
    model: StageLike | None = None,
    mode: str | None = None,
    gains: GainsLike | None = None,
    say: Callable[[str], None] = print,
    say_ready: Callable[[Served], None] = print,
    ended: threading.Event | None = None,
) -> None:
    """Serves the device on ``port`` (default as for ``connect``) until Ctrl-C, or until ``ended`` is set; then parks.

    ``listen`` is an address and port of this computer, "127.0.0.1:50000" unless it is served on a pseudo-terminal
    (``pty``) alone; ``link`` a symbolic link to that. ``axes``: default those of ``model``, else of the model that the
    device holds, else x. They are held in ``mode`` with ``gains``, by default as ``move`` chooses. ``say`` is told what
    a person should know, ``say_ready`` where it is served.

    Raises BadInput for an address that is not of this computer or taken, a link that cannot be made, or axes that the
    model has not; otherwise as ``connect``.
    """
    address = loopback(listen or DEFAULT) if listen is not None or not pty else None
    if link is not None and not pty:
        raise BadInput("a link is made to a pseudo-terminal: give --pty too")
    stage = None if model is None else as_stage(model)
    if stage is not None and axes is not None and (lacks := sorted(set(axes) - set(stage.axes))):
        raise BadInput(f"the model has no axis {lacks[0]}; it has {', '.join(sorted(stage.axes))}")
    hub = Hub(port or default_port(), stage=stage, park_after_s=0, say=say)
    try:
        letters = axes or "".join(sorted(stage.axes if stage is not None else _held_axes(hub)))
        service = Service(Stage(hub, Axes(hub.dev, letters, stage, mode, gains)), say)
        hub.start()
        asyncio.run(_serve(service, address, pty, link, say_ready, ended))
    except KeyboardInterrupt:  # it has ended in order; what follows talks to the device
        interrupt.clear()
    finally:
        with interrupt.held(once=True):  # it parks
            hub.close()


def _held_axes(hub: Hub) -> str:
    held = held_stage(hub.dev.device)
    return "x" if held is None else "".join(held.axes)


async def _serve(
    service: Service,
    address: tuple[str, int] | None,
    pty: bool,
    link: str | os.PathLike[str] | None,
    say_ready: Callable[[Served], None],
    ended: threading.Event | None,
) -> None:
    end = asyncio.Event()
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(_ended_by_signals(end.set))
        where = None if address is None else await stack.enter_async_context(tcp(service, *address))
        tasks = [asyncio.create_task(service.watch())]
        path = None
        if pty:
            terminal = Terminal()
            stack.callback(terminal.close)
            stack.enter_context(linked(terminal.path, link))
            tasks.append(asyncio.create_task(terminal.serve(service)))
            path = terminal.path
        if ended is not None:
            tasks.append(asyncio.create_task(_wait(ended, end)))
        say_ready(Served(where, path, service.stage.axes.letters))
        ending = asyncio.create_task(end.wait())
        done, _ = await asyncio.wait([ending, *tasks], return_when=asyncio.FIRST_COMPLETED)
        for task in [ending, *tasks]:
            task.cancel()
        await asyncio.gather(ending, *tasks, return_exceptions=True)
        for task in done - {ending}:
            task.result()


async def _wait(ended: threading.Event, end: asyncio.Event) -> None:
    while not ended.is_set():
        await asyncio.sleep(0.02)
    end.set()


@contextlib.contextmanager
def _ended_by_signals(end: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP call ``end`` meanwhile; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    before = {number: signal.getsignal(number) for number in interrupt.ENDING}
    for number in before:
        loop.add_signal_handler(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            loop.remove_signal_handler(number)
            signal.signal(number, handler)
