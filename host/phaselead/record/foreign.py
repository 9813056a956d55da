"""Files that other programs wrote, as labelled columns: text of any delimiter and decimal sign, NumPy, MATLAB, HDF5."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phaselead.errors import BadInput
from phaselead.record.axis_record import Samples
from phaselead.record.bounded import require_walkable
from phaselead.record.checks import require_rows
from phaselead.record.hdf5 import SIGNATURE

FEWEST_ROWS = 16
"""Of a column: shorter arrays of a file are parameters, not signals."""
MOST_HEADING_LINES = 1000
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?nan|[+-]?inf", re.IGNORECASE)


@dataclass(frozen=True)
class ForeignColumn:
    """One column as its file has it; ``number`` counts all columns that are read, from 1."""

    number: int
    label: str
    values: Samples
    """Shape (n,)."""
    unit: str = ""
    """As the file says, empty where it does not."""


@dataclass(frozen=True)
class ForeignTable:
    """Columns of one length, and what was assumed to read them."""

    columns: tuple[ForeignColumn, ...]
    assumed: tuple[str, ...] = ()


def read_foreign(path: str) -> list[ForeignTable]:
    """The tables of a file: one, or one for each recording that an array of more dimensions holds.

    Raises BadInput for a file without columns of numbers.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(128)
        if head.startswith(b"\x93NUMPY") or head.startswith(b"PK\x03\x04"):
            return _tables_of_arrays(path, _numpy_arrays(path))
        if head.startswith(SIGNATURE) or head[:6] == b"MATLAB":
            return _tables_of_arrays(path, _matlab_arrays(path, head))
        return [_text_table(path)]
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror or error}); give a file of columns") from None


def _numpy_arrays(path: str) -> dict[str, Any]:
    try:
        found = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise BadInput(f"{path}: is no array of numbers ({error}); save plain float arrays") from None
    return dict(found) if isinstance(found, np.lib.npyio.NpzFile) else {Path(path).stem: found}


def _matlab_arrays(path: str, head: bytes) -> dict[str, Any]:
    """Numeric variables, fields of structs as STRUCT.FIELD."""
    if b"MATLAB 7.3" in head or head.startswith(SIGNATURE):
        return _hdf5_arrays(path)
    from scipy.io import loadmat  # slow to load
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(path, simplify_cells=True)
    except (MatReadError, ValueError, NotImplementedError) as error:
        raise BadInput(f"{path}: is no MATLAB file that can be read ({error}); save it again with -v7") from None
    return dict(_flat({name: value for name, value in found.items() if not name.startswith("__")}))


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _hdf5_arrays(path: str) -> dict[str, Any]:
    import h5py  # slow to load

    found: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        # MATLAB stores matrices by columns: a row of HDF5 is one of its columns.
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
            found[name.replace("/", ".")] = np.asarray(item[()]).T

    require_walkable(path)
    with h5py.File(path, "r", locking=False) as file:
        file.visititems(keep)
    return found


def _tables_of_arrays(path: str, arrays: Mapping[str, Any]) -> list[ForeignTable]:
    """Signals that have one length; an array of more than two dimensions makes several recordings."""
    signals = {
        name: np.squeeze(np.asarray(array, np.float64))
        for name, array in arrays.items()
        if np.asarray(array).dtype.kind in "fiu" and np.asarray(array).size >= FEWEST_ROWS
    }
    if not signals:
        raise BadInput(f"{path}: holds no numbers of {FEWEST_ROWS} rows or more; save the signals as plain arrays")
    lengths = [max(signal.shape) for signal in signals.values()]
    rows = max(set(lengths), key=lambda length: (lengths.count(length), length))
    assumed = [
        f"{name}: left out, it has {max(s.shape)} rows, not {rows}"
        for name, s in signals.items()
        if rows not in s.shape
    ]
    parts: dict[str, list[Samples]] = {}
    for name, signal in signals.items():
        if rows in signal.shape:
            parts[name], said = _recordings_of(name, np.moveaxis(signal, signal.shape.index(rows), 0))
            assumed += said
    count = max(len(each) for each in parts.values())
    return [
        _table_of({name: each[min(i, len(each) - 1)] for name, each in parts.items()}, assumed) for i in range(count)
    ]


def _recordings_of(name: str, signal: Samples) -> tuple[list[Samples], list[str]]:
    """Columns (n, k) of each recording of a signal (rows, channels, recordings, periods), and what that assumes."""
    if signal.ndim <= 2:
        return [signal.reshape(len(signal), -1)], []
    if signal.ndim > 4:
        raise BadInput(f"{name}: has {signal.ndim} dimensions; give (rows, channels, recordings, periods) or fewer")
    four = signal if signal.ndim == 4 else signal[..., None]
    rows, channels, recordings, periods = four.shape
    # One period after the other, for every recording.
    each = [four[:, :, i, :].transpose(2, 0, 1).reshape(rows * periods, channels) for i in range(recordings)]
    said = f"{name}: {' x '.join(map(str, signal.shape))} taken as {rows} rows, {channels} channels, "
    said += f"{recordings} recordings"
    return each, [said + (f", {periods} periods one after the other" if periods > 1 else "")]


