"""The first modes of the mechanics, from what the operator leaves of fast records: ringing after every kink.

Without them a sine one of whose harmonics falls on a mode is predicted worse than the operator could. One is adopted
only when it pays where it was not fitted; at most two are looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from phaselead.identify.runs import AxisRun
from phaselead.model import (
    AdoptedEffect,
    Mode,
    TimeView,
    mode_coefficients,
    predict_time_view,
    resonant,
    second_order_left,
)
from phaselead.record import Samples

SLOWEST_RATE_HZ = 400.0
LOWEST_HZ, HIGHEST_OF_RATE, SECOND_OF_RATE = 30.0, 0.9, 0.45
"""Range searched: a ringing slower than this is creep or drift to us. A mode beyond half of the rate is not seen to
ring, but it raises the response below it, by (f/f_Hz)^2; a second one, of less weight, is to be seen."""
APART = 1.3
"""A second mode lies this factor above the first at least: below it, it would stand in for what the operator misses."""
TRIED_FREQUENCIES, TRIED_ZETAS = 100, (0.01, 0.03, 0.1)
ZETA, UNDAMPED = (0.002, 0.5), 0.0022
"""A second mode at the bound of damping stands in for what the delay leaves."""
MOST_SHARE = 0.1
"""Of the motion: a second mode that carries more stands in for what happens between rows."""
MOST_RUNS = 16
FEW_RUNS, BLOCKS = 8, 24
"""Below so many runs each is fitted and judged on alternating blocks of itself, not on alternating runs, and fitted by
its second differences: what the operator misses of the slow way would outweigh the ringing."""
SPECTRUM_ROWS, PEAK_WIDTH = 4096, 8
PEAKS = 4
"""Of the residual's spectrum, tried beside the grid: a lightly damped mode is narrower than the grid's steps."""
PAYS, SECOND_PAYS = 0.9, 0.95
"""Adopted when it leaves less than this share of the squared residual where it was not fitted; a second one, of its
second differences."""


OUTSIDE = 1e30
"""Cost beyond the range."""
PRECISE = 1e-4
"""Of the squared residual: what a search may leave on the table."""

Pair = tuple[float, float, float, float]
"""f_Hz and zeta of a first mode and of a second."""


@dataclass(frozen=True)
class FittedModes:
    """Modes whose shares of the motion add up to 1, and the delay that goes with them (modes lag too)."""

    modes: tuple[Mode, ...]
    delay_s: float
    left: float
    """Share of the operator's squared residual that remains, on rows they were not fitted on."""

    def adopted(self, view: TimeView) -> tuple[TimeView, AdoptedEffect]:
        """The time view with the delay that remains, and the entry for the stage file."""
        c, f_Hz, zeta = zip(*self.modes, strict=True)
        params = {"f_Hz": f_Hz[0], "zeta": zeta[0]} if len(c) == 1 else {"c": c, "f_Hz": f_Hz, "zeta": zeta}
        effect = AdoptedEffect(name="resonance", params=params, share=min(max(1 - self.left, 0.0), 1.0))
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

    def left_by(self, pair: Pair) -> Samples:
        """(n, 3): what the first mode leaves, how a later answer would change that, and how a second mode would."""
        answer = resonant(self.base, pair[0], pair[1], self.step_s)
        late = np.diff(answer, prepend=answer[0]) / self.step_s
        second = answer - resonant(self.base, pair[2], pair[3], self.step_s)
        return np.stack([column[self._rows] for column in (self._measured - answer, late, second)], axis=1)

    def moments(self, pair: Pair) -> Samples:
        """(3, 3) covariance of these."""
        columns = self.left_by(pair)
        mean = columns.mean(axis=0)
        return np.asarray(columns.T @ columns / len(columns) - np.outer(mean, mean))

    @cached_property
    def _measured(self) -> Samples:
        return self.base + self.left

    @cached_property
    def _rows(self) -> NDArray[np.uintp]:
        return np.arange(len(self.base), dtype=np.uintp)[self.rows]


def fit_modes(view: TimeView, runs: Sequence[AxisRun], known: FittedModes | None = None) -> FittedModes | None:
    """The modes that explain most of what ``view`` leaves, or None: records too slow, or none pays. ``known``: how
    many there are and about where."""
    fast = [run for run in runs if run.step_s <= 1 / SLOWEST_RATE_HZ]
    if len(fast) < 2:
        return None
    fast.sort(key=lambda run: len(run.t_s))  # fast sines ring most, and are short
    fitted, judged = _parts([_ringing(view, run) for run in fast[:MOST_RUNS]])
    nothing = sum(float(np.var(r.left[r.rows])) for r in judged)
    one = _downhill(fitted, known.modes[0][1:]) if known else _first(fitted)
    shift_s = _shift_s(fitted, *one)
    left = _power(judged, *one, shift_s) / nothing
    if left >= PAYS:
        return None
    alone = FittedModes(((1.0, *one),), max(view.delay_s + shift_s, 0.0), left)
    if known and len(known.modes) == 1:
        return alone
    two = _pair_downhill(fitted, (*one, *known.modes[1][1:])) if known else _second(fitted, one)
    if two is None or two[2] < APART * two[0] or two[3] < UNDAMPED:
        return alone
    shift_s, share = _amounts(_pair_moments(fitted, two)).tolist()
    if abs(share) > MOST_SHARE:
        return alone
    left_by_two = _pair_power(judged, two, shift_s, share) / nothing
    if left_by_two >= PAYS * left and not _rings(judged, one, _shift_s(fitted, *one), two, (shift_s, share)):
        return alone
    modes = ((1 - share, two[0], two[1]), (share, two[2], two[3]))
    return FittedModes(modes, max(view.delay_s + shift_s, 0.0), left_by_two)


