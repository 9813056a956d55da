"""Where GCS is spoken: a TCP port of this computer, a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import os
import tty
from collections.abc import AsyncIterator

from phaselead.errors import BadInput
from phaselead.gcs.service import Service
from phaselead.gcs.syntax import CODEPAGE

CHUNK = 4096
DEFAULT = "127.0.0.1:50000"
"""The port of PI's controllers."""
ABSENT_S = 0.02
"""How often a pseudo-terminal without a client is looked at."""


def loopback(listen: str) -> tuple[str, int]:
    """Address and port of ``127.0.0.1:50000``, ``localhost:50000`` or ``[::1]:50000``. Raises BadInput for anything
    that another computer could reach."""
    host, _, number = listen.rpartition(":")
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
        port = int(number)
    except ValueError:
        raise BadInput(f"{listen!r} is no address and port; write e.g. {DEFAULT}") from None
    if not address.is_loopback:
        raise BadInput(f"{listen}: only this computer may connect: nobody asks who moves the stage; write {DEFAULT}")
    if not 0 <= port <= 65535:
        raise BadInput(f"{listen}: a port is 0 (any that is free) to 65535")
    return str(address), port


@contextlib.asynccontextmanager
async def tcp(service: Service, address: str, port: int) -> AsyncIterator[str]:
    """Serves clients there; gives where. Raises BadInput."""

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        one = service.joined()
        tasks.add(asyncio.current_task())
        try:
            while data := await reader.read(CHUNK):
                for asked in one.reader.feed(data):
                    if (said := await service.answer(one, asked)) is not None:
                        writer.write(said.encode(CODEPAGE))
                        await writer.drain()
        except (OSError, asyncio.CancelledError):  # it has vanished, or the server ends
            pass
        finally:
            tasks.discard(asyncio.current_task())
            service.left(one)
            writer.close()

    tasks: set[asyncio.Task[None] | None] = set()
    try:
        server = await asyncio.start_server(client, address, port, limit=CHUNK)
    except OSError as error:
        raise BadInput(f"{address}:{port} cannot be used ({os.strerror(error.errno or 0)}); choose another") from None
    try:
        number = server.sockets[0].getsockname()[1]
        yield f"[{address}]:{number}" if ":" in address else f"{address}:{number}"
    finally:
        server.close()
        for task in tasks:
            if task is not None:
                task.cancel()
        await asyncio.gather(*(task for task in tasks if task is not None), return_exceptions=True)


class Terminal:
    """A pseudo-terminal: any serial program opens ``path``."""

    def __init__(self) -> None:
        self._near, far = os.openpty()
        self.path = os.ttyname(far)
        tty.setraw(far)
        os.close(far)  # so that a client's leaving is seen
        os.set_blocking(self._near, False)

    def close(self) -> None:
        os.close(self._near)

    async def serve(self, service: Service) -> None:
        """One client after another."""
        while True:
            client = service.joined()
            try:
                while (data := await self._read()) is not None:
                    for asked in client.reader.feed(data):
                        if (said := await service.answer(client, asked)) is not None:
                            await self._write(said.encode(CODEPAGE))
            finally:
                service.left(client)
            await asyncio.sleep(ABSENT_S)

    async def _read(self) -> bytes | None:
        """What has come; None when nobody has the terminal open."""
        while True:
            try:
                return os.read(self._near, CHUNK)
            except OSError as error:
                if error.errno == errno.EIO:
                    return None
                if error.errno != errno.EAGAIN:
                    raise
            await self._ready(reading=True)

    async def _write(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._near, data) :]
            except OSError as error:
                if error.errno == errno.EIO:
                    return
                if error.errno != errno.EAGAIN:
                    raise
                await asyncio.sleep(ABSENT_S)

    async def _ready(self, *, reading: bool) -> None:
        loop, came = asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(self._near, came.set)
        try:
            await came.wait()
        finally:
            loop.remove_reader(self._near)
