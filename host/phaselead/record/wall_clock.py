"""When a recording was taken, by a clock that goes on between recordings."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

T0_UTC, T0_DEVICE_S = "t0_utc", "t0_device_s"
"""Attributes of a recording: when its t_s = 0 was, ISO 8601 in UTC; and in s since the device began to count."""


class Began(NamedTuple):
    """When the t_s = 0 of a recording was, and whether that is Unix time or counted by its device."""

    at_s: float
    unix: bool


def t0_facts(tick_0_unix_s: float | None, later_s: float) -> dict[str, Any]:
    """What a recording says of when it was taken, whose t_s = 0 was ``later_s`` after the device began to count. It
    says no date where ``tick_0_unix_s``, the Unix time of that beginning, is not known, or is none."""
    facts: dict[str, Any] = {T0_DEVICE_S: later_s}
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
    with contextlib.suppress(TypeError, ValueError):
        by_device_s = float(meta[T0_DEVICE_S]) if T0_DEVICE_S in meta else math.nan
        return Began(by_device_s, unix=False) if math.isfinite(by_device_s) else None
    return None
