"""Whether a run has room, in memory and on the disk, asked before it begins."""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput

BYTES_IN_MEMORY = 80
"""A tick and axis: batches, codes and columns of a run that is judged, 1.4 GB an hour."""
BYTES_ON_DISK = 16
"""A tick and axis, 0.3 GB an hour: the journal, 12.5 bytes, becomes a file of 3.4 (44 h, `make big-recording`)."""
WORTH_SAYING = 1e8
"""Bytes from which a person wants to know beforehand."""


def disk_bytes(seconds: float, axes: int) -> float:
    """What the recording of so many axes takes on the disk while it is made."""
    return seconds * TICK_HZ * axes * BYTES_ON_DISK


def said_of_disk(seconds: float | None, axes: int) -> str | None:
    """In words, where it is much."""
    needed = 0.0 if seconds is None else disk_bytes(seconds, axes)
    return f"recording {seconds:g} s takes up to {_shown(needed)} of the disk" if needed > WORTH_SAYING else None


def refuse_without_room(seconds: float | None, axes: int, output: str | None, *, in_memory: bool) -> None:
    """Raises BadInput for a run of ``axes`` axes for which the disk of ``output`` has no room, or, where it is held
    ``in_memory``, the memory. None seconds are the few of a default."""
    if seconds is None:
        return
    needed, there = seconds * TICK_HZ * axes * BYTES_IN_MEMORY, _memory_bytes()
    if in_memory and needed > there:
        raise BadInput(
            f"a run of {seconds:g} s takes {_shown(needed)} of memory, this computer has {_shown(there)}: choose a "
            "shorter duration, or record it with `phaselead log record`, which keeps it on the disk"
        )
    if output is None:
        return
    needed, free = disk_bytes(seconds, axes), shutil.disk_usage(Path(os.path.realpath(output)).parent).free
    if needed > free:
        raise BadInput(
            f"{output}: a run of {seconds:g} s takes up to {_shown(needed)} of the disk, {_shown(free)} are free: "
            "choose a shorter duration, or make room"
        )


def _memory_bytes() -> float:
    """Of this computer; infinite where it does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return math.inf


def _shown(size: float) -> str:
    return f"{size / 1e9:.3g} GB"
