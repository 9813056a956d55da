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

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_asked = False
_held: list[int] = []
"""Signals that wait until ``held`` is left."""


def install() -> None:
    """Ends the command that begins here on SIGINT, SIGTERM and SIGHUP alike, with a KeyboardInterrupt. Only in the main
    thread."""
    clear()
    if threading.current_thread() is threading.main_thread():
        for ending in ENDING:
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
def held(*, once: bool = False) -> Iterator[None]:
    """What asks the program to end waits until this is done; with ``once`` a second time does not.

    For what must not be left in the middle: an exchange, or a library that calls back and cannot bear an exception
    there. Only in the main thread, which alone is given signals.
    """
    if threading.current_thread() is not threading.main_thread() or _held:
        yield
        return

    def hold(number: int, _frame: FrameType | None) -> None:
        if _held and once:
            raise KeyboardInterrupt
        _held.append(number)

    before = {number: signal.signal(number, hold) for number in ENDING if signal.getsignal(number) is not None}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        came = _held[:1]
        _held.clear()
    if came:
        signal.raise_signal(came[0])


def raise_if_held() -> None:
    """Raises the KeyboardInterrupt that waits, where something long can be left after all."""
    if _held:
        raise KeyboardInterrupt


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
