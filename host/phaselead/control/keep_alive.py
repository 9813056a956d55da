"""Tells a device that its host lives, while Python waits for the user between two calls."""

from __future__ import annotations

import contextlib
import threading

from phaselead.device import Session, wire
from phaselead.errors import PhaseleadError

HOST_TIMEOUT_S = 1.0
"""The device's, until it is told another (docs/firmware.md)."""
PERIOD_S = HOST_TIMEOUT_S / 4


class KeepAlive:
    """Asks for the status four times a second whenever nobody else speaks. A process that is killed falls silent, and
    the device parks by itself."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Again after it was ended by an error. Nothing to do in virtual time, which stands still between two calls."""
        if self._session.virtual or (self._thread is not None and self._thread.is_alive()):
            return
        self._thread = threading.Thread(target=self._run, name="phaselead keep-alive", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Returns when it has ended. A second time does nothing."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._ended.clear()

    def _run(self) -> None:
        lock = self._session.lock
        with contextlib.suppress(PhaseleadError, OSError):  # a device that is gone is found by the next call
            while not self._ended.wait(PERIOD_S):
                if lock.acquire(blocking=False):  # who holds it is speaking
                    try:
                        self._session.request(wire.StatusRequest())
                    finally:
                        lock.release()
