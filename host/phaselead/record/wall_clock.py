"""When a recording was taken, by a clock that goes on between recordings."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

T0_UTC = "t0_utc"
"""Attribute of a recording: ISO 8601, UTC, of its t_s = 0."""


def t0_facts(unix_s: float | None, later_s: float) -> dict[str, str]:
    """What a recording says of when it was taken, whose t_s = 0 was ``later_s`` after a Unix time; nothing where no
    clock is known, or it says no date."""
    with contextlib.suppress(ValueError, OverflowError, OSError):
        return {} if unix_s is None else {T0_UTC: datetime.fromtimestamp(unix_s + later_s, UTC).isoformat()}
    return {}


def t0_unix_s(meta: Mapping[str, Any]) -> float | None:
    """Unix time of t_s = 0 by the attributes of a recording; None where they say no time of a zone."""
    with contextlib.suppress(ValueError):
        t0 = datetime.fromisoformat(str(meta.get(T0_UTC)))
        return t0.timestamp() if t0.tzinfo is not None else None
    return None
