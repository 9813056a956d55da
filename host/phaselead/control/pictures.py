"""The figures of a tracking run and of a loop."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from phaselead.drawing import AXIS_COLOURS, GREY, figure_style, new_figure, thin
from phaselead.record import Recording, Samples

Response = NDArray[np.complex128]


def tracking_figure(recording: Recording) -> Figure:
    """Reference and position above, error = reference - position below; axes without a reference are left out."""
    with figure_style():
        figure = new_figure(9.4, 4.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.2, 1])
        for axis, record in recording.axes.items():
            if record.r_um is None or record.x_um is None:
                continue
            t, r, x, error = thin(recording.t_s, record.r_um, record.x_um, record.r_um - record.x_um)
            upper.plot(t, r, color=GREY, linewidth=2.4, alpha=0.6, label=f"{axis}, reference")
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
            for gain, row in zip(gain_um_per_V, np.abs(values), strict=True):
                axes.loglog(f_Hz, row, linewidth=1.0, label=f"{gain:.3g} µm/V")
            axes.axhline(1.0, color=GREY, linewidth=0.8)
            axes.set(title=name, xlabel="frequency (Hz)")
        axes.legend()
        return figure
