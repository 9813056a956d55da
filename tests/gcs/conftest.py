"""A server for a file's tests, and clients of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from gcs_client import Line, Server


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """On a socket and a pseudo-terminal."""
    made = Server(listen="127.0.0.1:0", pty=True)
    yield made
    made.close()


@pytest.fixture
def connect(server: Server) -> Iterator[Callable[[], Line]]:
    """Clients; what they have left is parked."""
    with ExitStack() as stack:

        def connected() -> Line:
            line = Line(server.tcp_port)
            stack.callback(line.close)
            return line

        yield connected
    last = Line(server.tcp_port)
    last.until(lambda: last.does("SVO x 0 y 0 z 0") == 0)
    last.close()
