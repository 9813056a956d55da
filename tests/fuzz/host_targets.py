"""What the host reads from outside, each as a function that takes any bytes and may answer with PhaseleadError alone.

HDF5 is not among them: coverage does not see into its C library, and tests/record/test_record_fuzz.py bends such files.
"""

from __future__ import annotations

import shutil
import struct
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path

from phaselead.control import recover_run
from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.errors import PhaseleadError
from phaselead.model import load_stage
from phaselead.record import parse_column_map, read_recording

MAGIC = b"phaselead-journal "
HEAD = struct.Struct("<II")


def _check_one_line(refusal: PhaseleadError) -> None:
    if "\n" in str(refusal):
        raise AssertionError(f"more than one line: {refusal}")


def _in_a_file(name: str, content: bytes, read: Callable[[Path], object]) -> None:
    folder = Path(tempfile.mkdtemp(prefix="phaselead-fuzz-"))
    try:
        (folder / name).write_bytes(content)
        read(folder / name)
    except PhaseleadError as refusal:
        _check_one_line(refusal)
    finally:
        shutil.rmtree(folder)


def _take_messages(line: bytes) -> None:
    reader = FrameReader()
    for at in range(0, len(line), 61):
        for body in reader.feed(line[at : at + 61]):
            if len(body) < wire.HEADER.size:
                continue
            number, _, _ = wire.HEADER.unpack_from(body)
            message = wire.MESSAGES.get(number)
            if message is None:
                continue
            try:
                message.unpack(message.fitted(body[wire.HEADER.size :]))
            except PhaseleadError as refusal:
                _check_one_line(refusal)


def framed(content: bytes) -> bytes:
    """Frames of pieces that each begin with their length, one byte: so CRCs do not stand in the way."""
    line = b"\0"
    while content:
        line += encode_frame(content[1 : 1 + content[0]])
        content = content[1 + content[0] :]
    return line


def frames(content: bytes) -> None:
    """The line as it comes, and as the bodies of frames."""
    _take_messages(content)
    _take_messages(framed(content))


def stage(content: bytes) -> None:
    _in_a_file("stage.toml", content, load_stage)


def csv(content: bytes) -> None:
    """With a header, and as columns that a map names."""
    _in_a_file("rec.csv", content, read_recording)
    mapped = parse_column_map("u_V=1,x_um=2")
    _in_a_file("rec.txt", content, lambda path: read_recording(path, columns=mapped, rate_Hz=200.0))


def sealed(journal: bytes) -> bytes:
    """The same journal with right CRCs."""
    line, newline, rest = journal.partition(b"\n")
    text = line[len(MAGIC) :].split(b" ", 2)[-1]
    out = MAGIC + b"1 %08x " % zlib.crc32(text) + text + newline
    while len(rest) >= HEAD.size:
        length, _ = HEAD.unpack_from(rest)
        body = rest[HEAD.size : HEAD.size + length]
        out += HEAD.pack(length, zlib.crc32(body, zlib.crc32(rest[:4]))) + body
        rest = rest[HEAD.size + length :]
    return out + rest


def journal(content: bytes) -> None:
    """As it is, and with right CRCs."""

    def recover(path: Path) -> None:
        recover_run(str(path), str(path.with_suffix(".h5")))

    _in_a_file("run.journal", content, recover)
    _in_a_file("run.journal", sealed(content), recover)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "frames": frames,
    "stage": stage,
    "csv": csv,
    "journal": journal,
}
