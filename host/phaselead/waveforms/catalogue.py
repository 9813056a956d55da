"""The kinds of waveform, found by their files, and what a user wrote as waveforms: ``x=sine:60um@5Hz,y=goto:120um``.

Amplitudes are peak-to-peak and rise from zero, or from the offset after the plus sign.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TypeVar

from phaselead.errors import BadInput
from phaselead.record import parse_axes
from phaselead.waveforms.scan import Scan
from phaselead.waveforms.waveform import Waveform
from phaselead.waveforms.written import Written, short

ROOM = __name__.rpartition(".")[0]
Kind = TypeVar("Kind", type[Waveform], type[Scan])


@cache
def kinds() -> Mapping[str, type[Waveform]]:
    """Every kind of waveform by its word: the classes of this folder that have a ``kind`` of their own."""
    return _by_word(one for one in _with_kind() if issubclass(one, Waveform))


@cache
def scans() -> Mapping[str, type[Scan]]:
    """Every kind of scan by its word, found likewise."""
    return _by_word(one for one in _with_kind() if issubclass(one, Scan))


def _with_kind() -> list[type]:
    modules = [import_module(f"{ROOM}.{found.name}") for found in iter_modules(import_module(ROOM).__path__)]
    classes = [one for module in modules for one in vars(module).values() if isinstance(one, type)]
    return [one for one in classes if "kind" in vars(one)]


def _by_word(found: Iterable[Kind]) -> Mapping[str, Kind]:
    return MappingProxyType({one.kind: one for one in sorted(found, key=lambda one: (one.order, one.kind))})


def examples() -> list[str]:
    """One way to write each kind."""
    return [how[0][0] for how in ways()]


def ways() -> list[tuple[tuple[str, str], ...]]:
    """The ways to write each kind, waveforms first, and what they mean."""
    return [kind.written for kind in kinds().values()] + [scan.written for scan in scans().values()]


def parse_waves(text: str, axis: str | None = None) -> dict[str, Waveform]:
    """``WAVE`` for ``axis``, or ``x=WAVE,y=WAVE`` for several, by axis; as ``split_axes``."""
    word, _, rest = text.strip().partition(":")
    if word in scans():
        if axis is not None:
            raise BadInput(f"waveform {short(text)}: a {word} is for x and y together; leave the axis {axis} out")
        scan = scans()[word]
        return dict(scan.parse(Written(text, rest, scan.written[0][0])))
    parts = split_axes(text, axis, "waveform", "x=sine:60um@5Hz,y=sine:30um@5Hz")
    alone = axis or "x"
    if parts == {alone: text}:
        return _parse(text, alone)
    return {name: parse_wave(part, name) for name, part in parts.items()}


def split_axes(text: str, axis: str | None, what: str, example: str) -> dict[str, str]:
    """``PART`` for every letter of ``axis`` (None: x), or ``x=PART,y=PART`` where it is None, by axis. Raises BadInput,
    saying ``what`` it is."""
    parts = re.split(r",\s*(?=[A-Za-z]\w*=)", text.strip())
    if not re.match(r"[A-Za-z]\w*=", parts[0]):
        return dict.fromkeys(parse_axes(axis or "x", "axis"), text)
    if axis is not None:
        raise BadInput(f"{what} {short(text)}: names its axes itself; leave the axis {axis} out")
    found: dict[str, str] = {}
    for part in parts:
        name, _, rest = part.partition("=")
        if name not in ("x", "y", "z"):
            raise BadInput(f"{what} {short(part)}: there is no axis {name}; use x, y or z, as in {example}")
        if name in found:
            raise BadInput(f"{what} {short(text)}: axis {name} is given twice; give it one {what}")
        found[name] = rest
    return found


def parse_wave(text: str, axis: str = "x") -> Waveform:
    """The waveform of one axis. Raises BadInput with what is wrong and an example."""
    return _parse(text, axis, named=True)[axis]


def _parse(text: str, axis: str, *, named: bool = False) -> dict[str, Waveform]:
    word, colon, rest = text.strip().partition(":")
    if word in scans():
        raise BadInput(f"waveform {short(text)}: a {word} is for x and y together; give it alone, without an axis")
    if word not in kinds():
        close = difflib.get_close_matches(word, kinds(), n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        known = ", ".join(examples())
        raise BadInput(f"waveform {short(text)}: {short(word)} is no kind of waveform; {meant}one of {known}")
    kind = kinds()[word]
    written = Written(text, rest, kind.written[0][0])
    if not colon or not rest.strip():
        raise written.refusal("nothing follows the kind")
    return kind.parse_axes(written, axis, named=named)
