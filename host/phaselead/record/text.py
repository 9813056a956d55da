"""Recordings as text: our CSV, and foreign files through a column map.

The fast road hands the cleaned bytes to Arrow's CSV reader. Whatever it refuses is walked line by line,
only to say which line is wrong and why.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from phaselead.errors import BadInput
from phaselead.record.axis_record import Samples
from phaselead.record.checks import (
    MISSING_FROM,
    Where,
    missing_samples,
    require_measured,
    require_rows,
    require_uniform,
)
from phaselead.record.columns import (
    MAP_EXAMPLE,
    ColumnMap,
    check_column_map,
    check_rate,
    header_columns,
    own_header,
    shown,
)

COMMENTS = (b"#", b"%")
MOST_HEADING_LINES = 1000
STAGE_FILE = 'format = "phaselead-stage"'
"""How a stage file begins, which is easily given in place of a recording."""
_COMMENT_LINES = re.compile(rb"(?m)^[ \t]*[#%][^\n]*(?:\n|\Z)")
_BLANKS = re.compile(rb"[ \t]+")
_LINE_ENDS = re.compile(rb"(?m)^ | $")


@dataclass(frozen=True)
class _Layout:
    columns: dict[str, tuple[int, float]]
    delimiter: str
    """"," ";" tab, or " " for any run of blanks."""
    start: int
    """Offset of the first line of data."""
    width: int
    """Fields per line."""


def read_text(
    content: bytes, source: str, columns: ColumnMap | None = None, rate_Hz: float | None = None
) -> dict[str, Samples]:
    """The named columns of a text file, ``t_s`` always among them, one length, finite, uniform in time.

    ``columns`` maps names to 1-based columns and factors for files without our header; ``rate_Hz`` replaces
    the times.
    """
    if columns is not None:
        columns = check_column_map(columns)
    if rate_Hz is not None:
        check_rate(rate_Hz)
    content = _plain_text(content, source)
    layout = _layout(content, source, columns)
    if "t_s" not in layout.columns and rate_Hz is None:
        raise BadInput(f"{source}: has no time; add t_s=COLUMN to --map, or give --rate, e.g. {MAP_EXAMPLE}")
    table = _read_fast(content, layout) or _read_slowly(content, layout, source)

    def where(row: int) -> str:
        return f"line {_line_number(content, layout, row)}"

    for name, (_, scale) in layout.columns.items():
        require_measured(name, table[name], where, source)
        if scale != 1:
            table[name] = table[name] * scale
    require_rows(len(next(iter(table.values()))), source)
    if rate_Hz is not None:
        table["t_s"] = _times_at(rate_Hz, table, where, source)
    require_uniform(table["t_s"], where, source)
    return table


def own_columns(content: bytes) -> ColumnMap | None:
    """The columns of voltage and position, as a map, of text that begins with a header in our units; empty without such
    a header; None where it is no text that can be read."""
    try:
        content = _plain_text(content, "")
    except BadInput:
        return None
    try:
        found = _own_layout(content, "").columns
    except BadInput:
        return {}
    return {name: where for name, where in found.items() if name != "t_s"}


def _plain_text(content: bytes, source: str) -> bytes:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content:
        raise BadInput(f"{source}: is neither text nor HDF5; save it as CSV in UTF-8")
    content = content.removeprefix(b"\xef\xbb\xbf")
    if not content.strip():
        raise BadInput(f"{source}: is empty; a recording begins with a header such as t_s,u_V,x_um")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content


def _lines(content: bytes, start: int = 0) -> Iterator[tuple[int, bytes]]:
    """Offset and text of each line that is not blank."""
    while start < len(content):
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        line = content[start:end]
        if line.strip():
            yield start, line
        start = end + 1


def _is_comment(line: bytes) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _data_lines(content: bytes, start: int) -> Iterator[tuple[int, bytes]]:
    return ((at, line) for at, line in _lines(content, start) if not _is_comment(line))


def _delimiter(line: bytes) -> str:
    for candidate in (";", "\t", ","):
        if candidate.encode() in line:
            return candidate
    return " "


def _fields(line: bytes, delimiter: str) -> list[str]:
    text = line.decode("utf-8", "replace").strip(" ")
    fields = text.split() if delimiter == " " else text.split(delimiter)
    return [field.strip().strip("\"'").strip() for field in fields]


def _layout(content: bytes, source: str, columns: ColumnMap | None) -> _Layout:
    return _own_layout(content, source) if columns is None else _mapped_layout(content, source, columns)


def _own_layout(content: bytes, source: str) -> _Layout:
    first = ""
    for at, line in _lines(content):
        comment = _is_comment(line)
        text = line.lstrip(b" \t#%") if comment else line
        labels = _fields(text, _delimiter(text))
        if own_header(labels) and (not comment or "t_s" in labels):
            start = at + len(line) + 1
            delimiter, width = _shape(content, start, len(labels))
            return _Layout(header_columns(labels, source), delimiter, start, width)
        if not comment:
            first = line.decode("utf-8", "replace")
            break
    if first.startswith(STAGE_FILE):
        raise BadInput(f"{source}: is a stage file (--model takes one); give a recording (.csv or .h5)")
    raise BadInput(
        f"{source}: the first line, {shown(first)}, is no header such as t_s,u_V,x_um; "
        f"name the columns there, map them, e.g. {MAP_EXAMPLE}, or let `phaselead log import {source}` find them"
    )


def _shape(content: bytes, start: int, labels: int) -> tuple[str, int]:
    """Delimiter and width of the data under a header; lines that end in a delimiter have one field more."""
    for _, line in _data_lines(content, start):
        delimiter = _delimiter(line)
        fields = _fields(line, delimiter)
        return delimiter, len(fields) if len(fields) == labels + 1 and not fields[-1] else labels
    return ",", labels


def _mapped_layout(content: bytes, source: str, columns: ColumnMap) -> _Layout:
    """Headings of any kind are passed over until a mapped column holds a number."""
    first, width = "", 0
    last_name, last = max(((name, i) for name, (i, _) in columns.items()), key=lambda item: item[1])
    for at, line in islice(_data_lines(content, 0), MOST_HEADING_LINES):
        delimiter = _delimiter(line)
        fields = _fields(line, delimiter)
        if len(fields) >= last and any(_number(fields[i - 1]) is not None for i, _ in columns.values()):
            return _Layout(dict(columns), delimiter, at, len(fields))
        first = first or line.decode("utf-8", "replace")
        width = max(width, len(fields))
    if width < last:
        raise BadInput(f"{source}: has {width} columns, but {last_name} is mapped to column {last}; correct --map")
    raise BadInput(f"{source}: no mapped column holds a number (the first line is {shown(first)}); correct --map")


def _number(field: str) -> float | None:
    try:
        return float(field)
    except ValueError:
        return None


def _read_fast(content: bytes, layout: _Layout) -> dict[str, Samples] | None:
    """All at once, or None when some line is not as it should be."""
    import pyarrow  # slow to load, and most commands read no text
    from pyarrow import csv

    data = content[layout.start :]
    if any(mark in data for mark in COMMENTS):
        data = _COMMENT_LINES.sub(b"", data)
    if layout.delimiter == " ":
        data = _LINE_ENDS.sub(b"", _BLANKS.sub(b" ", data))
    if not data.strip():
        return {name: np.empty(0) for name in layout.columns}
    names = [f"f{i}" for i in range(1, layout.width + 1)]
    wanted = [f"f{i}" for i, _ in layout.columns.values()]
    try:
        table = csv.read_csv(
            io.BytesIO(data),
            # The pool of threads sometimes aborted the process at exit.
            csv.ReadOptions(use_threads=False, column_names=names),
            csv.ParseOptions(delimiter=layout.delimiter),
            csv.ConvertOptions(
                column_types={name: pyarrow.float64() for name in wanted},
                include_columns=wanted,
                null_values=[""],
                check_utf8=False,
            ),
        )
    except (pyarrow.ArrowException, ValueError):
        return None
    return {
        name: np.array(table.column(f"f{i}").to_numpy(), dtype=np.float64) for name, (i, _) in layout.columns.items()
    }


def _read_slowly(content: bytes, layout: _Layout, source: str) -> dict[str, Samples]:
    """Line by line: raises BadInput at the first line that is wrong."""
    values: dict[str, list[float]] = {name: [] for name in layout.columns}
    for row, (_, line) in enumerate(_data_lines(content, layout.start)):
        fields = _fields(line, layout.delimiter)
        if len(fields) != layout.width:
            number = _line_number(content, layout, row)
            raise BadInput(
                f"{source}: line {number}: has {len(fields)} fields, {layout.width} expected "
                f"({shown(line.decode('utf-8', 'replace'))}); remove or repair the line"
            )
        for name, (i, _) in layout.columns.items():
            value = _number(fields[i - 1])
            if value is None and fields[i - 1]:
                number = _line_number(content, layout, row)
                raise BadInput(
                    f"{source}: line {number}: {name} is {shown(fields[i - 1])}, not a number "
                    "(decimals take a point); repair the line, or convert the file (phaselead log import)"
                )
            values[name].append(np.nan if value is None else value)
    return {name: np.array(column) for name, column in values.items()}


def _line_number(content: bytes, layout: _Layout, row: int) -> int:
    """1-based line of the file on which a row of data stands."""
    for i, (at, _) in enumerate(_data_lines(content, layout.start)):
        if i == row:
            return content.count(b"\n", 0, at) + 1
    return content.count(b"\n") + 1


def _times_at(rate_Hz: float, table: dict[str, Samples], where: Where, source: str) -> Samples:
    """Times at an exact rate, from the file's first time if it has times, which may only be rounded."""
    rows = len(next(iter(table.values())))
    times = table.get("t_s")
    if times is not None and rows > 1:
        span = float(times[-1] - times[0])
        if not abs(span * rate_Hz - (rows - 1)) <= 0.01 * (rows - 1) + 1:
            told = f"{(rows - 1) / span:.6g} Hz" if span > 0 else "no rate"
            raise BadInput(f"{source}: t_s says {told}, --rate says {rate_Hz:g} Hz; leave one of them out")
        _refuse_missing(times, rate_Hz, where, source)
    return (float(times[0]) if times is not None else 0.0) + np.arange(rows) / rate_Hz


def _refuse_missing(times: Samples, rate_Hz: float, where: Where, source: str) -> None:
    """Refuses steps that no rounding of the times explains, since an exact rate would hide them."""
    steps = np.diff(times)
    backwards = np.flatnonzero(steps < 0)
    if backwards.size:
        raise BadInput(
            f"{source}: {where(int(backwards[0]) + 1)}: t_s goes back, which --rate would hide; sort the rows"
        )
    longest = MISSING_FROM / rate_Hz
    if (steps == 0).any():  # printed more coarsely than sampled: a step is one unit of the print, or none
        longest = 1 / rate_Hz + MISSING_FROM * float(steps[steps > 0].min())
    row = int(np.argmax(steps)) + 1
    if steps[row - 1] > longest:
        raise BadInput(
            f"{source}: {where(row)}: t_s steps by {steps[row - 1]:.6g} s, --rate says {1 / rate_Hz:.6g} s; "
            + missing_samples(where(row))
        )
