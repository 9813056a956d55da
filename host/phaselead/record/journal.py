"""The journal of a capture in progress: append-only, readable after a kill at any byte.

    phaselead-journal 1 CRC JSON\\n                       header; CRC-32 of the JSON text, 8 hex digits
    length u32 | crc u32 | kind length u8 | kind | payload     any number of entries, little-endian

``length`` counts kind length, kind and payload; ``crc`` is the CRC-32 of length and those bytes. An entry
is handed to the operating system in one write, so only the last one can be torn when the process dies.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import IO, Any, NamedTuple, Self

from phaselead.errors import BadInput

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

MAGIC = b"phaselead-journal "
VERSION = 1
LARGEST_ENTRY = 2**28
LONGEST_HEADER = 2**26
"""Bytes. It holds a stage file."""
STILL_WRITTEN = "its run still goes on; let it end, or stop it with Ctrl-C first"
"""What is said of a journal that a run has open."""
_HEAD = struct.Struct("<II")


class Entry(NamedTuple):
    """One entry: what it is, and its bytes."""

    kind: str
    payload: bytes


class JournalWriter:
    """Appends entries to a new journal, locked while it is written. Refuses to write over a file that exists."""

    def __init__(self, path: str | os.PathLike[str], header: dict[str, Any]) -> None:
        text = json.dumps(header, separators=(",", ":")).encode()
        line = MAGIC + b"%d %08x " % (VERSION, zlib.crc32(text)) + text + b"\n"
        try:
            self._file = open(path, "xb", buffering=0)  # noqa: SIM115 - open for as long as the capture runs
        except FileExistsError:
            raise BadInput(f"{path}: exists already; {what_to_do(path)}") from None
        except OSError as error:
            raise BadInput(f"{path}: cannot be written ({error.strerror}); give a writable place") from None
        if fcntl is not None:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            self._write(line)
        except BaseException:
            self._file.close()
            os.remove(path)
            raise

    def append(self, kind: str, payload: bytes) -> None:
        """Add one entry. After it returns the entry survives the death of this process."""
        name = kind.encode()
        if not 1 <= len(name) <= 255 or len(payload) > LARGEST_ENTRY - 256:
            raise ValueError(f"journal entry {kind!r} of {len(payload)} bytes does not fit")
        body = bytes([len(name)]) + name + payload
        length = struct.pack("<I", len(body))
        self._write(length + struct.pack("<I", zlib.crc32(body, zlib.crc32(length))) + body)

    def _write(self, data: bytes) -> None:
        written = self._file.write(data)
        if written != len(data):
            raise OSError(f"journal: only {written} of {len(data)} bytes were written; is the disk full?")

    def sync(self) -> None:
        """Make everything so far survive a power cut as well."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Sync and close; closing twice is harmless."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def is_being_written(path: str | os.PathLike[str]) -> bool:
    """Whether a run has the journal open and still writes it; False where the system does not tell."""
    try:
        with open(path, "rb") as file:
            return not _locked(file, alone=False)
    except OSError:
        return False


@contextmanager
def alone(path: str | os.PathLike[str]) -> Iterator[None]:
    """Keeps a journal from all others that ask for it, for as long as it is finished. Raises BadInput where a run still
    writes it or another finishes it."""
    try:
        file = open(path, "rb")  # noqa: SIM115 - open for as long as the journal is finished
    except OSError:
        yield  # whoever reads it says why
        return
    with file:
        if not _locked(file, alone=True):
            raise BadInput(f"{path}: {STILL_WRITTEN}")
        yield


def _locked(file: IO[bytes], *, alone: bool) -> bool:
    """Locks an open file for as long as it is open or its process lives, ``alone`` or beside others that only ask.
    False where another has locked it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def what_to_do(path: str | os.PathLike[str]) -> str:
    """With a journal that is there: a run still writes it, or one was not finished."""
    if is_being_written(path):
        return f"{STILL_WRITTEN}, or choose another output"
    return (
        f"it is left from a run that was not finished; recover it first (phaselead log recover {path} -o OTHER.h5), "
        "delete it, or choose another output"
    )


def is_journal(content: bytes) -> bool:
    """Whether these are the first bytes of a journal."""
    return content.startswith(MAGIC)


class JournalReader:
    """The header of a journal and, when iterated over, its whole entries one by one: never more than one in memory.

    Raises BadInput when the file is no journal, or was cut off before its header was complete.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            self._file = open(path, "rb")  # noqa: SIM115 - open for as long as entries are read
        except OSError as error:
            raise BadInput(f"{path}: cannot be read ({error.strerror}); give a journal") from None
        try:
            self.size = os.fstat(self._file.fileno()).st_size
            self.header, self.position = _header(self._file.readline(LONGEST_HEADER), path)
        except OSError as error:
            self.close()
            raise BadInput(f"{path}: cannot be read ({error.strerror}); give a journal") from None
        except BaseException:
            self.close()
            raise
        self.begin = self.position
        """Byte at which the entries begin."""

    @property
    def torn_bytes(self) -> int:
        """Behind the last whole entry read so far; once all are read, what was lost at the torn end."""
        return self.size - self.position

    def __iter__(self) -> Iterator[Entry]:
        self.position = self.begin
        self._file.seek(self.begin)
        while (entry := self._next()) is not None:
            yield entry

    def _next(self) -> Entry | None:
        """The entry that comes next; None when it is torn or damaged."""
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        length, crc = _HEAD.unpack(head)
        if not 2 <= length <= self.size - self.position - _HEAD.size:
            return None
        body = self._file.read(length)
        kind_end = 1 + body[0] if body else 0
        if len(body) != length or zlib.crc32(body, zlib.crc32(head[:4])) != crc or not 1 < kind_end <= length:
            return None
        self.position += _HEAD.size + length
        return Entry(body[1:kind_end].decode("utf-8", "replace"), body[kind_end:])

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_journal(path: str | os.PathLike[str]) -> tuple[dict[str, Any], list[Entry], int]:
    """Header, whole entries, and the number of bytes lost at the torn end (0: the journal is whole).

    Raises BadInput as ``JournalReader``.
    """
    with JournalReader(path) as journal:
        entries = list(journal)
        return journal.header, entries, journal.torn_bytes


def _header(content: bytes, path: str | os.PathLike[str]) -> tuple[dict[str, Any], int]:
    if not content.startswith(MAGIC):
        if MAGIC.startswith(content):
            raise BadInput(f"{path}: ends before anything was recorded; delete it")
        raise BadInput(f"{path}: is no capture journal; give the OUTPUT.journal that a broken-off run left")
    end = content.find(b"\n")
    if end < 0:
        raise BadInput(f"{path}: ends before anything was recorded; delete it")
    parts = content[len(MAGIC) : end].split(b" ", 2)
    if parts[0].isdigit() and len(parts[0]) < 10 and int(parts[0]) > VERSION:
        raise BadInput(f"{path}: was written by a newer phaselead; update phaselead")
    try:
        _, crc, text = parts
        header = json.loads(text) if int(crc, 16) == zlib.crc32(text) else None
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict):
        raise BadInput(f"{path}: the header of the journal is damaged; it cannot be recovered")
    return header, end + 1
