"""Recordings from files of other programs: read, mapped by name or guessed, previewed, and said how."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.errors import BadInput
from phaselead.record.axis_record import Samples
from phaselead.record.checks import require_measured
from phaselead.record.columns import UNITS, axes_of, shown
from phaselead.record.direction import counts_backwards
from phaselead.record.foreign import ForeignColumn, ForeignTable, read_foreign
from phaselead.record.gathering import from_columns
from phaselead.record.guess import Mapped, guess
from phaselead.record.plausible import doubts_about
from phaselead.record.recording import Recording, Recordings
from phaselead.result import Result, Table

PREVIEW_ROWS = 5


@dataclass(frozen=True, repr=False)
class Imported(Result):
    """Recordings of a foreign file, which column became which, and all that was assumed. Prints as a preview.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> t_s = np.arange(100) / 200
    >>> table = np.column_stack([1e3 * t_s, 2 * t_s, 4e4 * t_s])
    >>> np.savetxt("rig.txt", table, header="Time (ms);drive;sensor (nm)", delimiter=";")
    >>> found = pl.import_recordings("rig.txt")
    >>> found.recordings[0].x_um[-1].round(1)
    19.8
    """

    recordings: Recordings
    mapped: Sequence[Mapped]
    notes: Sequence[str]

    @property
    def columns(self) -> dict[str, list[object]]:
        """One entry for each column of the recordings: name, the file's column and label, the factor, and why."""
        return {
            "name": [one.name for one in self.mapped],
            "column": [one.column.number for one in self.mapped],
            "label": [one.column.label for one in self.mapped],
            "factor": [one.scale for one in self.mapped],
            "why": [one.why for one in self.mapped],
        }

    def as_dict(self) -> dict[str, object]:
        """As ``phaselead log import --json`` writes it."""
        rows = [dict(zip(self.columns, row, strict=True)) for row in zip(*self.columns.values(), strict=True)]
        return {"columns": rows, "notes": list(self.notes), "recordings": [r.facts() for r in self.recordings]}

    def tables(self) -> list[Table | str]:
        said = tuple(
            (one.name, f"column {one.column.number} {one.column.label}".rstrip(), f"x {one.scale:g}", one.why)
            for one in self.mapped
        )
        first = self.recordings[0].columns
        rows = tuple(
            tuple(f"{values[i]:.6g}" for values in first.values()) for i in range(min(PREVIEW_ROWS, _rows(first)))
        )
        return [Table(("becomes", "from", "", "because"), said), Table(tuple(first), rows), *self.notes]

    def __repr__(self) -> str:
        return f"<Imported: {len(self.recordings)} recordings, {', '.join(one.name for one in self.mapped)}>"


def _rows(columns: Mapping[str, Samples]) -> int:
    return len(columns["t_s"])


def import_files(
    paths: Sequence[str], columns: str | None = None, rate_Hz: float | None = None, *, flip: bool = False
) -> Imported:
    """Recordings of one file, or of several whose columns belong side by side (voltages in one, positions in another).

    ``columns`` maps by label or number, ``"u_V=drive,x_um=sensor*1e6"``; without it they are guessed. ``rate_Hz``
    stands in for times, ``flip`` turns the sign of positions. Raises BadInput where no recording can be made.
    """
    tables = _side_by_side([(path, read_foreign(path)) for path in paths])
    mapped = guess(tables[0].columns) if columns is None else mapped_by_name(columns, tables[0].columns)
    source = paths[0]
    _refuse_incomplete(source, mapped, tables[0], rate_Hz)
    names = [source] if len(tables) == 1 else [f"{source}#{i}" for i in range(1, len(tables) + 1)]
    found = [_recording(name, table, mapped, rate_Hz, flip) for name, table in zip(names, tables, strict=True)]
    used = {one.column.number for one in mapped}
    unused = [f"{c.number} {c.label}".rstrip() for c in tables[0].columns if c.number not in used]
    notes = [f"assumed: {line}" for line in tables[0].assumed]
    notes += [f"left out: column {', '.join(unused)}"] if unused else []
    doubts = [line for recording in found for line in doubts_about(recording)]
    return Imported(Recordings(found), mapped, notes + _about_directions(found) + doubts)


