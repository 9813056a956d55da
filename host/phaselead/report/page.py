"""Self-contained HTML pages from templates: no script, no file beside them, no network."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from phaselead.drawing import BLUE, DPI, GREEN, GREY, ORANGE, PURPLE, RED, figure_style, to_svg
from phaselead.record import atomic_path, write_text
from phaselead.report.origin import Origin
from phaselead.version import VERSION

COLOURS_OF_THE_PAGE = {
    "fill: #ffffff": "fill: none",
    "stroke: #ffffff": "stroke: none",
    "fill: #000000": "fill: currentColor",
    "stroke: #000000": "stroke: currentColor",
    "stroke: #e4e4e4": "stroke: var(--grid)",
    BLUE: "var(--blue)",
    ORANGE: "var(--orange)",
    GREEN: "var(--green)",
    RED: "var(--red)",
    PURPLE: "var(--purple)",
    GREY: "var(--grey)",
}
"""What a figure draws its ground, its axes, its grid and its lines with, and what a page has for these: on a dark one
lines are lighter."""
NO_SCRIPTS = {"__main__.py", "ipykernel_launcher.py"}
"""Of some other program, and of a notebook."""
_environment = Environment(
    loader=PackageLoader("phaselead.report", "templates"), autoescape=True, undefined=StrictUndefined
)


def _drawn(figure: Figure) -> Markup:
    """The figure in the colours of the page, light or dark, and with letters of one size on all pages; a click or the
    space bar enlarges it, without a script."""
    with figure_style():  # words stay words, and the same figure is the same text
        text = to_svg(figure)
    for colour, own in COLOURS_OF_THE_PAGE.items():
        text = text.replace(colour, own)
    size = f"--inches: {figure.get_figwidth():g}"
    box = '<input type="checkbox" aria-label="enlarge the figure">'
    return Markup(f'<label class="zoom" style="{size}">{box}{text}</label>')


def _with_code(text: str) -> Markup:
    """A sentence in which what stands between backticks is code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


_environment.filters["svg"] = _drawn
_environment.filters["words"] = _with_code


_made_by: ContextVar[str] = ContextVar("made_by", default="")


@contextmanager
def made_by(command: str) -> Iterator[None]:
    """Pages that are written meanwhile say that this command makes them: of a program that does what a command does."""
    token = _made_by.set(command)
    try:
        yield
    finally:
        _made_by.reset(token)


def command_line() -> str:
    """How the command line, or the script that made the page, was called; empty in any other program."""
    if _made_by.get():
        return _made_by.get()
    program, *words = sys.argv or [""]
    name = Path(program).name
    if (Path(program).parent.name if name == "__main__.py" else name) == "phaselead":
        return shlex.join(["phaselead", *words])
    return shlex.join(["python", name, *words]) if name.endswith(".py") and name not in NO_SCRIPTS else ""


def render(template: str, *, origin: Origin | None = None, **values: Any) -> str:
    """The template with the values in it; a ``Figure`` is placed by the filter ``svg``."""
    given = {"version": VERSION, "command": command_line(), "origin": origin}
    return _environment.get_template(template).render(**given, **values)


def write_page(path: str | Path, template: str, **values: Any) -> None:
    """Renders and writes in one go: a failed render leaves an old page as it was."""
    write_text(path, render(template, **values))


def save_png(figure: Figure, path: str | os.PathLike[str]) -> None:
    """The figure as a picture for a page that takes no SVG, whole or not at all."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI, metadata={"Software": None})


def save_figure(figure: Figure, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """The figure as its suffix says (.png, .svg, .pdf), whole or not at all."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format=Path(path).suffix[1:].lower(), dpi=DPI)


__all__ = ["Figure", "render", "save_figure", "save_png", "write_page"]
