"""What the columns of a foreign file are, from their labels, units and numbers, and every assumption in words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.record.axis_record import Samples
from phaselead.record.columns import AXES, SCALES, UNITS
from phaselead.record.foreign import ForeignColumn

METRES_BELOW = 1e-3
"""Of a way without a unit: as micrometres it would be below a nanometre, which no stage is driven for."""
WORDS = {
    "t_s": ("t", "time", "times", "zeit", "timestamp", "temps", "seconds", "sec"),
    "r_um": ("r", "ref", "reference", "setpoint", "target", "soll", "desired"),
    "u_V": ("u", "v", "volt", "volts", "voltage", "drive", "input", "command", "cmd", "in", "control", "spannung"),
    "x_um": (
        "x", "y", "z", "pos", "position", "displacement", "disp", "sensor", "out", "output", "measured", "meas", "weg",
        "auslenkung", "adc", "capacitive",
    ),
}  # fmt: skip
"""By the kind of column: the words that labels have for it."""


@dataclass(frozen=True)
class Mapped:
    """One column of the recording: where it comes from, and by what its numbers are multiplied."""

    name: str
    column: ForeignColumn
    scale: float
    why: str


def guess(columns: Sequence[ForeignColumn]) -> list[Mapped]:
    """The columns that make a recording; those that do not move, and those that nothing is known of, are left out."""
    moving = [column for column in columns if _moves(column.values)]
    roles = {column.number: _role(column) for column in moving}
    if not any(kind == "t_s" for kind, _ in roles.values()):
        roles |= {
            c.number: ("t_s", "it rises in even steps") for c in moving if not roles[c.number][0] and _even(c.values)
        }
    unknown = [column for column in moving if not roles[column.number][0]]
    known = {kind for kind, _ in roles.values()}
    if unknown and not {"u_V", "x_um"} <= known:
        roles |= _by_noise(unknown, known)
    chosen: list[Mapped] = []
    for kind in ("t_s", "u_V", "x_um", "r_um"):
        of_kind = [column for column in moving if roles[column.number][0] == kind]
        chosen += _mapped(kind, of_kind, {number: why for number, (_, why) in roles.items()})
    return chosen


def _moves(values: Samples) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > 0


def _role(column: ForeignColumn) -> tuple[str, str]:
    """Kind of column by its label and unit, and why; ("", "") where they do not say."""
    words = [word for word in re.split(r"[^a-z]+", _stem(column).lower()) if word]
    for kind, known in WORDS.items():
        named = next(
            (word for word in words if word in known or (word[:1] in "uxyzr" and word[1:] in ("x", "y", "z"))), None
        )
        if named is not None and (named in known or named[:1] == kind[:1] or (kind == "x_um" and named in AXES)):
            return kind, f"it is called {column.label!r}"
    unit = unit_of(column)
    for kind in ("t_s", "u_V", "x_um"):
        if unit in SCALES[UNITS[kind]]:
            return kind, f"it is in {unit}"
    return "", ""


def _stem(column: ForeignColumn) -> str:
    """The label without its unit."""
    return re.sub(r"[(\[/].*$", "", column.label) if unit_of(column) else column.label


def unit_of(column: ForeignColumn) -> str:
    """The unit that the file gives, in ASCII; empty where it gives none that is known."""
    found = column.unit
    if not found:
        match = re.search(r"[(\[/]\s*([^)\]/]+?)\s*[)\]]?$", column.label) or re.search(
            r"[_ ]([a-zA-Z\u00b5\u03bc]+)$", column.label.strip()
        )
        found = match[1] if match else ""
    found = found.strip().replace("\u00b5", "u").replace("\u03bc", "u")
    known = {unit for scales in SCALES.values() for unit in scales}
    return found if found in known else ""


def _even(values: Samples) -> bool:
    steps = np.diff(values)
    return bool((steps > 0).all() and np.abs(steps - np.median(steps)).max() <= 0.01 * np.median(steps))


def _by_noise(unknown: Sequence[ForeignColumn], known: set[str]) -> dict[int, tuple[str, str]]:
    """What was commanded is smoother than what a sensor saw of it, against its own span."""
    ranked = sorted(unknown, key=lambda column: roughness(column.values))
    found = {}
    if "u_V" not in known:
        smoothest = ranked.pop(0)
        found[smoothest.number] = ("u_V", "it is the smoothest")
    if ranked and "x_um" not in known:
        rest = [column for column in unknown if column in ranked]
        found[rest[0].number] = ("x_um", "it moves, and is rougher than the voltage")
    return found


def roughness(values: Samples, order: int = 2) -> float:
    """Median second difference of (n,), or another, over its span."""
    return float(np.median(np.abs(np.diff(values, order)))) / (float(np.ptp(values)) or 1.0)


def _mapped(kind: str, columns: Sequence[ForeignColumn], why: dict[int, str]) -> list[Mapped]:
    """One column for time; one, or one for each axis, for the others."""
    if not columns:
        return []
    if kind == "t_s" or len(columns) == 1:
        return [_scaled(_single(kind, columns), columns[0], columns, why)]
    axes = [_axis(column, i) for i, column in enumerate(columns)]
    if len(set(axes)) < len(axes) or len(axes) > len(AXES):
        return [_scaled(_single(kind, columns), columns[0], columns, why)]
    form = {"u_V": "u{}_V", "x_um": "{}_um", "r_um": "r{}_um"}[kind]
    return [_scaled(form.format(axis), column, columns, why) for axis, column in zip(axes, columns, strict=True)]


def _single(kind: str, columns: Sequence[ForeignColumn]) -> str:
    axis = _named_axis(columns[0])
    return f"{axis}_um" if kind == "x_um" and axis else kind


def _named_axis(column: ForeignColumn) -> str:
    match = re.fullmatch(r"[ur]?([xyz])", re.split(r"[^a-z]+", _stem(column).lower().strip())[0])
    return match[1] if match and "[" not in column.label else ""


def _axis(column: ForeignColumn, index: int) -> str:
    named = _named_axis(column)
    return named or AXES[min(index, len(AXES) - 1)]


def _scaled(name: str, column: ForeignColumn, together: Sequence[ForeignColumn], why: dict[int, str]) -> Mapped:
    """With the factor into the column's unit: by the unit of the file, else by the size of the numbers."""
    wanted, unit = UNITS[name], unit_of(column)
    reason = why.get(column.number, "")
    if unit in SCALES[wanted]:
        return Mapped(name, column, SCALES[wanted][unit], reason)
    if wanted == "um" and max(float(np.ptp(one.values)) for one in together) < METRES_BELOW:
        return Mapped(name, column, 1e6, f"{reason}; so small that it must be in metres")
    return Mapped(name, column, 1.0, f"{reason}; taken as {wanted}, since the file names no unit")
