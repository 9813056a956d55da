"""The text of a stage file: a model of ``fields.Part`` as TOML, each key commented with its description."""

from __future__ import annotations

from typing import Any

import tomlkit
from tomlkit.items import Item

from phaselead.model.fields import Part

HEADING = """\
Stage file of phaselead: what is known about one piezo stage.
Units are in the names of the keys. Lines may be edited; every value is checked when the file is read."""


def toml_text(model: Part) -> str:
    """The commented TOML of a model. Keys that are None are left out; floats keep every bit."""
    document = tomlkit.document()
    for line in HEADING.splitlines():
        document.add(tomlkit.comment(line))
    document.add(tomlkit.nl())
    _fill(document, model)
    return tomlkit.dumps(document)


def _fill(table: Any, model: Part) -> None:
    """Plain keys first, tables after them: TOML would take a later key for the table's own."""
    later: list[tuple[str, Any]] = []
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if value is None:
            continue
        if _is_table(value):
            later.append((name, value))
            continue
        item = _item(value)
        if field.description and not _is_rows(value):
            item.comment(field.description)
        elif field.description:
            table.add(tomlkit.comment(f"{name}: {field.description}"))
        table.add(name, item)
    for name, value in later:
        table.add(name, _table(value))


def _is_table(value: object) -> bool:
    return isinstance(value, (Part, dict)) or _is_parts(value)


def _is_parts(value: object) -> bool:
    """Lists of tables; short rows of numbers are better read as one line each."""
    return isinstance(value, tuple) and bool(value) and isinstance(value[0], Part) and not _is_row(value[0])


def _is_row(value: object) -> bool:
    return isinstance(value, Part) and all(isinstance(getattr(value, name), float) for name in type(value).model_fields)


def _is_rows(value: object) -> bool:
    return isinstance(value, tuple) and bool(value) and (isinstance(value[0], tuple) or _is_row(value[0]))


def _table(value: Any) -> Item:
    if _is_parts(value):
        tables = tomlkit.aot()
        for part in value:
            tables.append(_table(part))
        return tables
    table = tomlkit.table()
    if isinstance(value, Part):
        _fill(table, value)
    else:
        for name, item in value.items():
            table.add(name, _table(item) if _is_table(item) else _item(item))
    return table


def _item(value: Any) -> Item:
    if _is_row(value):
        row = tomlkit.inline_table()
        for name in type(value).model_fields:
            row.append(name, getattr(value, name))
        return row
    if isinstance(value, tuple):
        array = tomlkit.array()
        for element in value:
            array.append(_item(element))
        array.multiline(_is_rows(value))
        return array
    item: Item = tomlkit.item(value)
    return item
