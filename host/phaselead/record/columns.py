"""The columns of a recording: their names, which carry the unit, and how they make up the axes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real

from phaselead.errors import BadInput
from phaselead.nearest import nearest
from phaselead.record.axis_record import AxisRecord, Samples

AXES = ("x", "y", "z")
UNITS = {"t_s": "s", "u_V": "V", "r_um": "um"}
UNITS |= {f"u{axis}_V": "V" for axis in AXES}
UNITS |= {f"{axis}_um": "um" for axis in AXES}
UNITS |= {f"r{axis}_um": "um" for axis in AXES}
"""Every column of a recording and its unit."""

ColumnMap = Mapping[str, tuple[int, float]]
"""Column name -> (1-based column of the file, factor into the column's unit)."""

SCALES = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "V": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3},
    "um": {"um": 1.0, "m": 1e6, "mm": 1e3, "cm": 1e4, "nm": 1e-3, "pm": 1e-6},
}
WORDS = {"s": "seconds", "V": "volts", "um": "micrometres"}
MAP_EXAMPLE = "--map u_V=1,x_um=2 --rate 200Hz"


def parse_axes(text: str, name: str = "axes") -> tuple[str, ...]:
    """ "x", "x,y,z" or "xyz" as letters, each once; ``name`` is what messages call it. Raises BadInput."""
    axes = tuple(re.sub(r"[,\s]+", "", text))
    if not axes or not set(axes) <= set(AXES) or len(set(axes)) != len(axes):
        raise BadInput(f"{name} {shown(text)}: name each of x, y, z at most once, e.g. x or x,y,z")
    return axes


_LABEL = re.compile(r"(t|time|[uxyzr]|[ur][xyz])(?:[\s_(\[/]+([^\s_()\[\]]*)[)\]]?)?", re.IGNORECASE)


def own_header(labels: Sequence[str]) -> bool:
    """Whether these labels are a header in our manner: a name of ours, or one of ours in another unit."""
    return any(label in UNITS or (label and _LABEL.fullmatch(label)) for label in labels)


def header_columns(labels: Sequence[str], source: str) -> dict[str, tuple[int, float]]:
    """The column map of a header line. Columns that are none of ours are left alone.

    Raises BadInput for a column given twice, and for one of ours in another unit, with the map that
    converts it.
    """
    found: dict[str, tuple[int, float]] = {}
    for i, label in enumerate(labels, start=1):
        if label in UNITS:
            if label in found:
                raise BadInput(f"{source}: column {label} appears twice ({found[label][0]} and {i}); rename one")
            found[label] = (i, 1.0)
    strangers = [(i, label, *_meant(label)) for i, label in enumerate(labels, start=1) if label not in UNITS]
    wrong = [item for item in strangers if item[2] and item[2] not in found]
    if wrong:
        i, label, name, _ = wrong[0]
        unit = UNITS[name]
        if {*found, *(item[2] for item in wrong)} <= {"t_s"}:
            given = ", ".join(map(shown, labels))
            raise BadInput(
                f"{source}: has {given}, of which none is known as voltage or position; let `phaselead log "
                f"import {source} -o OUT.h5` find them, or map them, e.g. {MAP_EXAMPLE}"
            )
        raise BadInput(
            f"{source}: column {i} is {shown(label)}, expected {name} ({WORDS[unit]}): "
            f"rename it if it is in {unit}, else map it, e.g. --map {_map_text(found, wrong)}"
        )
    return found


def _meant(label: str) -> tuple[str, float]:
    """Which column of ours a foreign label stands for, and the factor into its unit; ("", 1) for none."""
    match = _LABEL.fullmatch(label)
    if not match:
        return "", 1.0
    stem = {"time": "t"}.get(match[1].lower(), match[1].lower())
    name = next(name for name in UNITS if name.split("_")[0] == stem)
    scales = SCALES[UNITS[name]]
    unit = (match[2] or "").replace("µ", "u").replace("μ", "u")
    return name, scales.get(unit, 1.0)


def _map_text(found: ColumnMap, wrong: Sequence[tuple[int, str, str, float]]) -> str:
    mapped = [(i, name, 1.0) for name, (i, _) in found.items()]
    mapped += [(i, name, scale) for i, _, name, scale in wrong]
    return ",".join(f"{name}={i}" + (f"*{scale:g}" if scale != 1 else "") for i, name, scale in sorted(mapped))


