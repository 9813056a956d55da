"""Memory that a process keeps once it was freed."""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX = -1, -2, -4
"""Options of mallopt(3), as in glibc's malloc.h."""
KEPT_bytes, PAD_bytes = 2**31 - 1, 2**26
"""Freed memory that is kept, and by how much more the heap grows than was asked for."""


def keep_freed_memory() -> bool:
    """Have this process keep the memory that it frees; whether it does. For a process that does nothing else.

    A search allocates and frees some tens of megabytes thousands of times. glibc gives each back to the system, which
    clears every page again: a third of the processor time. Elsewhere than on glibc nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is None:
        return False
    wanted = ((_TRIM_THRESHOLD, KEPT_bytes), (_TOP_PAD, PAD_bytes), (_MMAP_MAX, 0))
    return all(mallopt(option, value) == 1 for option, value in wanted)
