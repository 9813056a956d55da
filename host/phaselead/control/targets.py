"""Targets as a user writes them: ``x=50um,y=+5um``."""

from __future__ import annotations

import math
from typing import NamedTuple

from phaselead.errors import BadInput
from phaselead.waveforms import Written, split_axes

EXAMPLE = "x=50um, x=+5um or x=50um,y=20um"


class Target(NamedTuple):
    """A place in um, or a way from the last target."""

    um: float
    relative: bool


def parse_target(value: float | str) -> Target:
    """A number is a place in um; text has a unit, and a sign where it is relative. Raises BadInput."""
    if isinstance(value, int | float):
        if isinstance(value, bool) or not math.isfinite(value):
            raise BadInput(f"target {value}: give a place in um")
        return Target(float(value), False)
    text = value.strip()
    number, unit = Written(text, text, EXAMPLE, "target", "um").level(text)
    if unit != "um":
        raise BadInput(f"target {text!r}: a move takes micrometres, as in {EXAMPLE}")
    return Target(number, text[:1] in ("+", "-"))


def parse_targets(text: str, axis: str | None = None) -> dict[str, Target]:
    """``50um`` for ``axis`` (x or several: "x,y"), or ``x=50um,y=20um``, by axis. Raises BadInput."""
    return {name: parse_target(part) for name, part in split_axes(text, axis, "target", EXAMPLE).items()}
