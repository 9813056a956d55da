"""Figures of a fit and of a verification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from phaselead.drawing import BLUE, GREY, RED, figure_style, new_figure, thin
from phaselead.record import Samples


def error_bars(labels: Sequence[str], max_pct: Sequence[float], mean_pct: Sequence[float]) -> Figure:
    """Largest and mean errors as bars, one pair for each label, the first on top."""
    at = np.arange(len(labels))[::-1]
    with figure_style():
        figure = new_figure(9.4, 1.4 + 0.4 * len(labels))
        axes = figure.add_subplot()
        axes.barh(at + 0.18, list(max_pct), height=0.36, color=RED, label="largest error")
        axes.barh(at - 0.18, list(mean_pct), height=0.36, color=BLUE, label="mean error")
        axes.set_yticks(at, list(labels))
        axes.set_xlabel("error (% of range)")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure


def against_model(name: str, t_s: Samples, measured_um: Samples, model_um: Samples) -> Figure:
    """Measurement and model above, what the model leaves below. Arrays of shape (n,)."""
    t, measured, model, left = thin(t_s, measured_um, model_um, measured_um - model_um)
    with figure_style():
        figure = new_figure(9.4, 4.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1])
        upper.plot(t, measured, color=GREY, linewidth=2.4, alpha=0.6, label="measured")
        upper.plot(t, model, color=BLUE, linewidth=1.0, label="model")
        lower.plot(t, left, color=BLUE, linewidth=0.9)
        upper.set_title(name, loc="right", fontsize=10)
        upper.set(ylabel="position (µm)")
        lower.set(xlabel="time (s)", ylabel="measured − model (µm)")
        upper.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure
