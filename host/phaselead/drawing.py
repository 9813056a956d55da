"""The look of every figure, how one becomes part of a page, and the figures that show samples as they are."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

# Okabe & Ito's palette: told apart by readers with colour-vision deficiencies.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#666666"

SCALE = LinearSegmentedColormap.from_list("phaselead", [BLUE, GREEN, ORANGE])
"""Of many lines in their order: none is too dark or too light for a page of either ground."""

DPI = 110
MOST_NAMED = 8
"""Lines that a legend has room for."""

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


class NotebookFigure(Figure):
    """A figure that belongs to no window system and that a notebook shows all the same."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=DPI)
        return buffer.getvalue()


def new_figure(width_in: float, height_in: float) -> NotebookFigure:
    """An empty figure of this size in inches."""
    return NotebookFigure(figsize=(width_in, height_in))


def thin(*columns: NDArray[np.float64], most: int = 3000) -> list[NDArray[np.float64]]:
    """Columns of equal length cut to about ``most`` rows that keep every extreme, for drawing.

    The rows are parted evenly, and of each part those are kept where a column is lowest or highest: a spike of one
    sample is drawn, and noise as wide as it is. Figures that are *numbers* always use every row.
    """
    rows = len(columns[0])
    parts = max(1, most // (2 * len(columns)))
    if rows <= most:
        return list(columns)
    edges = np.linspace(0, rows, parts + 1).astype(int)[:-1]
    kept = {0, rows - 1}
    for column in columns:
        for start, part in zip(edges, np.split(column, edges[1:]), strict=True):
            kept |= {int(start + np.argmin(part)), int(start + np.argmax(part))}
    chosen = sorted(kept)
    return [column[chosen] for column in columns]


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


AXIS_COLOURS = {"x": BLUE, "y": ORANGE, "z": GREEN}


def samples_figure(columns: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Voltages and positions over time, position over voltage beside them; references dashed.

    ``columns`` are those of a recording, arrays of shape (n,), by the names of a CSV header.
    """
    t_s = columns["t_s"]
    with figure_style():
        figure = new_figure(9.4, 4.8)
        grid = figure.add_gridspec(2, 2, width_ratios=[1.7, 1])
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        loop = figure.add_subplot(grid[:, 1])
        for axis, colour in AXIS_COLOURS.items():
            u_V = columns.get(f"u{axis}_V", columns.get("u_V") if axis == "x" else None)
            r_um = columns.get(f"r{axis}_um", columns.get("r_um") if axis == "x" else None)
            x_um = columns.get(f"{axis}_um")
            if u_V is not None:
                upper.plot(*thin(t_s, u_V), color=colour, label=axis)
            if x_um is not None:
                lower.plot(*thin(t_s, x_um), color=colour, label=axis)
            if r_um is not None:
                told = "reference" in lower.get_legend_handles_labels()[1]
                lower.plot(*thin(t_s, r_um), color=GREY, linestyle="--", label=None if told else "reference")
            if u_V is not None and x_um is not None:
                loop.plot(*thin(u_V, x_um), color=colour, linewidth=0.9)
        upper.set(ylabel="voltage (V)")
        lower.set(xlabel="time (s)", ylabel="position (µm)")
        loop.set(xlabel="voltage (V)", ylabel="position (µm)")
        if lower.lines:
            lower.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4)
        return figure


class AxisSamples(Protocol):
    """One axis of a recording: arrays of shape (n,), None where there is none."""

    @property
    def u_V(self) -> NDArray[np.float64] | None: ...
    @property
    def x_um(self) -> NDArray[np.float64] | None: ...


def loops_figure(recordings: Sequence[tuple[str, Mapping[str, AxisSamples]]]) -> Figure:
    """Position over voltage, one panel for each axis that any of the named recordings has."""
    axes = [axis for axis in AXIS_COLOURS if any(axis in one for _, one in recordings)] or ["x"]
    with figure_style():
        figure = new_figure(4.7 * len(axes), 3.9)
        for panel, axis in zip(figure.subplots(1, len(axes), squeeze=False)[0], axes, strict=True):
            for i, (name, of_axes) in enumerate(recordings):
                record = of_axes.get(axis)
                if record is not None and record.u_V is not None and record.x_um is not None:
                    shade = SCALE(i / max(len(recordings) - 1, 1))
                    panel.plot(*thin(record.u_V, record.x_um), color=shade, linewidth=0.9, label=name)
            panel.set(xlabel=f"voltage of {axis} (V)", ylabel=f"position of {axis} (µm)")
            if 0 < len(panel.lines) <= MOST_NAMED:
                panel.legend()
        return figure
