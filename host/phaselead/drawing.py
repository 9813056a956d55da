"""The look of every figure, and how a figure becomes part of a page."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from phaselead.record import atomic_path

# Okabe & Ito's palette: told apart by readers with colour-vision deficiencies.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#666666"

RC: dict[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.constrained_layout.use": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "phaselead",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw with our settings without changing the caller's."""
    with mpl.rc_context(RC):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that belongs to no window system."""
    return Figure(figsize=(width_in, height_in))


def thin(*columns: NDArray[np.float64], most: int = 3000) -> list[NDArray[np.float64]]:
    """Columns of equal length cut to at most ``most`` rows by taking every n-th.

    For drawing only. The signals drawn are smooth on the scale of a few samples except for their noise, so a regular
    selection shows the same band; figures that are *numbers* always use every row.
    """
    step = max(1, -(-len(columns[0]) // most))
    return [column[::step] for column in columns]


def to_svg(figure: Figure) -> str:
    """The figure as an ``<svg>`` element that scales to its container."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    return re.sub(
        r'(<svg[^>]*?) width="[^"]*"',
        r"\1",
        re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1),
        count=1,
    )


def save_png(figure: Figure, path: str | os.PathLike[str]) -> None:
    """The figure as a picture for a page that takes no SVG, whole or not at all."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110, metadata={"Software": None})
