"""The kinds of waveform, found by their files, and what a user wrote as waveforms: ``x=sine:60um@5Hz,y=goto:120um``.

Amplitudes are peak-to-peak and rise from zero, or from the offset after the plus sign.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType

from phaselead.errors import BadInput
from phaselead.waveforms.waveform import Waveform
from phaselead.waveforms.written import Written, short

ROOM = __name__.rpartition(".")[0]


@cache
def kinds() -> Mapping[str, type[Waveform]]:
    """Every kind of waveform by its word: the classes of this folder that have a ``kind`` of their own."""
    modules = [import_module(f"{ROOM}.{found.name}") for found in iter_modules(import_module(ROOM).__path__)]
    classes = [one for module in modules for one in vars(module).values() if isinstance(one, type)]
    found = [one for one in classes if issubclass(one, Waveform) and "kind" in vars(one)]
    return MappingProxyType({one.kind: one for one in sorted(found, key=lambda one: (one.order, one.kind))})


def examples() -> list[str]:
    """One way to write each kind."""
    return [kind.written[0][0] for kind in kinds().values()]


def parse_waves(text: str, axis: str = "x") -> dict[str, Waveform]:
    """``WAVE`` for ``axis``, or ``x=WAVE,y=WAVE`` for several, by axis."""
    parts = re.split(r",\s*(?=[A-Za-z]\w*=)", text.strip())
    if not re.match(r"[A-Za-z]\w*=", parts[0]):
        if axis not in ("x", "y", "z"):
            raise BadInput(f"axis {axis!r}: there are x, y and z")
        return {axis: parse_wave(text)}
    waves: dict[str, Waveform] = {}
    for part in parts:
        name, _, wave = part.partition("=")
        if name not in ("x", "y", "z"):
            raise BadInput(
                f"waveform {short(part)}: there is no axis {name}; use x, y or z, as in x=sine:60um@5Hz,y=sine:30um@5Hz"
            )
        if name in waves:
            raise BadInput(f"waveform {short(text)}: axis {name} is given twice; give it one waveform")
        waves[name] = parse_wave(wave)
    return waves


def parse_wave(text: str) -> Waveform:
    """One waveform. Raises BadInput with what is wrong and an example."""
    word, colon, rest = text.strip().partition(":")
    if word not in kinds():
        close = difflib.get_close_matches(word, kinds(), n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        known = ", ".join(examples())
        raise BadInput(f"waveform {short(text)}: {short(word)} is no kind of waveform; {meant}one of {known}")
    kind = kinds()[word]
    written = Written(text, rest, kind.written[0][0])
    if not colon or not rest.strip():
        raise written.refusal("nothing follows the kind")
    return kind.parse(written)