def parse_column_map(text: str) -> dict[str, tuple[int, float]]:
    """``"u_V=1,x_um=3*1e6"`` as ``{"u_V": (1, 1.0), "x_um": (3, 1e6)}``; columns count from 1."""
    columns: dict[str, tuple[int, float]] = {}
    for item in text.split(","):
        match = re.fullmatch(r"\s*(\w+)\s*=\s*(\d{1,6})\s*(?:\*\s*(\S+)\s*)?", item, re.ASCII)
        if not match:
            raise BadInput(
                f"column map: {shown(item)} is not NAME=COLUMN or NAME=COLUMN*FACTOR, as in u_V=1,x_um=3*1e6"
            )
        name, column, factor = match[1], int(match[2]), match[3] or "1"
        if name in columns:
            raise BadInput(f"column map: {name} is given twice; name each column once")
        try:
            columns[name] = (column, float(factor))
        except ValueError:
            raise BadInput(f"column map: {shown(factor)} is no number; give a factor as in x_um=3*1e6") from None
    return check_column_map(columns)


def check_column_map(columns: ColumnMap) -> dict[str, tuple[int, float]]:
    """The map itself, once every name, column and factor in it makes sense."""
    if not columns:
        raise BadInput(f"column map: is empty; name the columns, e.g. {MAP_EXAMPLE}")
    taken: dict[int, str] = {}
    for name, (column, scale) in columns.items():
        if name not in UNITS:
            raise BadInput(f"column map: {shown(name)} is no column of a recording; {_did_you_mean(name)}")
        if column < 1:
            raise BadInput(f"column map: {name}={column}: columns count from 1")
        if not math.isfinite(scale) or scale == 0:
            raise BadInput(f"column map: {name}={column}*{scale:g}: the factor must be finite and not 0")
        if column in taken:
            raise BadInput(f"column map: column {column} is both {taken[column]} and {name}; give each its own")
        taken[column] = name
    return dict(columns)


def _did_you_mean(name: str) -> str:
    meant, scale = _meant(name)
    if meant:
        return f"write {meant}=COLUMN" + (f"*{scale:g}" if scale != 1 else "")
    return nearest(name, UNITS)


def parse_rate(text: str) -> float:
    """A sampling rate such as ``200Hz``, ``5kHz`` or ``200``, in Hz."""
    match = re.fullmatch(r"\s*([^\sa-zA-Z]+(?:[eE][+-]?\d+)?)\s*(Hz|kHz|)\s*", text)
    try:
        rate = float(match[1]) * (1000 if match[2] == "kHz" else 1) if match else math.nan
    except ValueError:
        rate = math.nan
    return check_rate(rate, shown(text))


def check_rate(rate_Hz: float, given: str = "") -> float:
    """The rate itself when it is one."""
    if not (isinstance(rate_Hz, Real) and math.isfinite(rate_Hz) and rate_Hz > 0):
        raise BadInput(f"rate {given or rate_Hz}: is no sampling rate; give one such as 200Hz")
    return rate_Hz


def axes_of(columns: Mapping[str, Samples], source: str) -> dict[str, AxisRecord]:
    """The axes made up of named columns (without ``t_s``); u_V and r_um belong to the one axis there is."""
    named = {axis for axis in AXES if any(name in columns for name in (f"u{axis}_V", f"{axis}_um", f"r{axis}_um"))}
    plain = [name for name in ("u_V", "r_um") if name in columns]
    if plain and len(named) > 1:
        axis = sorted(named)[0]
        better = f"u{axis}_V" if plain[0] == "u_V" else f"r{axis}_um"
        raise BadInput(f"{source}: {plain[0]} with several axes: say whose it is, e.g. {better}")
    axes: dict[str, AxisRecord] = {}
    for axis in sorted(named or {"x"}):
        u = _one_of(columns, ("u_V", f"u{axis}_V"), source)
        r = _one_of(columns, ("r_um", f"r{axis}_um"), source)
        x = columns.get(f"{axis}_um")
        if u is None and x is None:
            raise BadInput(
                f"{source}: has neither u_V nor x_um; name its columns t_s,u_V,x_um or map them, e.g. {MAP_EXAMPLE}"
            )
        axes[axis] = AxisRecord(u_V=u, x_um=x, r_um=r)
    return axes


def _one_of(columns: Mapping[str, Samples], names: tuple[str, str], source: str) -> Samples | None:
    present = [name for name in names if name in columns]
    if len(present) > 1:
        raise BadInput(f"{source}: has both {names[0]} and {names[1]}; keep one of them")
    return columns[present[0]] if present else None


def columns_of(t_s: Samples, axes: Mapping[str, AxisRecord]) -> dict[str, Samples]:
    """The named columns of a recording, in the order of its header; ``axes_of`` turned round."""
    alone = list(axes) == ["x"]
    columns = {"t_s": t_s}
    for form, field in (("u{}_V", "u_V"), ("{}_um", "x_um"), ("r{}_um", "r_um")):
        for axis in AXES:
            values = getattr(axes[axis], field) if axis in axes else None
            if values is not None:
                columns[form.format("" if alone and field != "x_um" else axis)] = values
    return columns


def shown(text: str) -> str:
    """Foreign text in a message: quoted, on one line, short."""
    quoted = repr(text)
    return quoted if len(quoted) <= 70 else quoted[:66] + "...'"
