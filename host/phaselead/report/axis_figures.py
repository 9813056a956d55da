"""What an identified stage does, all axes in one figure: frequency response, step, creep, noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter
from numpy.typing import NDArray
from scipy.signal import welch

from phaselead.drawing import AXIS_COLOURS, figure_style, new_figure, thin
from phaselead.identify import FitResult, noise_um_rms
from phaselead.model import TICK_S, AxisModel, simulate
from phaselead.record import Recording, Samples
from phaselead.waveforms import Goto

STEP_SHARE = 0.5
"""Of the voltages that the time view was fitted on: how far the step goes that is driven on the model."""
STEP_S, RESPONSE_S, HOLD_S = 0.06, 2.0, 12.0
MOVE_S = 0.2
"""Into the hold, so that the mode hardly rings; as the recorded one."""
SHOWN_HZ = (1.0, 1000.0)
LEAST_SPAN = 3.0
"""Of the gains shown, from the middle to either end."""
PHASES_DEG = (-400.0, -100.0)
"""Between which the lowest phase shown lies: below it only delays go on."""
CREEP_FROM_S = 0.3
"""After a step: before it the mode rings. Creep is counted from here."""
MOST_ROWS = 8192
"""Of one piece of a spectrum."""


def step_of(model: AxisModel, seconds: float, move_s: float = TICK_S) -> tuple[Samples, Samples, float]:
    """Times (n,) since a step begins that takes ``move_s``, without jerk; position (n,) in um of the model from rest;
    and the step in V."""
    assert model.time is not None
    t_s = np.arange(round(seconds / TICK_S) + 1, dtype=np.float64) * TICK_S
    step_V = STEP_SHARE * model.time.u_range_V[1]
    u_V = Goto(step_V, 0.0, "V", 1 / move_s).value(t_s)
    x_um = simulate(model, t_s, u_V)
    return t_s, x_um - x_um[0], step_V


def response_of(model: AxisModel) -> tuple[Samples, NDArray[np.complex128]]:
    """Frequencies (m,) in Hz and the complex response (m,) in um/V that the model's step has."""
    t_s, x_um, step_V = step_of(model, RESPONSE_S)
    response = np.fft.rfft(np.diff(x_um, append=x_um[-1])) / step_V
    f_Hz = np.asarray(np.fft.rfftfreq(len(t_s), TICK_S), np.float64)
    shown = (f_Hz >= SHOWN_HZ[0]) & (f_Hz <= SHOWN_HZ[1])
    return f_Hz[shown], response[shown]


def bode_figure(result: FitResult) -> Figure:
    """Gain and phase of the models, and of every sine of the table view."""
    with figure_style():
        figure = new_figure(9.4, 5.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        for axis, model in timed(result).items():
            f_Hz, response = response_of(model)
            upper.loglog(f_Hz, np.abs(response), color=AXIS_COLOURS[axis], label=axis)
            lower.semilogx(f_Hz, np.rad2deg(np.unwrap(np.angle(response))), color=AXIS_COLOURS[axis])
            if model.table is not None:
                at_Hz = [p.f_Hz for p in model.table.points]
                look = {"color": AXIS_COLOURS[axis], "linestyle": "", "marker": ".", "markersize": 4, "alpha": 0.6}
                upper.plot(at_Hz, [p.gain_um_per_V for p in model.table.points], label=f"{axis}, sines", **look)
                lower.plot(at_Hz, [-p.phase_deg for p in model.table.points], **look)
        upper.set(ylabel="gain (µm/V)")
        low, high = upper.get_ylim()
        middle = np.sqrt(low * high)
        upper.set_ylim(min(low, middle / LEAST_SPAN), max(high, middle * LEAST_SPAN))
        plain = StrMethodFormatter("{x:g}")
        upper.yaxis.set_major_formatter(plain)
        upper.yaxis.set_minor_formatter(plain)
        upper.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        lowest = min(float(np.min(np.asarray(line.get_ydata()))) for line in lower.get_lines())
        lower.set(xlabel="frequency (Hz)", ylabel="phase (deg)", ylim=(np.clip(1.1 * lowest, *PHASES_DEG), 30))
        upper.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=6)
        return figure


