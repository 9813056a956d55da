"""The small figures of the catalogue's page: grey without the effect, blue with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phaselead.drawing import BLUE, GREY, figure_style, new_figure, thin
from phaselead.model import AdoptedEffect, AxisModel, Effect, Params, TimeView, effect_of_modes, simulate
from phaselead.record import Samples

RATE_HZ = 5000.0
LINEAR = TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=RATE_HZ)
PLAYS = LINEAR.model_copy(
    update={"gain_um_per_V": 5.5, "play_r_V": (0.3, 0.8, 1.6), "play_w_um_per_V": (1.5, 1.5, 1.5)}
)
BASES: dict[str, Callable[[], AxisModel]] = {
    "linear": lambda: AxisModel(time=LINEAR),
    "plays": lambda: AxisModel(time=PLAYS),
    "mode": lambda: AxisModel(time=LINEAR, effects=(_mode(),)),
}


def _mode() -> AdoptedEffect:
    """A single mode."""
    effect, params = effect_of_modes([(1.0, 200.0, 0.02)])
    return AdoptedEffect(name=effect.name, params=params)


def draw(effect: Effect) -> Figure:
    """The figure of one effect, 5 by 2.4 inches."""
    with figure_style():
        figure = new_figure(5.0, 2.4)
        _VIEWS[effect.picture.view](figure, effect)
        return figure


def _run(effect: Effect, t: Samples, u: Samples, with_it: bool, neighbour: Samples | None = None) -> Samples:
    extra: list[tuple[Effect, Params]] = [(effect, effect.picture.params)] if with_it else []
    others = {} if neighbour is None else {"y": neighbour}
    return simulate(BASES[effect.picture.base](), t, u, others_um=others, extra=extra, rng=np.random.default_rng(0))


def _both(axes: Axes, effect: Effect, t: Samples, u: Samples, over: Samples, last: int | None = None) -> None:
    """Position without and with the effect, over ``over``; the last rows only, if asked."""
    rows = slice(None if last is None else len(u) - last, None)
    for with_it, colour in ((False, GREY), (True, BLUE)):
        axes.plot(*thin(over[rows], _run(effect, t, u, with_it)[rows], most=400), color=colour)


def _times(seconds: float, rate_Hz: float = RATE_HZ) -> Samples:
    return np.arange(round(seconds * rate_Hz)) / rate_Hz


def _sine(t: Samples, f_Hz: float, swing: float = 10.0) -> Samples:
    return swing / 2 * (1 - np.cos(2 * np.pi * f_Hz * t))


def _loop(figure: Figure, effect: Effect) -> None:
    """A triangle that decays."""
    corners = np.array([0, 10, 0, 10, 1.5, 8.5, 3, 7, 4.2, 5.8])
    t = _times(0.36, 5000)
    u = np.interp(t, np.arange(len(corners)) * 0.04, corners)
    axes = figure.add_subplot()
    _both(axes, effect, t, u, u)
    axes.set(xlabel="voltage (V)", ylabel="position (µm)")


def _loops(figure: Figure, effect: Effect) -> None:
    """One full loop, slow and fast."""
    for axes, f_Hz in zip(figure.subplots(1, 2, sharey=True), (0.1, 100.0), strict=True):
        t = _times(2 / f_Hz, 400 * f_Hz)
        u = _sine(t, f_Hz)
        _both(axes, effect, t, u, u, last=400)
        axes.set(xlabel="voltage (V)", title=f"{f_Hz:g} Hz")
    figure.axes[0].set_ylabel("position (µm)")


def _response(figure: Figure, effect: Effect) -> None:
    """Gain and phase at a small level, by the answer to a small jump."""
    n = 20_000
    t = np.arange(n) / RATE_HZ
    u = np.where(np.arange(n) < 10, 0.0, 0.1)
    gain, phase = figure.subplots(1, 2)
    for with_it, colour in ((False, GREY), (True, BLUE)):
        x = _run(effect, t, u, with_it)
        h = np.fft.rfft(np.diff(x)) / np.fft.rfft(np.diff(u))
        f = np.fft.rfftfreq(n - 1, 1 / RATE_HZ)
        shown = np.unique(np.searchsorted(f, np.geomspace(5, 1000, 250)))
        gain.loglog(f[shown], np.abs(h[shown]), color=colour)
        phase.semilogx(f[shown], np.degrees(np.unwrap(np.angle(h[shown]))), color=colour)
    low, high = gain.get_ylim()
    gain.set(xlabel="frequency (Hz)", ylabel="gain (µm/V)", ylim=(min(low, 0.9), max(high, 20.0)))
    phase.set(xlabel="frequency (Hz)", ylabel="phase (°)")


def _level(figure: Figure, effect: Effect) -> None:
    """Gain of a sine against its level."""
    t = _times(4.0, 1000)
    wave = np.sin(2 * np.pi * 20 * t)
    swings = np.geomspace(0.05, 10, 12)
    axes = figure.add_subplot()
    for with_it, colour in ((False, GREY), (True, BLUE)):
        tops = [np.ptp(_run(effect, t, s / 2 * wave, with_it)[-1000:]) / s for s in swings]
        axes.semilogx(swings, tops, "o-", markersize=3, color=colour)
    axes.set(xlabel="voltage, peak to peak (V)", ylabel="gain (µm/V)")


def _sines(figure: Figure, effect: Effect) -> None:
    """Two periods over the whole range."""
    t = _times(0.1)
    axes = figure.add_subplot()
    _both(axes, effect, t, _sine(t, 20.0), 1e3 * t)
    axes.set(xlabel="time (ms)", ylabel="position (µm)")


def _holds(figure: Figure, effect: Effect) -> None:
    """Holds at levels of both signs."""
    t = _times(60.0, 20)
    u = np.select([t < 5, t < 25, t < 45], [0.0, 5.0, -5.0], 0.0)
    axes = figure.add_subplot()
    _both(axes, effect, t, u, t)
    axes.set(xlabel="time (s)", ylabel="position (µm)")


def _steps(figure: Figure, effect: Effect) -> None:
    """Steps up and down in the logarithm of time."""
    rate_Hz = 500.0
    t = _times(100.0, rate_Hz)
    axes = figure.add_subplot()
    for sign, style in ((1, "-"), (-1, "--")):
        for with_it, colour in ((False, GREY), (True, BLUE)):
            x = np.abs(_run(effect, t, np.full(len(t), 5.0 * sign), with_it))
            shown = np.unique(np.geomspace(1, len(t) - 1, 200).astype(int))
            axes.semilogx(t[shown], x[shown], style, color=colour)
    axes.set(xlabel="time since the step (s)", ylabel="distance (µm)")


def _idle(figure: Figure, effect: Effect) -> None:
    """Nothing driven for minutes."""
    t = _times(600.0, 1)
    axes = figure.add_subplot()
    _both(axes, effect, t, 0 * t, t)
    axes.set(xlabel="time (s)", ylabel="position (µm)")


def _line(figure: Figure, effect: Effect) -> None:
    """Nothing driven: what it looks like, and its spectrum."""
    t = _times(8.0, 1000)
    x = 1e3 * _run(effect, t, 0 * t, True)
    signal, spectrum = figure.subplots(1, 2)
    signal.plot(1e3 * t[:200], 0 * t[:200], color=GREY)
    signal.plot(1e3 * t[:200], x[:200], color=BLUE)
    signal.set(xlabel="time (ms)", ylabel="position (nm)")
    power = np.mean(np.abs(np.fft.rfft(x.reshape(16, 500), axis=1)) ** 2, axis=0) * 2 / 500 / 1000
    spectrum.semilogy(np.fft.rfftfreq(500, 1e-3)[1:], np.sqrt(np.maximum(power[1:], 1e-6)), color=BLUE)
    spectrum.set(xlabel="frequency (Hz)", ylabel="nm/√Hz")


def _ramp(figure: Figure, effect: Effect) -> None:
    """A ramp of nanometres per second."""
    t = _times(1.0, 400)
    u = 0.005 * t
    axes = figure.add_subplot()
    for with_it, colour in ((False, GREY), (True, BLUE)):
        axes.plot(t, 1e3 * _run(effect, t, u, with_it), color=colour, drawstyle="steps-post")
    axes.set(xlabel="time (s)", ylabel="position (nm)")


def _neighbour(figure: Figure, effect: Effect) -> None:
    """Nothing driven here while y moves by 100 um."""
    t = _times(1.0, 400)
    moved = np.where(t < 0.2, 0, 10 * _sine(t - 0.2, 5.0))
    axes = figure.add_subplot()
    for with_it, colour in ((False, GREY), (True, BLUE)):
        axes.plot(t, _run(effect, t, 0 * t, with_it, neighbour=moved), color=colour)
    axes.set(xlabel="time (s)", ylabel="position (µm)")


def _difference(figure: Figure, effect: Effect) -> None:
    """With less without over a full slow loop, against voltage and against position."""
    t = _times(1.0, 1600)
    u = _sine(t, 2.0)
    without = _run(effect, t, u, False)
    error = 1e3 * (_run(effect, t, u, True) - without)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, over, label in zip(panels, (u, without), ("voltage (V)", "position (µm)"), strict=True):
        axes.plot(over[-800:], 0 * over[-800:], color=GREY)
        axes.plot(*thin(over[-800:], error[-800:], most=400), color=BLUE)
        axes.set(xlabel=label)
    figure.axes[0].set_ylabel("difference (nm)")


_VIEWS: dict[str, Callable[[Figure, Effect], None]] = {
    "loop": _loop,
    "loops": _loops,
    "response": _response,
    "level": _level,
    "sine": _sines,
    "holds": _holds,
    "steps": _steps,
    "idle": _idle,
    "line": _line,
    "ramp": _ramp,
    "neighbour": _neighbour,
    "difference": _difference,
}

CAPTIONS: dict[str, str] = {
    "loop": "position over voltage under a decaying triangle",
    "loops": "one full loop, at 0.1 Hz and at 100 Hz",
    "response": "gain and phase at a small level",
    "level": "gain of a 20 Hz sine against its level",
    "sine": "a full sine at 20 Hz",
    "holds": "holds at 5 V and at -5 V",
    "steps": "steps of 5 V up (solid) and down (dashed)",
    "idle": "nothing driven for ten minutes",
    "line": "nothing driven: signal and spectrum",
    "ramp": "a ramp of 50 nm/s",
    "neighbour": "nothing driven here while y moves by 100 µm",
    "difference": "with less without, over a full slow loop",
}
