"""The paper's figures 2, 3, 4, 5 and 7, drawn from a run's own data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from phaselead.drawing import AXIS_COLOURS, BLUE, GREY, ORANGE, PURPLE, RED, SCALE, figure_style, new_figure, thin
from phaselead.model import TableView
from phaselead.record import Samples

MODE_COLOURS = {"pid": RED, "ff": ORANGE, "ff+pid": BLUE}
MODE_NAMES = {"pid": "PID", "ff": "FF", "ff+pid": "FF + PID"}


def loops_of_axes(u_V: Samples, positions_um: Mapping[str, Samples], driven: str) -> Figure:
    """Fig. 2(a): positions of all axes against the voltage of the one that is driven. Arrays of shape (n,)."""
    with figure_style():
        figure = new_figure(5.2, 3.9)
        axes = figure.add_subplot()
        for name, x_um in positions_um.items():
            u_thin, x_thin = thin(u_V, x_um)
            axes.plot(
                u_thin,
                x_thin,
                color=AXIS_COLOURS[name],
                label=f"{name}{' (driven)' if name == driven else ''}",
            )
        axes.set(xlabel=f"voltage of {driven} (V)", ylabel="position (µm)")
        axes.legend()
        return figure


@dataclass(frozen=True)
class Loop:
    """One steady period of a loop."""

    f_Hz: float
    u_V: Samples
    x_um: Samples


def loops_of_frequencies(loops: Sequence[Loop]) -> Figure:
    """Fig. 2(b): the loop at one level, against frequency; the right-hand panel shows its width alone."""
    with figure_style():
        figure = new_figure(9.4, 3.9)
        whole, width = figure.subplots(1, 2)
        for loop, shade in zip(loops, np.linspace(0.0, 1.0, len(loops)), strict=True):
            u_thin, x_thin = thin(loop.u_V, loop.x_um, most=1500)
            colour = SCALE(shade)
            slope, intercept = np.polyfit(loop.u_V, loop.x_um, 1)
            whole.plot(u_thin, x_thin, color=colour, label=f"{loop.f_Hz:g} Hz")
            width.plot(u_thin, x_thin - slope * u_thin - intercept, color=colour)
        whole.set(xlabel="voltage (V)", ylabel="position (µm)")
        width.set(xlabel="voltage (V)", ylabel="position − straight line (µm)")
        whole.legend()
        return figure


def surfaces(view: TableView) -> Figure:
    """Fig. 3: K, theta and x0 over the rectangle, with the measured points."""
    swing_V = np.linspace(*view.swing_V, 30)
    f_Hz = np.linspace(*view.f_Hz, 30)
    swing_grid, f_grid = np.meshgrid(swing_V, f_Hz)
    panels = [
        ("gain K (µm/V)", view.gain(swing_grid), [p.gain_um_per_V for p in view.points]),
        ("phase lag θ (deg)", view.phase_deg(swing_grid, f_grid), [p.phase_deg for p in view.points]),
        ("residual position x₀ (µm)", view.x0(swing_grid, f_grid), [p.x0_um for p in view.points]),
    ]
    with figure_style():
        figure = new_figure(12.6, 4.6)
        for column, (label, surface, measured) in enumerate(panels, start=1):
            axes = figure.add_subplot(1, 3, column, projection="3d")
            axes.plot_wireframe(swing_grid, f_grid, surface, color=BLUE, linewidth=0.5, rstride=3, cstride=3)
            axes.scatter(
                [p.swing_V for p in view.points],
                [p.f_Hz for p in view.points],
                measured,
                color=RED,
                s=9,
                depthshade=False,
            )
            axes.set(xlabel="swing $u_m$ (V)", ylabel="frequency (Hz)")
            axes.set_title(label, y=0.97)
            axes.set_yticks([1, 5, 10, 15, 20] if view.f_Hz == (1.0, 20.0) else np.linspace(*view.f_Hz, 4))
            axes.view_init(elev=24, azim=-128)
            for side in (axes.xaxis, axes.yaxis, axes.zaxis):
                side.set_pane_color((1.0, 1.0, 1.0, 0.0))
        return figure


def verification(t_s: Samples, measured_um: Samples, models_um: Mapping[str, Samples]) -> Figure:
    """Figs. 4 and 5: model against measurement, the error below. Arrays of shape (n,)."""
    colours = [RED, BLUE]
    with figure_style():
        figure = new_figure(9.4, 4.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1])
        upper.plot(*thin(t_s, measured_um), color=GREY, linewidth=2.4, alpha=0.6, label="measured")
        for (label, model_um), colour in zip(models_um.items(), colours, strict=False):
            t_thin, m_thin, e_thin = thin(t_s, model_um, measured_um - model_um)
            upper.plot(t_thin, m_thin, color=colour, linewidth=1.0, label=label)
            lower.plot(t_thin, e_thin, color=colour, linewidth=0.9, label=label)
        upper.set(ylabel="position (µm)")
        lower.set(xlabel="time (s)", ylabel="error (µm)")
        upper.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3)
        return figure


@dataclass(frozen=True)
class TrackedRun:
    """One controller's run: arrays of shape (n,)."""

    t_s: Samples
    r_um: Samples
    x_um: Samples
    feedforward_V: Samples
    feedback_V: Samples


def tracking(runs: Mapping[str, TrackedRun]) -> Figure:
    """Fig. 7: (a) reference, (b) errors by controller, (c) actual against desired, (d) effort split into FF and FB."""
    with figure_style():
        figure = new_figure(11.4, 7.2)
        (reference, error), (actual, effort) = figure.subplots(2, 2)
        for mode, run in runs.items():
            error.plot(
                *thin(run.t_s, run.r_um - run.x_um), color=MODE_COLOURS[mode], label=MODE_NAMES[mode], linewidth=1.0
            )
        best = runs["ff+pid"]
        t_thin, ff_thin, fb_thin = thin(best.t_s, best.feedforward_V, best.feedback_V)
        reference.plot(*thin(best.t_s, best.r_um), color=GREY)
        last = best.t_s > best.t_s[-1] - 0.4
        r_last, x_last = thin(best.r_um[last], best.x_um[last])
        actual.plot(r_last, x_last, color=BLUE)
        effort.plot(t_thin, ff_thin, color=ORANGE, label="feed-forward")
        effort.plot(t_thin, fb_thin, color=PURPLE, label="feedback", linewidth=1.0)
        reference.set(title="(a) reference", xlabel="time (s)", ylabel="position (µm)")
        error.set(title="(b) tracking error", xlabel="time (s)", ylabel="error (µm)")
        actual.set(title="(c) FF + PID, last two periods", xlabel="desired (µm)", ylabel="actual (µm)")
        effort.set(title="(d) control effort of FF + PID", xlabel="time (s)", ylabel="voltage (V)")
        error.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
        effort.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
        return figure