def step_figure(result: FitResult) -> Figure:
    """The models after a step from rest."""
    with figure_style():
        figure = new_figure(9.4, 3.6)
        panel = figure.add_subplot()
        for axis, model in timed(result).items():
            t_s, x_um, step_V = step_of(model, STEP_S)
            panel.plot(1e3 * t_s, x_um, color=AXIS_COLOURS[axis], label=f"{axis}, 0 to {step_V:.3g} V")
        panel.set(xlabel="time since the step (ms)", ylabel="position (µm)")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3)
        return figure


def crept_pct(t_s: Samples, x_um: Samples) -> tuple[Samples, Samples]:
    """Times since ``CREEP_FROM_S`` of a hold on, and how far the position has gone on by then, in per cent."""
    rows = t_s >= CREEP_FROM_S
    begin_um = float(np.mean(x_um[rows][:10]))
    return t_s[rows], 100 * (x_um[rows] - begin_um) / begin_um


def creep_figure(result: FitResult) -> Figure | None:
    """How far a held axis goes on: measured where a hold was recorded, and by the models; None where neither is."""
    models = {
        axis: model for axis, model in timed(result).items() if any(effect.name == "creep" for effect in model.effects)
    }
    if not models and not result.holds:
        return None
    with figure_style():
        figure = new_figure(9.4, 3.6)
        panel = figure.add_subplot()
        for axis, held in result.holds.items():
            panel.plot(*_measured(held, axis), color=AXIS_COLOURS[axis], alpha=0.35, label=f"{axis}, measured")
        for axis, model in models.items():
            t_s, x_um, _ = step_of(model, HOLD_S, MOVE_S)
            panel.plot(*thin(*crept_pct(t_s - MOVE_S, x_um)), color=AXIS_COLOURS[axis], label=f"{axis}, model")
        panel.set(xscale="log", xlabel="time since the step (s)", ylabel="gone on (% of the step)")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=6)
        return figure


def _measured(held: Recording, axis: str) -> list[Samples]:
    one = held.axes[axis]
    assert one.u_V is not None
    assert one.x_um is not None
    there = int(np.argmax(one.u_V >= one.u_V.max()))
    return thin(*crept_pct(held.t_s - held.t_s[there], one.x_um - one.x_um[0]))


def noise_figure(result: FitResult) -> Figure | None:
    """Spectrum of what the model leaves of the quietest record of each axis, and the white noise of its sensor; None
    without records."""
    quietest = {axis: record for axis in timed(result) if (record := _quietest(result, axis)) is not None}
    if not quietest:
        return None
    with figure_style():
        figure = new_figure(9.4, 3.6)
        panel = figure.add_subplot()
        for axis, record in quietest.items():
            measured_um, model_um = record.axes[axis].x_um, result.predicted_um(record, axis)
            assert measured_um is not None
            left_um = (measured_um - model_um)[record.scored]
            f_Hz, power = welch(left_um, record.rate_Hz, nperseg=min(MOST_ROWS, len(left_um)))
            white_um = noise_um_rms(record, axis) or 0.0
            floor_nm = 1e3 * white_um * np.sqrt(2 / record.rate_Hz)
            panel.loglog(*thin(f_Hz[1:], 1e3 * np.sqrt(power[1:])), color=AXIS_COLOURS[axis], linewidth=0.9, label=axis)
            panel.axhline(
                floor_nm, color=AXIS_COLOURS[axis], linestyle="--", label=f"{axis}, sensor: {1e3 * white_um:.3g} nm rms"
            )
        panel.set(xlabel="frequency (Hz)", ylabel="what is left (nm/√Hz)")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=6)
        return figure


def _quietest(result: FitResult, axis: str) -> Recording | None:
    known = {record.source: record for record in result.records}
    left = [(one.rms_um, one.source) for one in result.report.time[axis].records if one.source in known]
    return known[min(left)[1]] if left else None


def timed(result: FitResult) -> Mapping[str, AxisModel]:
    """The axes that have a time view."""
    return {axis: model for axis, model in result.axes.items() if model.time is not None}
