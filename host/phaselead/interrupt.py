"""Ctrl-C that cannot be lost.

Python drops a KeyboardInterrupt that happens to be raised inside a destructor or a weak-reference callback. A stage
would then run on, so the handler also leaves a mark, and whoever waits for the device looks at it.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_asked = False


def install() -> None:
    """Ends the command that begins here on SIGINT, SIGTERM and SIGHUP alike, with a KeyboardInterrupt. Only in the main
    thread."""
    clear()
    if threading.current_thread() is threading.main_thread():
        for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(ending, _handle)


def _handle(_number: int, _frame: FrameType | None) -> None:
    global _asked
    _asked = True
    raise KeyboardInterrupt


def raise_if_asked() -> None:
    """Raises the KeyboardInterrupt that was asked for and got lost."""
    if _asked:
        raise KeyboardInterrupt


def clear() -> None:
    """From here on the interrupt is being dealt with; the device can be talked to again."""
    global _asked
    _asked = False


@contextmanager
def exit_on_signals() -> Iterator[None]:
    """While it lasts, SIGTERM and SIGHUP end the program as ``sys.exit`` does, so that what is open is closed.

    Only in the main thread, and only where nobody else has asked for these signals.
    """
    taken = []
    if threading.current_thread() is threading.main_thread():
        taken = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, _exit)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _exit(number: int, _frame: FrameType | None) -> None:
    sys.exit(128 + number)
