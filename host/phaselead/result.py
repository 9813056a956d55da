"""What every result is to a person: tables as plain text and as HTML, and a data frame.

A class that is a ``Result`` says what its tables and its columns are; printing, notebooks and pandas follow from that.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from phaselead.errors import PhaseleadError


@dataclass(frozen=True)
class Table:
    """Rows of text under headings. Every row has as many cells as there are headings; no headings, no heading line."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""

    def __str__(self) -> str:
        """Aligned columns, numbers to the right."""
        lines = ([self.headings] if any(self.headings) else []) + list(self.rows)
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)] if lines else []
        right = [bool(self.rows) and all(map(_is_number, column)) for column in zip(*self.rows, strict=True)]
        right = right or [False] * len(widths)
        text = [
            "  ".join(
                cell.rjust(w) if to_right else cell.ljust(w)
                for cell, w, to_right in zip(line, widths, right, strict=True)
            ).rstrip()
            for line in lines
        ]
        return "\n".join(([self.title] if self.title else []) + text)

    def without(self, heading: str) -> Table:
        """The same without the column of this heading."""
        kept = [i for i, one in enumerate(self.headings) if one != heading]
        rows = tuple(tuple(row[i] for i in kept) for row in self.rows)
        return Table(tuple(self.headings[i] for i in kept), rows, self.title)

    def html(self) -> str:
        """A ``<table>``; every cell is escaped."""
        title = f"<caption>{html.escape(self.title)}</caption>" if self.title else ""
        words = [not all(map(_is_number, column)) for column in zip(*self.rows, strict=True)]
        look = [' class="words"' if of_words else "" for of_words in words or [False] * len(self.headings)]
        head = "".join(f"<th{how}>{html.escape(cell)}</th>" for how, cell in zip(look, self.headings, strict=True))
        head = f"<thead><tr>{head}</tr></thead>" if any(self.headings) else ""
        rows = (
            "".join(f"<td{how}>{html.escape(cell)}</td>" for how, cell in zip(look, row, strict=True))
            for row in self.rows
        )
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table>{title}{head}<tbody>{body}</tbody></table>"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == ""
    return True


def pairs_table(figures: Mapping[str, Any], title: str = "") -> Table:
    """One line a figure, names in words."""
    return Table(("", ""), tuple((name.replace("_", " "), str(value)) for name, value in figures.items()), title)


class Result:
    """Base of every result: ``print`` gives tables, a notebook shows them as HTML, ``to_pandas`` gives a data frame."""

    def tables(self) -> Sequence[Table | str]:
        """What is printed, in order: tables and sentences."""
        raise NotImplementedError

    @property
    def columns(self) -> Mapping[str, Any]:
        """The columns of the data frame, units in the names: arrays or lists of one length."""
        raise NotImplementedError

    def __str__(self) -> str:
        return "\n".join(str(part) for part in self.tables())

    def _repr_html_(self) -> str:
        parts = (part.html() if isinstance(part, Table) else f"<p>{html.escape(part)}</p>" for part in self.tables())
        return "".join(parts)

    def to_pandas(self) -> Any:
        """The columns as a ``pandas.DataFrame``. Raises PhaseleadError where pandas is not installed."""
        try:
            import pandas  # optional: nothing else here needs it
        except ImportError:
            raise PhaseleadError("to_pandas needs pandas, which is not installed; pip install pandas") from None
        return pandas.DataFrame(dict(self.columns))


class Facts(Result, dict[str, Any]):
    """Named figures, as a dictionary that prints as a table."""

    def tables(self) -> list[Table | str]:
        return [pairs_table(self)]

    @property
    def columns(self) -> Mapping[str, Any]:
        return {"figure": list(self.keys()), "value": [str(value) for value in self.values()]}

    def __repr__(self) -> str:
        return dict.__repr__(self)


def jsonable(value: Any) -> Any:
    """Plain JSON types; what is not finite becomes null, so that every reader can parse it."""
    if isinstance(value, dict):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, float) or hasattr(value, "dtype"):
        number = value.item() if hasattr(value, "item") else value
        return number if not isinstance(number, float) or math.isfinite(number) else None
    return value


def json_text(figures: dict[str, Any]) -> str:
    """Figures as a JSON file."""
    return json.dumps(jsonable(figures), indent=2) + "\n"
