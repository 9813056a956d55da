"""Files of paths: columns of numbers under a header that names axis and unit, ``t_s,x_um,y_nm``."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from phaselead.errors import BadInput
from phaselead.waveforms.waveform import Shares
from phaselead.waveforms.written import Unit, short

UNITS: dict[str, tuple[Unit, float]] = {
    "um": ("um", 1.0), "nm": ("um", 1e-3), "mm": ("um", 1e3), "m": ("um", 1e6), "V": ("V", 1.0), "mV": ("V", 1e-3),
}  # fmt: skip
TIMES = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
_NAME = re.compile(r"(u?)([xyzr]?)_(um|nm|mm|m|V|mV)")


class Column(NamedTuple):
    """``times_s`` (n,) begin at 0; None: the file has none. ``values`` (n,) in ``unit``."""

    times_s: Shares | None
    values: Shares
    unit: Unit


def read_columns(path: str) -> dict[str | None, Column]:
    """The columns of a file by axis; a single one is for any, and stands under None.

    Raises BadInput, naming the line.
    """
    source = f"path file {path}"
    labels, rows = read_numbers(path, source, "a path", "times and a value for each axis, in every row", 4)
    labels = labels or (["x_um"] if rows.shape[1] == 1 else ["t_s", "x_um"] if rows.shape[1] == 2 else [])
    if len(labels) != rows.shape[1]:
        raise BadInput(f"{source}: {rows.shape[1]} columns without a header; write one, as in t_s,x_um,y_um")
    times_s = None
    if labels[0] in TIMES:
        times_s = (rows[:, 0] - rows[0, 0]) * TIMES[labels[0]]
        if (late := np.diff(times_s) <= 0).any():
            raise BadInput(f"{source}: row {int(np.argmax(late)) + 2}: time does not advance; sort the rows")
    found: dict[str | None, Column] = {}
    for at in range(0 if times_s is None else 1, len(labels)):
        axis, unit, scale = unit_of_column(labels[at], source)
        if axis in found:
            raise BadInput(f"{source}: two columns of axis {axis}; give it one")
        found[axis] = Column(times_s, rows[:, at] * scale, unit)
    if not found:
        raise BadInput(f"{source}: has times and nothing else; a column x_um is what is played")
    if len(found) == 1:
        return {None: next(iter(found.values()))}
    if None in found:
        raise BadInput(f"{source}: of several columns each names its axis, as in t_s,x_um,y_um; rename them")
    return found


def unit_of_column(label: str, source: str) -> tuple[str | None, Unit, float]:
    """Of a column named as ``y_nm``: its axis (None: any), the unit it is read into, and what its numbers are times.

    Raises BadInput for any other name.
    """
    match = _NAME.fullmatch(label)
    if match is None:
        raise BadInput(
            f"{source}: column {short(label)} names no axis with a unit; rename it, as in t_s,x_um,y_nm or t_s,ux_V"
        )
    return (match[2] if match[2] in tuple("xyz") else None), *UNITS[match[3]]


def read_numbers(path: str, source: str, what: str, columns: str, most: int) -> tuple[list[str], Shares]:
    """Labels (none without a header) and rows, (n, columns), at most so many. Raises BadInput, naming the line and
    saying what it is that is read and which ``columns`` it has."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise BadInput(f"{source}: cannot be read ({reason}); give a CSV file of {what}") from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.lstrip()[:1] not in ("", "#", "%")]
    labels: list[str] = []
    rows: list[list[float]] = []
    for number, line in lines:
        if ";" in line and "," in line:
            raise BadInput(f"{source}: line {number}: {short(line)} has decimal commas; write points")
        fields = [field.strip() for field in re.split(r"[;,\t]|\s+", line.strip())]
        try:
            row = [float(field) for field in fields]
        except ValueError:
            if not labels and not rows:
                labels = [field.strip("\"'") for field in fields]
                continue
            raise BadInput(f"{source}: line {number}: {short(line)} is no number; repair it") from None
        width = len(rows[0]) if rows else len(labels) or len(row)
        if len(row) != width or width > most:
            raise BadInput(f"{source}: line {number}: has {len(row)} columns; {what} is {columns}")
        if not all(map(math.isfinite, row)):
            raise BadInput(f"{source}: line {number}: {short(line)} is not finite; repair it")
        rows.append(row)
    if len(rows) < 2:
        raise BadInput(f"{source}: has {len(rows)} values; {what} takes at least 2")
    return labels, np.array(rows)
