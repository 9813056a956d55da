"""Self-contained HTML pages from templates: no script, no file beside them, no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from phaselead import __version__
from phaselead.drawing import to_svg
from phaselead.record import write_text

_environment = Environment(
    loader=PackageLoader("phaselead.report", "templates"), autoescape=True, undefined=StrictUndefined
)
_environment.filters["svg"] = lambda figure: Markup(to_svg(figure))


def render(template: str, **values: Any) -> str:
    """The template with the values in it; a ``Figure`` is placed by the filter ``svg``."""
    return _environment.get_template(template).render(version=__version__, **values)


def write_page(path: str | Path, template: str, **values: Any) -> None:
    """Renders and writes in one go: a failed render leaves an old page as it was."""
    write_text(path, render(template, **values))


__all__ = ["Figure", "render", "write_page"]
