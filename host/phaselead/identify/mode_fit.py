"""The first mode of the mechanics, from what the operator leaves of fast records: ringing after every kink of the path.

Without it a sine one of whose harmonics falls on the mode is predicted worse than the operator could. It is adopted
only when it pays where it was not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from phaselead.effects.filters import mode_coefficients
from phaselead.effects.native import second_order_left
from phaselead.identify.checks import AxisRun
from phaselead.record.recording import Samples
from phaselead.stage.file import Effect, TimeView
from phaselead.stage.operator import predict_time_view

SLOWEST_RATE_HZ = 1000.0
LOWEST_HZ, HIGHEST_OF_RATE = 30.0, 0.2
"""Range searched: a ringing slower than this is creep or drift to us, a faster one is too coarsely sampled."""
TRIED_FREQUENCIES, TRIED_ZETAS = 80, (0.01, 0.03, 0.1)
ZETA = (0.002, 0.5)
MOST_RUNS = 16
FEW_RUNS, BLOCKS = 8, 24
"""Below so many runs each is fitted and judged on alternating blocks of itself, not on alternating runs, and fitted by
its second differences: what the operator misses of the slow way would outweigh the ringing."""
SPECTRUM_ROWS, PEAK_WIDTH = 4096, 8
PEAKS = 4
"""Of the residual's spectrum, tried beside the grid: a lightly damped mode is narrower than the grid's steps."""
PAYS = 0.9
"""Adopted when it leaves less than this share of the squared residual where it was not fitted."""


@dataclass(frozen=True)
class FittedMode:
    """A mode that carries all of the motion, and the delay that goes with it (the mode lags too)."""

    f_Hz: float
    zeta: float
    delay_s: float
    left: float
    """Share of the operator's squared residual that remains, on rows it was not fitted on."""

    def adopted(self, view: TimeView) -> tuple[TimeView, Effect]:
        """The time view with the delay that remains, and the entry for the stage file."""
        effect = Effect(
            name="resonance", params={"f_Hz": self.f_Hz, "zeta": self.zeta}, share=min(max(1 - self.left, 0.0), 1.0)
        )
        return view.model_copy(update={"delay_s": self.delay_s}), effect


@dataclass(frozen=True)
class _Ringing:
    """A run as seen here: the operator's answer and what it leaves, relative to the run's range."""

    base: Samples
    left: Samples
    step_s: float
    rows: slice | NDArray[np.intp]
    """To be looked at."""

    def remaining(self, f_Hz: float, zeta: float) -> tuple[float, float, float]:
        """Mean squares of what a mode leaves and of how a later answer would change that, and their mean product."""
        system = mode_coefficients(f_Hz * self.step_s, zeta)
        return second_order_left(self.base, self._measured, system, self.step_s, self._rows)

    @cached_property
    def _measured(self) -> Samples:
        return self.base + self.left

    @cached_property
    def _rows(self) -> NDArray[np.uintp]:
        return np.arange(len(self.base), dtype=np.uintp)[self.rows]


def fit_mode(view: TimeView, runs: Sequence[AxisRun]) -> FittedMode | None:
    """The mode that explains most of what ``view`` leaves, or None: records too slow, or it does not pay."""
    fast = [run for run in runs if run.step_s <= 1 / SLOWEST_RATE_HZ]
    if len(fast) < 2:
        return None
    fast.sort(key=lambda run: len(run.t_s))  # fast sines ring most, and are short
    fitted, judged = _parts([_ringing(view, run) for run in fast[:MOST_RUNS]])
    f_Hz, zeta = _search(fitted)
    shift_s = _shift_s(fitted, f_Hz, zeta)
    left = _power(judged, f_Hz, zeta, shift_s) / sum(float(np.var(r.left[r.rows])) for r in judged)
    if left >= PAYS:
        return None
    return FittedMode(f_Hz, zeta, max(view.delay_s + shift_s, 0.0), left)


def _ringing(view: TimeView, run: AxisRun) -> _Ringing:
    base = predict_time_view(view, run.t_s, run.u_V)
    return _Ringing(base / run.range_um, (run.x_um - base) / run.range_um, run.step_s, run.scored)


