"""The modes of an axis by name, and what each needs."""

from __future__ import annotations

MODES = ("open", "pid", "ff", "ff+pid", "inverse", "inverse+pid")
USES_TABLES = ("ff", "ff+pid")
INVERTS = ("inverse", "inverse+pid")
HAS_FEEDBACK = ("pid", "ff+pid", "inverse+pid")
NEEDS_MODEL = (*USES_TABLES, *INVERTS)