def _side_by_side(files: Sequence[tuple[str, list[ForeignTable]]]) -> list[ForeignTable]:
    first, *others = files
    tables = first[1]
    for path, more in others:
        if len(more) != len(tables) or any(_length(a) != _length(b) for a, b in zip(tables, more, strict=True)):
            raise BadInput(f"{path}: its columns have not the length of those of {first[0]}; import them apart")
        tables = [_joined(a, b) for a, b in zip(tables, more, strict=True)]
    return tables


def _length(table: ForeignTable) -> int:
    return len(table.columns[0].values)


def _joined(left: ForeignTable, right: ForeignTable) -> ForeignTable:
    shift = max(column.number for column in left.columns)
    more = tuple(replace(column, number=column.number + shift) for column in right.columns)
    return ForeignTable(left.columns + more, left.assumed + right.assumed)


def mapped_by_name(text: str, columns: Sequence[ForeignColumn]) -> list[Mapped]:
    """``"u_V=drive,x_um=5*1e6"``: columns by label, or by number from 1. Raises BadInput."""
    found = []
    for item in text.split(","):
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([^*]+?)\s*(?:\*\s*(\S+)\s*)?", item)
        if not match or match[1] not in UNITS:
            raise BadInput(
                f"--map: {shown(item)} is not NAME=COLUMN or NAME=COLUMN*FACTOR with a NAME of {', '.join(UNITS)}"
            )
        try:
            factor = float(match[3] or 1)
        except ValueError:
            raise BadInput(f"--map: {shown(match[3])} is no number; give a factor as in x_um=3*1e6") from None
        if not np.isfinite(factor) or factor == 0:
            raise BadInput(f"--map: a factor of {factor:g} leaves nothing; give one that is finite and not 0")
        found.append(Mapped(match[1], _called(match[2], columns), factor, "you said so"))
    return found


def _called(text: str, columns: Sequence[ForeignColumn]) -> ForeignColumn:
    for column in columns:
        if text in (column.label, str(column.number)):
            return column
    labels = [column.label for column in columns if column.label]
    close = difflib.get_close_matches(text, labels, n=1)
    there = f"did you mean {close[0]}?" if close else f"there are {', '.join(labels) or f'columns 1 to {len(columns)}'}"
    raise BadInput(f"--map: there is no column {shown(text)}; {there}")


def _refuse_incomplete(source: str, mapped: Sequence[Mapped], table: ForeignTable, rate_Hz: float | None) -> None:
    names = {one.name for one in mapped}
    there = ", ".join(f"{column.number} {column.label}".rstrip() for column in table.columns)
    if not names - {"t_s"}:
        raise BadInput(f"{source}: which columns are voltage and position? Say so with --map; there are {there}")
    if "t_s" not in names and rate_Hz is None:
        raise BadInput(f"{source}: no column looks like a time (there are {there}); give --rate, e.g. --rate 200Hz")


def _recording(
    name: str, table: ForeignTable, mapped: Sequence[Mapped], rate_Hz: float | None, flip: bool
) -> Recording:
    by_number = {column.number: column.values for column in table.columns}
    columns = {one.name: by_number[one.column.number] * one.scale for one in mapped}
    for column, values in columns.items():
        require_measured(column, values, lambda row: f"row {row + 1}", name)
    rows = len(next(iter(columns.values())))
    if rate_Hz is not None:
        columns["t_s"] = np.arange(rows) / rate_Hz
    if flip:
        columns = {key: -values if key.endswith("_um") else values for key, values in columns.items()}
    axes_of({key: values for key, values in columns.items() if key != "t_s"}, name)
    return replace(from_columns(columns, name), sha256="")


def _about_directions(recordings: Sequence[Recording]) -> list[str]:
    """Axes whose position falls where the voltage rises."""
    falling = []
    for axis in recordings[0].axes:
        pairs = [(r.axes[axis].u_V, r.axes[axis].x_um) for r in recordings]
        whole = [(u, x) for u, x in pairs if u is not None and x is not None]
        if whole and counts_backwards(whole):
            falling.append(axis)
    if not falling:
        return []
    return [
        f"{', '.join(falling)}: the position falls where the voltage rises: the sensor counts backwards, or a column "
        "is another than it seems; fit takes it as it is, --flip turns the sign of positions"
    ]


def import_names(output: str | os.PathLike[str], count: int) -> list[str]:
    """The files of so many recordings: OUT.h5, or OUT-1.h5, OUT-2.h5 ..."""
    stem, suffix = os.path.splitext(os.fspath(output))
    return [os.fspath(output)] if count == 1 else [f"{stem}-{i}{suffix}" for i in range(1, count + 1)]
