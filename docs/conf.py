"""How Sphinx makes a site of the pages in this folder: ``make manual``. Strict, and without a network."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

import phaselead

project = "phaselead"
author = copyright = "the phaselead authors"
version = release = phaselead.__version__

extensions = ["myst_nb"]
nitpicky = True
suppress_warnings = ["config.cache"]

# Anchors as GitHub makes them, so that the same links work in the repository.
myst_heading_anchors = 4

# Every notebook runs in a folder of its own in each build; nothing that it prints is kept in the repository.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}

html_theme = "furo"
html_title = f"phaselead {release}"
html_copy_source = False
html_show_sourcelink = False
highlight_language = "text"

FETCHED = re.compile(r"<(?:script|img|iframe|link)\b[^>]*\b(?:src|href)=\"(?:https?:)?//[^\"]*\"")


def refuse_what_needs_a_network(app: Sphinx, exception: Exception | None) -> None:
    """Bench computers have none, and a reader is nobody else's business."""
    if exception is None and app.builder.format == "html":
        for page in Path(app.outdir).rglob("*.html"):
            for tag in FETCHED.findall(page.read_text("utf-8")):
                raise ExtensionError(f"{page.name} would be fetched in part: {tag}")


def setup(app: Sphinx) -> None:
    app.connect("build-finished", refuse_what_needs_a_network)
