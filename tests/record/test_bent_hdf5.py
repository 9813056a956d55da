"""HDF5 files on which HDF5's own library never ends, or crashes: refused in one line."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from phaselead.control import load_learned
from phaselead.errors import BadInput
from phaselead.record import bounded, read_recording, write_hdf5
from phaselead.record.foreign import read_foreign

from recordings import assert_one_line, sine_recording  # isort: skip

HEAP, HEAD = b"GCOL", 16


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """Where the texts of attributes are kept, the free room says that it has no size: the library goes no further."""
    path = tmp_path / "endless.h5"
    write_hdf5(path, sine_recording(n=20))
    content = bytearray(path.read_bytes())
    at = content.index(HEAP) + HEAD
    while content[at] or content[at + 1]:  # objects in use: number, references, size, then the text
        at += HEAD + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at + 8 : at + 16] = bytes(8)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("read", [read_recording, read_foreign, load_learned], ids=lambda read: read.__name__)
def test_a_file_that_never_ends(endless: Path, monkeypatch: pytest.MonkeyPatch, read: Callable[[str], object]) -> None:
    monkeypatch.setattr(bounded, "LIMIT_CPU_S", 1)
    with pytest.raises(BadInput, match="never comes to an end with it") as refusal:
        read(str(endless))
    assert_one_line(refusal.value)


def test_a_file_that_crashes_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rec.h5"
    write_hdf5(path, sine_recording(n=20))
    monkeypatch.setattr(bounded, "_walk", lambda name: os.kill(os.getpid(), signal.SIGSEGV))
    with pytest.raises(BadInput, match="crashes on it"):
        read_recording(path)
