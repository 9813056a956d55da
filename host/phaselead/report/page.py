"""Self-contained HTML pages from templates: no script, no file beside them, no network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from phaselead.drawing import DPI, to_svg
from phaselead.record import atomic_path, write_text
from phaselead.version import VERSION

_environment = Environment(
    loader=PackageLoader("phaselead.report", "templates"), autoescape=True, undefined=StrictUndefined
)
_environment.filters["svg"] = lambda figure: Markup(to_svg(figure))


def render(template: str, **values: Any) -> str:
    """The template with the values in it; a ``Figure`` is placed by the filter ``svg``."""
    return _environment.get_template(template).render(version=VERSION, **values)


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
