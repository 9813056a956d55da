"""The figures of a tracking run, of a loop and of what was learned."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from phaselead.drawing import AXIS_COLOURS, GREY, SCALE, figure_style, new_figure, thin
from phaselead.record import Recording, Samples

Response = NDArray[np.complex128]


def tracking_figure(recording: Recording, meant_um: Mapping[str, Samples]) -> Figure:
    """The path that each axis is judged by, shape (n,), and its position above, the error below; other axes are left
    out."""
    with figure_style():
        figure = new_figure(9.4, 4.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.2, 1])
        for axis, record in recording.axes.items():
            if axis not in meant_um or record.x_um is None:
                continue
            t, r, x, error = thin(recording.t_s, meant_um[axis], record.x_um, meant_um[axis] - record.x_um)
            upper.plot(t, r, color=GREY, linewidth=2.4, alpha=0.6, label=None if upper.lines else "reference")
            upper.plot(t, x, color=AXIS_COLOURS[axis], linewidth=1.0, label=f"{axis}, measured")
            lower.plot(t, error, color=AXIS_COLOURS[axis], linewidth=0.9)
        upper.set(ylabel="position (µm)")
        lower.set(xlabel="time (s)", ylabel="reference − measured (µm)")
        if upper.lines:
            upper.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=6)
        return figure


def loop_figure(
    f_Hz: Samples, gain_um_per_V: Samples, open_loop: Response, sensitivity: Response, complementary: Response
) -> Figure:
    """Magnitudes of L, S and T, each (k, m), at the local gains (k,), against frequency (m,)."""
    with figure_style():
        figure = new_figure(9.4, 3.2)
        parts = (("|L|", open_loop), ("|S|", sensitivity), ("|T|", complementary))
        for axes, (name, values) in zip(figure.subplots(1, 3, sharex=True), parts, strict=True):
            for i, (gain, row) in enumerate(zip(gain_um_per_V, np.abs(values), strict=True)):
                colour = SCALE(i / max(len(gain_um_per_V) - 1, 1))
                axes.loglog(f_Hz, row, color=colour, linewidth=1.0, label=f"{gain:.3g} µm/V")
            axes.axhline(1.0, color=GREY, linewidth=0.8)
            axes.set(title=name, xlabel="frequency (Hz)", ylabel="magnitude (1)")
        axes.legend()
        return figure


def learning_figure(
    errors_pct: Mapping[str, Mapping[str, Samples]], kept: int, added_um: Mapping[str, Samples]
) -> Figure:
    """By axis: named errors (k,) against trial, of which ``kept`` is marked, and what is added to one period (n,)."""
    with figure_style():
        figure = new_figure(9.4, 4.2)
        errors, added = figure.subplots(1, 2)
        for axis, named in errors_pct.items():
            for (name, values), style in zip(named.items(), ("o-", "s--", "^:"), strict=False):
                errors.semilogy(values, style, color=AXIS_COLOURS[axis], label=f"{axis}, {name}")
        for axis, values in added_um.items():
            turns = np.arange(len(values)) / len(values)
            added.plot(turns, 1000 * values, color=AXIS_COLOURS[axis], linewidth=1.0)
        errors.axvline(kept, color=GREY, linewidth=0.8)
        errors.set(xlabel="trial (number)", ylabel="error (% of the swing)")
        errors.xaxis.set_major_locator(MaxNLocator(integer=True))
        errors.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        added.set(xlabel="time (periods)", ylabel="played − asked (nm)")
        return figure
