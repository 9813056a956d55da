"""The figure of a gap result."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from phaselead.drawing import BLUE, GREEN, GREY, RED, figure_style, new_figure, thin
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import Cell, Trace

MOST_DRAWN = 8
"""That have room in the figure."""


def gap_figure(traces: Sequence[Trace], cells: Sequence[Cell]) -> Figure:
    """Left: what is left of the held-out record with the largest gap, before and after. Right: the largest cells."""
    with figure_style():
        figure = new_figure(11.4, 4.0)
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1])
        if traces:
            _trace(left, max(traces, key=lambda trace: float(np.std(trace.measured_um - trace.before_um))))
        shown = list(reversed(cells[:MOST_DRAWN]))
        colours = [GREEN if cell.p <= ERROR_RATE else GREY for cell in shown]
        right.barh(range(len(shown)), [100 * cell.share for cell in shown], color=colours)
        right.set_yticks(range(len(shown)), [f"{cell.by}: {cell.cell}" for cell in shown])
        right.set(xlabel="share of the unexplained power (%)", xlim=(0, 100))
        keys = [Patch(color=GREEN, label="stands out"), Patch(color=GREY, label="may be chance")]
        right.legend(handles=keys, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure


def _trace(axes: Axes, trace: Trace) -> None:
    t, before, after = thin(trace.t_s, trace.measured_um - trace.before_um, trace.measured_um - trace.after_um)
    axes.plot(t, before, color=RED, linewidth=0.9, label="before")
    axes.plot(t, after, color=BLUE, linewidth=0.9, label="after")
    axes.set_title(f"{trace.source} ({trace.axis})", loc="right", fontsize=10)
    axes.set(xlabel="time (s)", ylabel="measured − model (µm)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
