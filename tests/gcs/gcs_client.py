"""A virtual stage that speaks GCS, in a thread, and a plain socket that talks to it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import Any

from phaselead.gcs import Served, serve

PATIENCE_S = 60.0


class Server:
    """``serve`` in a thread of its own."""

    def __init__(self, **options: Any) -> None:
        self.said: list[str] = []
        self._ready, self._ended = threading.Event(), threading.Event()
        self._options = {"port": "sim://xyz250", "axes": "xyz", **options}
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._ready.wait(PATIENCE_S), self.said

    def _run(self) -> None:
        serve(say=self.said.append, say_ready=self._serves, ended=self._ended, **self._options)

    def _serves(self, where: Served) -> None:
        self.where = where
        self._ready.set()

    @property
    def tcp_port(self) -> int:
        assert self.where.listen is not None
        return int(self.where.listen.rpartition(":")[2])

    def close(self) -> None:
        self._ended.set()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()


class Line:
    """A client without a library."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        self._lines = self.socket.makefile("rb")

    def close(self) -> None:
        """As a program that ends."""
        self._lines.close()
        self.socket.close()

    def send(self, data: str | bytes) -> None:
        self.socket.sendall(data.encode("latin-1") if isinstance(data, str) else data)

    def answer(self) -> str:
        """To its last line, which ends without a space."""
        came = [self._lines.readline()]
        while came[-1].endswith(b" \n"):
            came.append(self._lines.readline())
        assert came[-1], came
        return b"".join(came).decode("latin-1")

    def ask(self, command: str) -> str:
        self.send(command + "\n")
        return self.answer()

    def error(self) -> int:
        return int(self.ask("ERR?"))

    def does(self, command: str) -> int:
        """A command without an answer; its error."""
        self.send(command + "\n")
        return self.error()

    def value(self, query: str) -> float:
        """The number of the last line of an answer."""
        return float(self.ask(query).strip().rpartition("=")[2])

    def until(self, true: Callable[[], bool]) -> None:
        while not true():
            pass