def _table_of(parts: Mapping[str, Samples], assumed: list[str]) -> ForeignTable:
    named = [
        (name if part.shape[1] == 1 else f"{name}[{i + 1}]", part[:, i])
        for name, part in parts.items()
        for i in range(part.shape[1])
    ]
    columns = [ForeignColumn(i, name, values) for i, (name, values) in enumerate(named, 1)]
    return ForeignTable(tuple(columns), tuple(assumed))


def _text_table(path: str) -> ForeignTable:
    lines = _decoded(path).splitlines()
    start, delimiter = _first_row(path, lines)
    first = _split(lines[start], delimiter)
    comma = delimiter != "," and any("," in line for line in lines[start:] if not _is_comment(line))
    assumed = [f"values separated by {_DELIMITERS[delimiter]}" + (", decimals written with a comma" if comma else "")]
    labels, units = _heading(lines[:start], delimiter, len(first))
    rows = []
    for i, line in enumerate(lines[start:], start + 1):
        if not line.strip() or _is_comment(line):
            continue
        fields = _split(line, delimiter)
        if len(fields) < len(first) or any(fields[len(first) :]):
            mend = "remove or repair it"
            if delimiter == ",":
                mend += "; where decimals are written with a comma, save it with another delimiter"
            raise BadInput(f"{path}: line {i}: has {len(fields)} fields, {len(first)} expected; {mend}")
        rows.append([_value(field, comma) for field in fields[: len(first)]])
    table = np.array(rows, np.float64)
    require_rows(len(table), path)
    columns = [
        ForeignColumn(i + 1, labels[i], table[:, i], units[i])
        for i in range(len(first))
        if not np.isnan(table[:, i]).all()
    ]
    return ForeignTable(tuple(columns), tuple(assumed))


_DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%"))


def _decoded(path: str) -> str:
    content = Path(path).read_bytes()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    if b"\0" in content:
        raise BadInput(f"{path}: is neither text nor .npy, .npz, .mat or HDF5; give a file of columns of numbers")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _first_row(path: str, lines: list[str]) -> tuple[int, str]:
    """The first line that is nothing but numbers, counted from 0, and what separates them."""
    for i, line in enumerate(lines[:MOST_HEADING_LINES]):
        for delimiter in _DELIMITERS:
            fields = _split(line, delimiter)
            numbers = [field for field in fields if _NUMBER.fullmatch(field)]
            if (
                len(numbers) >= 1
                and len(numbers) == len([f for f in fields if f])
                and (len(fields) > 1 or delimiter == " ")
            ):
                if delimiter == "," and _is_decimal(line):
                    continue
                return i, delimiter
    raise BadInput(f"{path}: holds no line of numbers; give a file with columns of numbers")


def _is_decimal(line: str) -> bool:
    """Whether the commas of a line are decimal signs: blanks or tabs separate numbers that have one each."""
    fields = line.split()
    return len(fields) > 1 and all(re.fullmatch(r"[+-]?\d+,\d+([eE][+-]?\d+)?", field) for field in fields)


def _split(line: str, delimiter: str) -> list[str]:
    parts = line.split() if delimiter == " " else line.rstrip("\r").split(delimiter)
    while len(parts) > 1 and not parts[-1].strip():
        parts.pop()
    return [part.strip().strip("\"'").strip() for part in parts]


def _value(field: str, comma: bool) -> float:
    text = field.replace(",", ".") if comma else field
    try:
        return float(text.replace("D", "e").replace("d", "e")) if text else np.nan
    except ValueError:
        return np.nan


def _heading(lines: list[str], delimiter: str, width: int) -> tuple[list[str], list[str]]:
    """Labels and units of the columns: of the lines above the data the last that has a word for each, or the one before
    where that last one holds nothing but units."""
    found: list[list[str]] = []
    for line in reversed(lines):
        text = line.strip().lstrip("#% ")
        fields = _split(text, delimiter)
        if len(fields) != width and delimiter == " ":
            fields = re.split(r"\s{2,}", text)
        if len(fields) == width and any(fields):
            found.append(fields)
            if len(found) == 2:
                break
    if not found:
        return [""] * width, [""] * width
    alone = [re.fullmatch(r"[\[(]?([a-zA-Z\u00b5\u03bc/%]{1,4})[\])]?", field) for field in found[0]]
    if len(found) == 2 and all(match and match[1] in UNIT_WORDS for match in alone):
        return found[1], [match[1] if match else "" for match in alone]
    return found[0], [""] * width


UNIT_WORDS = frozenset(
    ["s", "ms", "us", "\u00b5s", "\u03bcs", "ns", "min", "V", "mV", "uV", "\u00b5V", "kV"]
    + [prefix + "m" for prefix in ("", "c", "m", "u", "\u00b5", "\u03bc", "n", "p")]
)
"""Of a line of units under the labels."""