def _rings(
    judged: Sequence[_Ringing], one: tuple[float, float], one_s: float, two: Pair, amounts: tuple[float, float]
) -> bool:
    """Whether a second mode pays in the second differences of rows that it was not fitted on."""
    fine = [_differenced(run) for run in judged]
    return _pair_power(fine, two, *amounts) < SECOND_PAYS * _power(fine, *one, one_s)


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
        for half in (0, 1):
            part = replace(run, rows=rows[(np.arange(len(rows)) * BLOCKS // len(rows)) % 2 == half])
            parts[half].append(part if half else _differenced(part))
    return parts


def _differenced(run: _Ringing) -> _Ringing:
    base, left = (np.diff(x, 2, prepend=[x[0]] * 2) for x in (run.base, run.left))
    return replace(run, base=base, left=left)


def _peaks_Hz(residuals: Sequence[Samples], step_s: float, highest_Hz: float) -> list[float]:
    """Frequencies at which residuals (n,) stand out most."""
    f_Hz = np.fft.rfftfreq(SPECTRUM_ROWS, step_s)
    density = np.sum([_density(left) for left in residuals], axis=0)
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


def _tried_Hz(residuals: Sequence[Samples], step_s: float, highest_Hz: float) -> list[float]:
    """A grid of frequencies and the residuals' peaks."""
    grid = np.geomspace(LOWEST_HZ, highest_Hz, TRIED_FREQUENCIES).tolist()
    return [*grid, *_peaks_Hz(residuals, step_s, highest_Hz)]


def _first(runs: Sequence[_Ringing]) -> tuple[float, float]:
    """Frequency and damping with the least residual: the best of those tried, then downhill from there."""
    step_s, few = runs[-1].step_s, runs[:4]
    tried = _tried_Hz([run.left for run in runs], step_s, HIGHEST_OF_RATE / step_s)
    return _downhill(runs, min(product(tried, TRIED_ZETAS), key=lambda point: _best_power(few, *point)))


def _downhill(runs: Sequence[_Ringing], start: tuple[float, float]) -> tuple[float, float]:
    f_Hz, zeta = _least(lambda point: _best_power(runs, *point), start, [HIGHEST_OF_RATE / runs[0].step_s], 0.03)
    return f_Hz, zeta


def _second(runs: Sequence[_Ringing], one: tuple[float, float]) -> Pair | None:
    """Both modes, the second where it explains most of what the first leaves; None where there is no room for one."""
    step_s, few = runs[-1].step_s, runs[:4]
    left = [run.left_by((*one, *one))[:, 0] for run in runs]
    tried = [f for f in _tried_Hz(left, step_s, SECOND_OF_RATE / step_s) if f > APART * one[0]]
    pairs = [(*one, f, zeta) for f, zeta in product(tried, TRIED_ZETAS)]
    return _pair_downhill(runs, min(pairs, key=lambda pair: _best_pair_power(few, pair))) if pairs else None


def _pair_downhill(runs: Sequence[_Ringing], start: Pair) -> Pair:
    step_s = runs[0].step_s
    highest_Hz = [HIGHEST_OF_RATE / step_s, SECOND_OF_RATE / step_s]
    found = _least(lambda p: _best_pair_power(runs, (p[0], p[1], p[2], p[3])), start, highest_Hz, 0.01)
    return found[0], found[1], found[2], found[3]


def _least(
    power: Callable[[tuple[float, ...]], float], start: tuple[float, ...], highest_Hz: Sequence[float], reach: float
) -> list[float]:
    """Frequencies and dampings, in turn, of the least power within their range; ``reach``: first relative steps."""
    first = np.log(start)

    def cost(logs: Samples) -> float:
        f_Hz, zeta = np.exp(logs[::2]), np.exp(logs[1::2])
        inside = (f_Hz >= LOWEST_HZ).all() and (f_Hz <= highest_Hz).all()
        if not (inside and (zeta >= ZETA[0]).all() and (zeta <= ZETA[1]).all()):
            return OUTSIDE
        return power(tuple(np.exp(logs).tolist()))

    simplex = first + np.vstack([np.zeros(len(first)), np.diag(np.tile([reach, 0.4], len(first) // 2))])
    enough = PRECISE * power(tuple(start))
    options = {"initial_simplex": simplex, "maxfev": 40 * len(first), "xatol": 2e-4, "fatol": enough}
    return list(np.exp(minimize(cost, first, method="Nelder-Mead", options=options).x).tolist())


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


def _pair_moments(runs: Sequence[_Ringing], pair: Pair) -> Samples:
    return np.asarray(sum(run.moments(pair) for run in runs))


def _amounts(moments: Samples) -> Samples:
    """By how much later the answer should come, and the second mode's share: least squares."""
    return np.asarray(-np.linalg.lstsq(moments[1:, 1:], moments[1:, 0], rcond=1e-12)[0])


def _pair_power(runs: Sequence[_Ringing], pair: Pair, shift_s: float, share: float) -> float:
    whole = np.array([1.0, shift_s, share])
    return float(whole @ _pair_moments(runs, pair) @ whole)


def _best_pair_power(runs: Sequence[_Ringing], pair: Pair) -> float:
    """With the best shift and share."""
    moments = _pair_moments(runs, pair)
    whole = np.array([1.0, *_amounts(moments)])
    return float(whole @ moments @ whole)
