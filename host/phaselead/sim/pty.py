"""A long-lived simulated device on a pseudo-terminal, at real time: the one place here with a wall clock.

Closing and opening the terminal does not reset the device, as with a board that keeps its power.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import sys
import time
import tty
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.sim.device import VirtualDevice
from phaselead.sim.protocol_sim import FlashKeeper, open_device, parse_url

PACE_S = 0.002
"""How finely time is followed; a serial adapter waits as long before it hands bytes on."""
LAG_S = 0.25
"""A machine that was busy or asleep for longer does not catch up: the device has simply stood still."""
CHUNK = 4096


class Wire:
    """The terminal pair. The far end is held open too, so that a client's leaving is no hang-up."""

    def __init__(self) -> None:
        self.near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self.near, False)
        self.path = os.ttyname(self._far)
        self._unsent = b""

    def close(self) -> None:
        os.close(self.near)
        os.close(self._far)

    def receive(self) -> bytes:
        try:
            return os.read(self.near, CHUNK)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise

    @property
    def stalled(self) -> bool:
        """The client does not read; what the device sends meanwhile stays in the device."""
        return bool(self._unsent)

    def send(self, data: bytes) -> None:
        self._unsent += data
        try:
            self._unsent = self._unsent[os.write(self.near, self._unsent) :]
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise


@contextlib.contextmanager
def linked(target: str, link_path: str | os.PathLike[str] | None) -> Iterator[None]:
    """A symbolic link that lives as long as the server; only ever replaces a link."""
    if link_path is None:
        yield
        return
    link = Path(link_path)
    if link.is_symlink():
        link.unlink()
    try:
        link.symlink_to(target)
    except OSError as error:
        raise BadInput(f"{link}: the link cannot be made ({error.strerror}); choose another path") from None
    try:
        yield
    finally:
        if link.is_symlink() and os.readlink(link) == target:
            link.unlink()


@contextlib.contextmanager
def _until_signalled() -> Iterator[Callable[[], bool]]:
    """A flag that Ctrl-C and SIGTERM raise, with the old handlers put back afterwards."""
    ended = False

    def end(_number: int, _frame: FrameType | None) -> None:
        nonlocal ended
        ended = True

    old = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: ended
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def pump(device: VirtualDevice, wire: Wire, keeper: FlashKeeper, ended: Callable[[], bool]) -> None:
    """Runs the device at the pace of the wall clock until ``ended``."""
    start_s, start_tick = time.monotonic(), device.tick
    while not ended():
        try:
            select.select([wire.near], [], [], PACE_S)
        except InterruptedError:
            continue
        if data := wire.receive():
            device.write(data)
        due = start_tick + int((time.monotonic() - start_s) * TICK_HZ) - device.tick
        if due > LAG_S * TICK_HZ:
            start_s, start_tick = time.monotonic(), device.tick
            due = 1
        if due > 0:
            device.run(due)
        wire.send(b"" if wire.stalled else device.read(CHUNK))
        keeper.keep()


def serve(url: str, link_path: str | os.PathLike[str] | None = None, say: Callable[[str], None] | None = None) -> None:
    """Serves the device of a sim:// URL on a pseudo-terminal until Ctrl-C or SIGTERM; prints the terminal's path, or
    gives it to ``say``.

    Raises:
        BadInput: the URL, its stage or state file, or the link cannot be used.
    """
    parsed = parse_url(url)
    device = open_device(parsed)
    keeper = FlashKeeper(device, parsed.state)
    wire = Wire()
    try:
        with _until_signalled() as ended, linked(wire.path, link_path):
            (say or partial(print, flush=True))(wire.path)
            if sys.stderr.isatty():
                print(f"{url} is served there; Ctrl-C ends it", file=sys.stderr)
            pump(device, wire, keeper, ended)
        keeper.keep()
    finally:
        wire.close()
        device.close()
