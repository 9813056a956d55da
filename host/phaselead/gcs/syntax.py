"""GCS 2.0 on the line: bytes into commands, words into numbers, answers into lines."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from phaselead.gcs.errors import Code, GcsError

LONGEST = 65536
"""Bytes of a command line: a whole waveform of some thousand points fits into one."""
SINGLE = frozenset(range(1, 32)) - {10, 13}
"""Control characters are commands by themselves, which need no line feed (#5 is the character 5). 10 and 13 end
lines."""
CODEPAGE = "latin-1"
"""#7 is answered by the characters 0xB0 and 0xB1."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_LINE_ENDS = b"\r\n"


@dataclass(frozen=True)
class Command:
    """One command: its mnemonic in upper case (``MOV``, ``POS?``, ``#24``) and its words."""

    name: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unreadable:
    """What is no command: a line too long, or with bytes that are no ASCII."""

    code: Code


@dataclass
class Reader:
    """The bytes of one client, in whatever pieces they come."""

    _line: bytearray = field(default_factory=bytearray)
    _too_long: bool = False

    def feed(self, data: bytes) -> Iterator[Command | Unreadable]:
        """The commands that are whole now. A control character is one at once, also within a line."""
        for byte in data:
            if byte in _LINE_ENDS:
                if (found := self._end()) is not None:
                    yield found
            elif byte in SINGLE:
                yield Command(f"#{byte}")
            elif len(self._line) < LONGEST:
                self._line.append(byte)
            else:
                self._too_long = True

    def _end(self) -> Command | Unreadable | None:
        line, self._line = bytes(self._line), bytearray()
        if self._too_long:
            self._too_long = False
            return Unreadable(Code.COMMAND_TOO_LONG)
        if not line.strip():
            return None
        if not line.isascii() or b"\0" in line:
            return Unreadable(Code.PARAM_SYNTAX)
        name, *words = line.decode("ascii").split()
        return Command(name.upper(), tuple(words))


def number(word: str) -> float:
    """A finite number. Raises GcsError."""
    value = float(word) if _NUMBER.fullmatch(word) else math.nan
    if not math.isfinite(value):
        raise GcsError(Code.PARAM_SYNTAX, f"{word[:40]!r} is no number")
    return value


def whole(word: str) -> int:
    """A whole number, decimal or 0x. Raises GcsError."""
    if re.fullmatch(r"0[xX][0-9a-fA-F]{1,8}", word):
        return int(word, 16)
    value = number(word)
    if value != int(value):
        raise GcsError(Code.PARAM_SYNTAX, f"{word[:40]!r} is no whole number")
    return int(value)


def switch(word: str) -> bool:
    """0 or 1. Raises GcsError."""
    value = whole(word)
    if value not in (0, 1):
        raise GcsError(Code.PARAM_OUT_OF_RANGE, f"{value} is neither 0 nor 1")
    return bool(value)


def groups(words: Sequence[str], size: int) -> list[tuple[str, ...]]:
    """Words in groups of so many, at least one group. Raises GcsError."""
    if not words:
        raise GcsError(Code.MISSING_PARAM)
    if len(words) % size:
        raise GcsError(Code.PARAM_NR)
    return [tuple(words[at : at + size]) for at in range(0, len(words), size)]


def exactly(words: Sequence[str], size: int) -> None:
    """Raises GcsError unless there are so many words."""
    if len(words) != size:
        raise GcsError(Code.MISSING_PARAM if len(words) < size else Code.PARAM_NR)


def lines(parts: Iterable[str]) -> str:
    """An answer of several lines: all but the last end in a space."""
    return " \n".join(parts) + "\n"


def pairs(values: Mapping[str, object]) -> str:
    """``x=1`` a line."""
    return lines(f"{name}={value}" for name, value in values.items())


PLACES = 1e5
"""Of a micrometre: a position is written with five."""


def place(um: float) -> str:
    """A position or a velocity as it is written."""
    return f"{um + 0.0:.5f}"


def array(title: str, sample_s: float, columns: Mapping[str, Sequence[float]]) -> str:
    """Columns of the same length as a GCS array: a header, and a line a point. NaN is a point that did not come."""
    names, rows = list(columns), list(zip(*columns.values(), strict=True))
    head = [
        f"# REM {title}",
        "# VERSION = 1",
        "# TYPE = 1",
        "# SEPARATOR = 32",
        f"# DIM = {len(names)}",
        f"# SAMPLE_TIME = {sample_s:.7g}",
        f"# NDATA = {len(rows)}",
        "#",
        *(f"# NAME{i} = {name}" for i, name in enumerate(names)),
        "#",
        "# END_HEADER",
    ]
    return lines([*head, *(" ".join(f"{value:.6g}" for value in row) for row in rows)])
