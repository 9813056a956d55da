"""A command is not ended by an interrupt that ended the one before it in the same process."""

from __future__ import annotations

import signal

import pytest

from phaselead import interrupt


def test_a_command_begins_with_no_interrupt_asked_for(run):
    before = signal.getsignal(signal.SIGINT)
    try:
        interrupt.install()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.raise_if_asked()
        assert run("info", "--port", "sim://xyz250").status == 0
    finally:
        signal.signal(signal.SIGINT, before)
        interrupt.clear()
