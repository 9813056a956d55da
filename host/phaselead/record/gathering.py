"""Recordings however they are given: in memory, as arrays, as files, as patterns of file names, or a list of these."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from phaselead.errors import BadInput
from phaselead.record.axis_record import Samples
from phaselead.record.checks import require_measured, require_uniform
from phaselead.record.columns import UNITS, ColumnMap, axes_of, parse_column_map, parse_rate, shown
from phaselead.record.read import read_recording, refuse_map_of_some, split_argument
from phaselead.record.recording import Recording, Recordings


@runtime_checkable
class Recorded(Protocol):
    """What carries a recording, as a run does."""

    @property
    def recording(self) -> Recording: ...


RecordLike = Recording | Recorded | Recordings | str | os.PathLike[str]
"""One recording, in memory or by a file's name, with a window (``"rec.csv@5:7"``); or several, by a pattern
(``"kept/*.h5"``) or as they were read before."""
RecordsLike = RecordLike | Iterable[RecordLike]
MapLike = str | Mapping[str, int | tuple[int, float]]
"""Columns of a file without our header, counted from 1: ``"u_V=1,x_um=3*1e6"`` or ``{"u_V": 1, "x_um": (3, 1e6)}``."""


def gather(records: RecordsLike, map: MapLike | None = None, rate: str | float | None = None) -> Recordings:
    """Every recording that ``records`` names, in order; those of a pattern by name.

    ``map`` and ``rate`` (``"200Hz"``, or a number in Hz) are for files without our header. Raises BadInput, one line.
    """
    return gather_parts((records,), map, rate)[0]


def gather_parts(
    parts: Sequence[RecordsLike], map: MapLike | None = None, rate: str | float | None = None
) -> list[Recordings]:
    """``gather`` of each part, where one map is for all of them. Raises BadInput, one line."""
    columns, rate_Hz = _column_map(map), parse_rate(rate) if isinstance(rate, str) else rate
    each = [list(_each(part)) for part in parts]
    if columns is not None:
        refuse_map_of_some([name for part in each for name in _files(part)], columns)
    return [_gathered(part, columns, rate_Hz) for part in each]


def _gathered(records: Sequence[RecordLike], columns: ColumnMap | None, rate_Hz: float | None) -> Recordings:
    found = Recordings()
    for one in records:
        if isinstance(one, Recording):
            found.append(one)
        elif isinstance(one, Recordings):
            found += one
        elif isinstance(one, Recorded):
            found.append(one.recording)
        elif isinstance(one, str | os.PathLike):
            found += [read_recording(name, columns=columns, rate_Hz=rate_Hz) for name in _names(os.fspath(one))]
        else:
            raise BadInput(f"a {type(one).__name__} is no recording; give a recording, a run or a file's name")
    return found


def _files(records: Iterable[RecordLike]) -> list[str]:
    """The files among some records, those of a pattern one by one."""
    named = [os.fspath(one) for one in records if isinstance(one, str | os.PathLike)]
    return [name for one in named for name in _names(one)]


def gather_one(record: RecordLike, map: MapLike | None = None, rate: str | float | None = None) -> Recording:
    """The one recording that is meant. Raises BadInput, also when there are several."""
    found = gather(record, map, rate)
    if len(found) != 1:
        raise BadInput(f"{len(found)} recordings are given where one is wanted; give one")
    return found[0]


def from_columns(columns: Mapping[str, ArrayLike], source: str = "arrays") -> Recording:
    """A recording of arrays, shape (n,) each, named like the columns of a CSV file; ``t_s`` and others.

    Raises BadInput for another name, shapes that differ, values that are no number, and times that are not uniform.
    """
    unknown = [name for name in columns if name not in UNITS]
    if unknown or "t_s" not in columns:
        raise BadInput(
            f"{source}: {unknown[0] if unknown else 't_s'} {'is no column' if unknown else 'is missing'}; "
            f"there are {', '.join(UNITS)}"
        )
    arrays = {name: _real(name, values, source) for name, values in columns.items()}
    t_s = arrays.pop("t_s")

    def where(row: int) -> str:
        return f"row {row + 1}"

    for name, values in arrays.items():
        if values.shape != t_s.shape or values.ndim != 1:
            raise BadInput(f"{source}: {name} has shape {values.shape}, t_s {t_s.shape}; one value for each time")
        require_measured(name, values, where, source)
    require_measured("t_s", t_s, where, source)
    require_uniform(t_s, where, source)
    return Recording(t_s=t_s, axes=axes_of(arrays, source), source=source)


def _real(name: str, values: ArrayLike, source: str) -> Samples:
    """A column as an array of its own. Raises BadInput for what holds anything but real numbers."""
    try:
        found = np.array(values)
        if found.dtype.kind not in "biufO":  # of text, times, or with an imaginary part that would be dropped
            raise TypeError
        return found.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise BadInput(f"{source}: {name} holds what is no real number; give an array of one for each time") from None


def _each(records: RecordsLike) -> Iterable[RecordLike]:
    if isinstance(records, Recording | Recorded | str | os.PathLike):
        return [records]
    if not isinstance(records, Iterable):
        raise BadInput(f"a {type(records).__name__} is no recording; give a recording, a run or a file's name")
    return records


def _names(argument: str) -> list[str]:
    """The files of a pattern, each with the pattern's window; an argument without a pattern as it is."""
    path, _ = split_argument(argument)
    if not glob.has_magic(path) or os.path.exists(path):
        return [argument]
    names = sorted(glob.glob(path))
    if not names:
        raise BadInput(f"{argument}: no file has such a name; check the folder and the pattern")
    return [name + argument[len(path) :] for name in names]


def _column_map(columns: MapLike | None) -> ColumnMap | None:
    if columns is None or isinstance(columns, str):
        return parse_column_map(columns) if columns else None
    if not isinstance(columns, Mapping):
        raise BadInput(f"column map: {shown(str(columns))} is none; give one such as {{'u_V': 1, 'x_um': (3, 1e6)}}")
    return {name: _placed(name, where) for name, where in columns.items()}


def _placed(name: str, where: Any) -> tuple[int, float]:
    """A column and its factor, however they are given. Raises BadInput."""
    column, factor = where if isinstance(where, tuple) and len(where) == 2 else (where, 1.0)
    if not isinstance(column, Integral) or not isinstance(factor, Real):
        raise BadInput(
            f"column map: {name}={shown(str(where))} is no column; give its number, counted from 1, or (number, factor)"
        )
    return int(column), float(factor)
