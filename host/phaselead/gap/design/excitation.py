"""Excitations that may tell rival effects apart, as the device can play them: one period of 1024 points, repeated.

Most have a shape of ``SHAPES``. One that repeats the waveform of a record carries its points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.residual import ModelledRun
from phaselead.model import AxisModel
from phaselead.record import Samples
from phaselead.waveforms import POINTS, Sampled, refuse_out_of_range

LINES = 60
"""Of a multisine."""
FEWEST_POINTS = 5
"""Points of a waveform on one cycle of its highest line."""
DECIMALS = 5
"""Of a point of a repeated waveform: finer than any converter."""
LEAST_LEVEL = 0.02
"""Of the voltage range: a weaker drive is not worth its time."""
LENGTHS_s = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0)
"""That an experiment may take."""
RECORD = "record"
"""Name of the waveform that repeats a record."""
NEARLY_ALL = 0.95
"""Share of the fitted voltages from which on nothing is said of the limits in the stage file: records are rarely driven
to the very volt of a limit. It decides no verdict."""


@dataclass(frozen=True)
class Excitation:
    """A waveform between ``bias_V - level_V / 2`` and ``bias_V + level_V / 2`` whose period is 1 / band_Hz[0]."""

    waveform: str
    level_V: float
    band_Hz: tuple[float, float]
    bias_V: float
    seconds: float
    source: str | None = None
    """File of the record whose waveform it repeats."""
    points: tuple[float, ...] | None = None
    """One period of that waveform, (POINTS,) as shares of the level."""

    @property
    def idle(self) -> bool:
        """Whether the stage is only listened to."""
        return self.waveform == "idle"

    @property
    def driven_Hz(self) -> tuple[float, float]:
        """Lowest and highest frequency that it drives: of a repeated record up to the last of its harmonics that its
        points can hold."""
        low, high = self.band_Hz
        if self.waveform == RECORD and self.points is not None:
            lines = np.abs(np.fft.rfft(self.points)) * 2 / len(self.points)
            high = low * float(np.flatnonzero(lines > 10.0**-DECIMALS).max(initial=1))
        return low, high

    def wave(self) -> Sampled:
        """As the device plays it, in volts. It goes to its first value at the slew limit."""
        points = np.array(self.points) if self.waveform == RECORD else SHAPES[self.waveform](self.band_Hz)
        lowest, span = float(points.min()), float(np.ptp(points))
        offset_V = self.bias_V + self.level_V * (lowest - 0.5)
        return Sampled(self.level_V * span, offset_V, "V", self.band_Hz[0], (points - lowest) / span)

    def voltage(self, t_s: Samples) -> Samples:
        """(n,) in V at times (n,) in s from the start."""
        return np.zeros(len(t_s)) if self.idle else self.wave().value(t_s)

    def within(self, axis: AxisModel) -> Excitation | None:
        """The same at the largest level that the slew limit allows, None where that is below LEAST_LEVEL.

        Raises BadInput where the waveform leaves the voltages of the axis.
        """
        if self.idle:
            return self
        slew = axis.limits.slew_V_per_s
        fitting = replace(self, level_V=self.level_V * min(1.0, 0.98 * slew / self.wave().steepest()))
        low, high = span_V(axis)
        if fitting.level_V < LEAST_LEVEL * (high - low):
            return None
        refuse_out_of_range(fitting.wave(), axis)
        return fitting


def _turns() -> Samples:
    """(POINTS,) share of the period that has passed."""
    return np.arange(POINTS) / POINTS


def _multisine(band_Hz: tuple[float, float]) -> Samples:
    """Lines spread evenly in the logarithm, amplitudes falling as 1/sqrt(f), phases of Schroeder (1970)."""
    highest = min(band_Hz[1] / band_Hz[0], POINTS / FEWEST_POINTS)
    orders = np.unique(np.round(np.geomspace(1, highest, LINES)))
    phases = np.pi * np.arange(len(orders)) ** 2 / len(orders)
    wave = np.zeros(POINTS)
    for order, phase in zip(orders, phases, strict=True):
        wave += np.cos(2 * np.pi * order * _turns() + phase) / np.sqrt(order)
    return np.asarray(0.5 + 0.5 * wave / np.abs(wave).max())


def _sine(band_Hz: tuple[float, float]) -> Samples:
    return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * _turns()))


def _triangle(band_Hz: tuple[float, float]) -> Samples:
    """Five loops, each four fifths of the size of the one before."""
    corners, size = [0.5], 0.5
    for _ in range(5):
        corners += [0.5 + size, 0.5 - size]
        size *= 0.8
    return np.interp(_turns(), np.linspace(0, 1, len(corners) + 1), [*corners, 0.5])


def _steps(band_Hz: tuple[float, float]) -> Samples:
    """Four steps of different size, up and down, each held for a fifth of the period."""
    levels = np.array([0.0, 1.0, 0.25, 0.75, 0.0])
    return np.asarray(levels[np.minimum((_turns() * len(levels)).astype(int), len(levels) - 1)])


def _ladder(band_Hz: tuple[float, float]) -> Samples:
    """Small loops of one size at eight biases, four cycles at each."""
    rungs, loops, share = 8, 4, 0.12
    at = _turns() * rungs
    bias = share / 2 + (1 - share) * np.floor(at) / (rungs - 1)
    loop = (at % 1.0) * loops % 1.0
    return np.asarray(bias - share / 2 * np.cos(2 * np.pi * loop))


def _swell(band_Hz: tuple[float, float]) -> Samples:
    """A sine that grows from nothing to the whole level and shrinks again."""
    cycles = max(2.0, np.round(band_Hz[1] / band_Hz[0]))
    size = 1 - np.abs(2 * _turns() - 1)
    return np.asarray(0.5 + 0.5 * size * np.sin(2 * np.pi * cycles * _turns()))


SHAPES: dict[str, Callable[[tuple[float, float]], Samples]] = {
    "multisine": _multisine,
    "sine": _sine,
    "triangle": _triangle,
    "steps": _steps,
    "ladder": _ladder,
    "swell": _swell,
}
"""By waveform: one period (POINTS,) as shares of the level, from the band in Hz. ``idle`` has none."""


def span_V(axis: AxisModel) -> tuple[float, float]:
    """Lowest and highest voltage that the model was fitted on and the device may put out; the lowest is above the
    highest where it may put out none of them."""
    assert axis.time is not None
    low, high = axis.time.u_range_V
    return max(low, axis.limits.u_min_V), min(high, axis.limits.u_max_V)


def about_limits(axis: AxisModel) -> list[str]:
    """One line where the device may put out clearly less than the voltages that the model was fitted on."""
    assert axis.time is not None
    (low, high), (lowest, highest) = span_V(axis), axis.time.u_range_V
    share = max(high - low, 0.0) / (highest - lowest)
    if share > NEARLY_ALL:
        return []
    at = f"{axis.limits.u_min_V:.3g} to {axis.limits.u_max_V:.3g} V"
    return [
        f"experiments keep within the stage file's limits, {at}, {100 * share:.0f} % of the voltages that the model "
        "was fitted on; if the device may put out more, set them to that, and run gap again"
    ]


def excitations(axis: AxisModel, step_s: float) -> list[Excitation]:
    """A few dozen excitations within the limits of voltage and slew, each as short as it can be; none where the device
    may put out no voltage that the model was fitted on."""
    low, high = span_V(axis)
    if low >= high:
        return []
    rate_Hz = 1 / step_s
    found = [Excitation("idle", 0.0, (1 / 20.0, rate_Hz / 2), 0.0, 20.0)]
    for share, biases in ((0.95, (0.5,)), (0.3, (0.5, 0.2, 0.8))):
        level = share * (high - low)
        for place in biases:
            middle = low + level / 2 + place * (high - low - level)
            found += [Excitation(name, level, band, middle, s) for name, band, s in _kinds(rate_Hz)]
    return [e for e in (one.within(axis) for one in found) if e is not None]


def repeats(runs: Sequence[ModelledRun], axis: AxisModel) -> list[Excitation]:
    """The waveforms that these runs were driven with and the device may put out, each once: a period of it, or all of
    it where it has none."""
    lowest, highest = axis.limits.u_min_V, axis.limits.u_max_V
    found: dict[tuple[float, ...], Excitation] = {}
    for modelled in runs:
        run = modelled.run
        u = run.u_V[run.rows][-modelled.period_rows :] if modelled.period_rows else run.u_V[: run.stop]
        level = float(np.ptp(u))
        if not run.driven or not level > 0 or u.min() < lowest or u.max() > highest:
            continue
        shares = (np.interp(np.arange(POINTS) * len(u) / POINTS, np.arange(len(u)), u) - u.min()) / level
        points = tuple(np.round(shares, DECIMALS).tolist())
        f_Hz, middle = 1 / (len(u) * run.step_s), float(u.min()) + level / 2
        seconds = max(LENGTHS_s[0], 1 / f_Hz)
        one = Excitation(RECORD, level, (f_Hz, f_Hz), middle, seconds, run.name, points).within(axis)
        if one is not None and seconds <= LENGTHS_s[-1]:
            found.setdefault((round(level, 2), round(middle, 2), *np.sort(points).round(2).tolist()), one)
    return list(found.values())


def _kinds(rate_Hz: float) -> list[tuple[str, tuple[float, float], float]]:
    """Name, band in Hz and seconds, by what a sampling rate can show."""
    fine = rate_Hz / POINTS  # one point per row: the fastest period without loss
    kinds: list[tuple[str, tuple[float, float], float]] = [
        ("multisine", (fine, 0.05 * rate_Hz), 2.0),
        ("multisine", (fine, 0.2 * rate_Hz), 2.0),
        ("multisine", (0.5, min(100.0, 0.2 * rate_Hz)), 4.0),
        ("triangle", (0.1, 0.5), 10.0),
        ("ladder", (0.1, 3.2), 10.0),
        ("swell", (0.25, 10.0), 4.0),
        ("swell", (4 * fine, min(200 * fine, 0.05 * rate_Hz)), 2.0),
    ]
    kinds += [("steps", (1 / s, 512 / s), s) for s in (2.0, 10.0, 40.0)]
    kinds += [("sine", (f, f), max(2.0, 4 / f)) for f in (0.2, 2.0, 0.004 * rate_Hz)]
    return [kind for kind in kinds if kind[1][0] <= kind[1][1] <= 0.5 * rate_Hz]