def _parts(runs: Sequence[_Ringing]) -> tuple[list[_Ringing], list[_Ringing]]:
    """What to fit to and what to judge on."""
    if len(runs) >= FEW_RUNS:
        return list(runs[::2]), list(runs[1::2])
    parts: tuple[list[_Ringing], list[_Ringing]] = ([], [])
    for run in runs:
        rows = np.arange(len(run.base))[run.rows]
        base, left = (np.diff(x, 2, prepend=[x[0]] * 2) for x in (run.base, run.left))
        for half in (0, 1):
            part = rows[(np.arange(len(rows)) * BLOCKS // len(rows)) % 2 == half]
            parts[half].append(replace(run, rows=part) if half else replace(run, base=base, left=left, rows=part))
    return parts


def _peaks_Hz(runs: Sequence[_Ringing], highest_Hz: float) -> list[float]:
    """Frequencies at which the residuals stand out most."""
    f_Hz = np.fft.rfftfreq(SPECTRUM_ROWS, runs[-1].step_s)
    density = np.sum([_density(run.left) for run in runs], axis=0)
    density[(f_Hz < LOWEST_HZ) | (f_Hz > highest_Hz)] = 0.0
    around = np.lib.stride_tricks.sliding_window_view(np.pad(density, PEAK_WIDTH, mode="edge"), 2 * PEAK_WIDTH + 1)
    others = np.delete(around, PEAK_WIDTH, axis=1).max(axis=1)
    tops = np.flatnonzero(density > others)
    return [float(f_Hz[i]) for i in tops[np.argsort(-density[tops])][:PEAKS]]


def _density(x: Samples) -> Samples:
    """Power of ``x`` (n,) over frequency, in no unit: half-overlapping Hann windows (Welch 1967)."""
    length = min(len(x), SPECTRUM_ROWS)
    parts = np.lib.stride_tricks.sliding_window_view(x, length)[:: length - length // 2]
    window = np.hanning(length + 1)[:-1]
    waves = np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, SPECTRUM_ROWS)
    return np.asarray(np.mean(np.abs(waves) ** 2, axis=0) / np.sum(window**2))


def _search(runs: Sequence[_Ringing]) -> tuple[float, float]:
    """Frequency and damping with the least residual: a grid and the residual's peaks, then downhill from the best."""
    highest_Hz = HIGHEST_OF_RATE / runs[0].step_s
    tried_Hz = [*np.geomspace(LOWEST_HZ, highest_Hz, TRIED_FREQUENCIES), *_peaks_Hz(runs, highest_Hz)]
    grid = [(f, z) for f in tried_Hz for z in TRIED_ZETAS]
    few = runs[:4]
    start = min(grid, key=lambda point: _best_power(few, *point))

    def cost(point: Samples) -> float:
        f_Hz, zeta = np.exp(point)
        if not (LOWEST_HZ <= f_Hz <= highest_Hz and ZETA[0] <= zeta <= ZETA[1]):
            return float("inf")
        return _best_power(runs, f_Hz, zeta)

    simplex = np.log(start) + np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.4]])
    found = minimize(cost, np.log(start), method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": 80})
    f_Hz, zeta = np.exp(found.x)
    return float(f_Hz), float(zeta)


def _shift_s(runs: Sequence[_Ringing], f_Hz: float, zeta: float) -> float:
    """How much later the answer should come, by least squares over all runs."""
    _, across, late = _moments(runs, f_Hz, zeta)
    return -across / late


def _power(runs: Sequence[_Ringing], f_Hz: float, zeta: float, shift_s: float) -> float:
    power, across, late = _moments(runs, f_Hz, zeta)
    return power + 2 * shift_s * across + shift_s**2 * late


def _best_power(runs: Sequence[_Ringing], f_Hz: float, zeta: float) -> float:
    """With the best shift."""
    power, across, late = _moments(runs, f_Hz, zeta)
    return power - across**2 / late


def _moments(runs: Sequence[_Ringing], f_Hz: float, zeta: float) -> tuple[float, float, float]:
    """``_Ringing.remaining``, summed over the runs: left, across, late."""
    left, across, late = np.sum([run.remaining(f_Hz, zeta) for run in runs], axis=0).tolist()
    return left, across, late
