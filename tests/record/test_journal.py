"""The journal survives a kill at any byte, and says what was lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.record.journal import JournalWriter, is_being_written, read_journal

from recordings import assert_one_line  # isort: skip

HEADER = {"version": "0.1.0", "axes": ["x"]}
ENTRIES = [("hello", b"\x00\x01"), ("samples", bytes(range(200))), ("note", b""), ("samples", b"\n{}phaselead-journal")]


def journal(path: Path, entries: list[tuple[str, bytes]]) -> bytes:
    with JournalWriter(path, HEADER) as writer:
        for kind, payload in entries:
            writer.append(kind, payload)
    return path.read_bytes()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.text("abcµ_", min_size=1, max_size=8), st.binary(max_size=50)), max_size=6))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, entries: list[tuple[str, bytes]]) -> None:
    path = tmp_path_factory.mktemp("journal") / "a.journal"
    journal(path, entries)
    assert read_journal(path) == (HEADER, entries, 0)


def test_cut_at_every_byte(tmp_path: Path) -> None:
    """Whole entries before the cut are all there; what is left of the torn one is counted."""
    path = tmp_path / "a.journal"
    ends = [len(journal(path, []))]
    for i in range(len(ENTRIES)):
        path.unlink()
        ends.append(len(journal(path, ENTRIES[: i + 1])))
    whole = path.read_bytes()
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        if cut < ends[0]:
            with pytest.raises(BadInput, match="before anything was recorded"):
                read_journal(path)
            continue
        _, entries, torn = read_journal(path)
        kept = sum(end <= cut for end in ends[1:])
        assert entries == ENTRIES[:kept]
        assert torn == cut - ends[kept]


def test_a_flipped_bit_ends_the_journal(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    start = len(journal(path, []))
    path.unlink()
    whole = journal(path, ENTRIES)
    for at in range(start, len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        _, entries, torn = read_journal(path)
        assert entries == ENTRIES[: len(entries)]
        assert torn > 0


def test_entries_survive_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    program = (
        "import sys, os; from phaselead.record.journal import JournalWriter\n"
        "writer = JournalWriter(sys.argv[1], {})\n"
        "for i in range(50): writer.append('n', bytes([i]))\n"
        "print('ready', flush=True); os.read(0, 1)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stdin is not None
    assert process.stdout.readline() == b"ready\n"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdin.close()
    process.stdout.close()
    assert read_journal(path) == ({}, [("n", bytes([i])) for i in range(50)], 0)


def test_refusals(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    whole = journal(path, ENTRIES)
    with pytest.raises(BadInput, match="exists already"):
        JournalWriter(path, {})
    assert path.read_bytes() == whole
    with pytest.raises(BadInput, match="cannot be written"):
        JournalWriter(tmp_path / "none" / "a", {})
    for content, told in [
        (b"t_s,u_V\n", "no capture journal"),
        (whole.replace(b"axes", b"axis", 1), "damaged"),
        (whole.replace(b"journal 1", b"journal 2", 1), "newer phaselead"),
    ]:
        path.write_bytes(content)
        with pytest.raises(BadInput, match=told):
            read_journal(path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=100), st.booleans())
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, with_head: bool
) -> None:
    path = tmp_path_factory.mktemp("journal") / "a.journal"
    head = journal(path, ENTRIES[:1]) if with_head else b"phaselead-journal "
    path.write_bytes(head + content)
    try:
        read_journal(path)
    except BadInput as refusal:
        assert_one_line(refusal)


def test_a_journal_is_being_written_until_it_is_closed_or_its_process_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "a.journal"
    assert not is_being_written(path)
    with JournalWriter(path, {}):
        assert is_being_written(path)
    assert not is_being_written(path)
    dies = (
        f"import os; from phaselead.record import JournalWriter as W; w = W({str(tmp_path / 'b')!r}, {{}}); os._exit(9)"
    )
    assert subprocess.run([sys.executable, "-c", dies], check=False).returncode == 9
    assert not is_being_written(tmp_path / "b")
