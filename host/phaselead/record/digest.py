"""What tells one recording from every other: the SHA-256 of its file, or of its samples."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import PurePath
from typing import NamedTuple

from phaselead.record.axis_record import AxisRecord, Samples


class Source(NamedTuple):
    """A recording that numbers rest on: its file, or what was driven, and the SHA-256 of the file, else of its samples
    (``samples_sha256``); empty where neither is known."""

    name: str
    sha256: str


def shortest_names(paths: Collection[str]) -> dict[str, str]:
    """By path its last part, with as many folders in front as tell it from others that end alike.

    >>> shortest_names(["monday/a.h5", "tuesday/a.h5", "tuesday/b.h5"])
    {'monday/a.h5': 'monday/a.h5', 'tuesday/a.h5': 'tuesday/a.h5', 'tuesday/b.h5': 'b.h5'}
    """
    parts = {path: PurePath(path).parts for path in dict.fromkeys(paths)}
    ends = Counter(of[-n:] for of in set(parts.values()) for n in range(1, len(of) + 1))

    def name(path: str) -> str:
        of = parts[path]
        alone = (of[-n:] for n in range(1, len(of) + 1) if ends[of[-n:]] == 1)
        return str(PurePath(*next(alone, of))) if of else path

    return {path: name(path) for path in parts}


def file_sha256(path: str | os.PathLike[str]) -> str:
    """Of the bytes of a file. Raises OSError."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def samples_sha256(t_s: Samples, axes: Mapping[str, AxisRecord]) -> str:
    """Of the samples as float64, little-endian: times, then by axis (x, y, z) voltage, position and reference, those
    that are not there left out. It is the same in every file that holds these numbers to the last bit."""
    digest = hashlib.sha256(t_s.astype("<f8", copy=False).tobytes())
    for name in sorted(axes):
        for values in (axes[name].u_V, axes[name].x_um, axes[name].r_um):
            digest.update(b"" if values is None else values.astype("<f8", copy=False).tobytes())
    return digest.hexdigest()
