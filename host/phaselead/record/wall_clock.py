"""When a recording was taken, by a clock that goes on between recordings."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np

T0_UTC, T0_DEVICE_S, DEVICE_SESSION = "t0_utc", "t0_device_s", "device_session"
"""Attributes of a recording: when its t_s = 0 was, ISO 8601 in UTC; in s since the device began to count; and the
session with the device, 16 hex digits. A virtual stage begins to count with each."""
LONGEST_COUNT_S = 1e10
"""No device has counted for so long, 300 years: a time beyond it is none."""


class Began(NamedTuple):
    """When the t_s = 0 of a recording was, and whether that is Unix time or counted by its device, and in which
    session with it."""

    at_s: float
    unix: bool
    session: str | None = None


def t0_facts(tick_0_unix_s: float | None, later_s: float, session: int) -> dict[str, Any]:
    """What a recording says of when it was taken, whose t_s = 0 was ``later_s`` after the device began to count, in the
    ``session`` with this number. It says no date where ``tick_0_unix_s``, the Unix time of that beginning, is not
    known, or is none."""
    facts: dict[str, Any] = {T0_DEVICE_S: later_s, DEVICE_SESSION: f"{session:016x}"}
    with contextlib.suppress(ValueError, OverflowError, OSError):
        if tick_0_unix_s is not None:
            facts[T0_UTC] = datetime.fromtimestamp(tick_0_unix_s + later_s, UTC).isoformat()
    return facts


def t0_unix_s(meta: Mapping[str, Any]) -> float | None:
    """Unix time of t_s = 0 by the attributes of a recording; None where they say no time of a zone."""
    with contextlib.suppress(ValueError):
        t0 = datetime.fromisoformat(str(meta.get(T0_UTC)))
        return t0.timestamp() if t0.tzinfo is not None else None
    return None


def began(meta: Mapping[str, Any]) -> Began | None:
    """When the t_s = 0 of a recording was by its attributes: in Unix time where they say it, else by its device (a
    simulated stage has no other clock); None where they say neither."""
    unix_s = t0_unix_s(meta)
    if unix_s is not None:
        return Began(unix_s, unix=True)
    by_device_s, session = meta.get(T0_DEVICE_S), meta.get(DEVICE_SESSION)
    if isinstance(by_device_s, bool) or not isinstance(by_device_s, int | float | np.integer | np.floating):
        return None
    counted = bool(0 <= by_device_s < LONGEST_COUNT_S)
    of_session = session if isinstance(session, str) else None
    return Began(float(by_device_s), unix=False, session=of_session) if counted else None
