"""Which commands there are, read from their sources: importing them all would take seconds.

A command is a function of this folder that is marked with ``top_level``.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import click

C = TypeVar("C", bound=click.Command)
LAST = 1000
MARK = "top_level"
GROUPS = {"start": "Start", "model": "Model", "device": "Device", "records": "Records", "gap": "Gap"}
"""Of the list in `phaselead --help`, in its order, with their headings."""
USUAL_GROUP = "device"


def top_level(order: int = LAST, group: str = USUAL_GROUP) -> Callable[[C], C]:
    """Marks a command as one of ``phaselead`` itself. ``order`` is its place in the list, the last by default,
    ``group`` one of ``GROUPS``."""
    return lambda command: command


class Listed(NamedTuple):
    """A command as its source tells it."""

    order: int
    name: str
    """The function's."""
    module: str
    help: str
    group: str = USUAL_GROUP


@cache
def listed(folders: tuple[str, ...]) -> dict[str, Listed]:
    """Every command in the files of these folders by name, in order; a hyphen stands for the name's underscore."""
    found = [one for folder in folders for path in sorted(Path(folder).glob("*.py")) for one in read_commands(path)]
    return {one.name.replace("_", "-"): one for one in sorted(found)}


def read_commands(path: Path) -> list[Listed]:
    """The commands in one file."""
    text = path.read_text("utf-8")
    if f"@{MARK}" not in text:
        return []
    return [
        Listed(
            int(_given(mark, 0, "order", LAST)),
            node.name,
            path.stem,
            ast.get_docstring(node) or "",
            str(_given(mark, 1, "group", USUAL_GROUP)),
        )
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef)
        for mark in node.decorator_list
        if isinstance(mark, ast.Call) and isinstance(mark.func, ast.Name) and mark.func.id == MARK
    ]


def _given(mark: ast.Call, place: int, name: str, default: int | str) -> int | str:
    """An argument of a mark, by place or by name."""
    named = {keyword.arg: keyword.value for keyword in mark.keywords}
    value = mark.args[place] if place < len(mark.args) else named.get(name)
    return default if value is None else ast.literal_eval(value)
