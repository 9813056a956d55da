"""The peak of a vibration: its equation of the catalogue fitted to the periodograms of records at rest, whose lines are
exponentially distributed about the density there (Whittle 1953).

Noise that has become louder, and more so at one end, is no peak: both are fitted as well, and a peak must be there
beside them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import minimize
from scipy.signal import periodogram
from scipy.stats import chi2, gamma

from phaselead.gap.disturbances.disturbance import Residuals
from phaselead.gap.error_rates import TWO_SIDED_95
from phaselead.gap.findings import Estimate
from phaselead.gap.residual import RunResidual
from phaselead.model import Effect
from phaselead.record import Samples

INDEPENDENT = 1.94
"""Lines of a periodogram with a Hann window that say as much as one alone: neighbours have 4/9, the next 1/36 of their
scatter in common."""
FINER = 4
"""Places between lines at which a peak is looked at."""
NARROWEST = 0.5
"""Bandwidth in lines below which one peak looks like another."""
START_BANDWIDTHS = (0.1, 0.3, 1.0)
"""That are begun from, in that of the band in which the peak was seen."""
NOISE_LOG_STD = 2.0
"""Prior deviation of the logarithm of the noise's level, and of its slope, from what is usual: a factor of 7 in
power."""
LOG_STEP = 0.05
"""Finite difference of the logarithm of a parameter."""
LEAST_DENSITY = 1e-24
"""In um^2/Hz: a picometre in a whole hertz. A sensor whose noise is below half a step seems to have none."""
MOST_ROWS = 16384
"""Of a record in one periodogram; longer ones are cut in pieces, whose periodograms are averaged."""

Density = Callable[[Samples], Samples]
"""One-sided density in um^2/Hz at some frequencies (k,) in Hz."""
Shaken = Sequence[tuple[Residuals, Density]]
"""Records at rest, and the density that is usual in them."""


@dataclass(frozen=True)
class Peak:
    """A peak that was fitted."""

    params: dict[str, Estimate]
    chance: float
    """Probability that noise of another level and slope alone looks as much like one at this place."""
    told: bool
    """Whether the intervals of its frequency and its bandwidth end within where these were looked for."""
    filled: float
    """Probability that the lines to one side of its top hold as little as they do: two peaks leave a gap there."""


def fitted_peak(
    effect: Effect,
    shaken: Shaken,
    band_Hz: tuple[float, float],
    sides_Hz: tuple[float, float],
    start: tuple[float, float, float],
) -> Peak:
    """The peak of ``effect``, whose parameters are rms_um, f_Hz and bandwidth_Hz, with a frequency in ``band_Hz``,
    fitted to the lines within ``sides_Hz``. ``start``: rms in um, frequency and bandwidth in Hz to begin from."""
    of = {p.name: p for p in effect.parameters}
    middle_Hz = math.sqrt(sides_Hz[0] * sides_Hz[1])
    records = [_Lines(one, sides_Hz, usual, middle_Hz) for part, usual in shaken for one in part]
    width = of["bandwidth_Hz"]
    narrowest_Hz = max(width.low, NARROWEST * min(one.step_Hz for one in records))
    rms_low_um = 1e-6 * of["rms_um"].typical
    ranges = {
        "rms_um": (rms_low_um, of["rms_um"].high),
        "f_Hz": (max(band_Hz[0], of["f_Hz"].low), min(band_Hz[1], of["f_Hz"].high)),
        "bandwidth_Hz": (narrowest_Hz, width.high),
    }
    low, high = np.log(list(ranges.values())).T

    def peak_misfit(x: Samples) -> float:
        """Of the logarithms of the parameters, and of the noise's level and slope."""
        inside = np.clip(x[:3], low, high)
        params = dict(zip(ranges, np.exp(inside).tolist(), strict=True))
        peaks = [one.peak(effect, params) for one in records]
        return _misfit(records, peaks, x[3], x[4]) + float(np.sum((x[:3] - inside) ** 2))

    def noise_misfit(x: Samples) -> float:
        return _misfit(records, [0.0] * len(records), x[0], x[1])

    starts = [(*start[:2], share * start[2]) for share in START_BANDWIDTHS]
    begun = [np.concatenate([np.clip(np.log(start), low, high), np.zeros(2)]) for start in starts]
    options = {"adaptive": True, "maxiter": 2000}
    best = min(
        (minimize(peak_misfit, x, method="Nelder-Mead", options=options) for x in begun), key=lambda fit: fit.fun
    )
    noise = minimize(noise_misfit, np.zeros(2), method="Nelder-Mead")
    at = np.clip(best.x[:3], low, high)
    spread = _deviations(peak_misfit, np.concatenate([at, best.x[3:]]), high - low)
    ends = np.clip([at - TWO_SIDED_95 * spread, at + TWO_SIDED_95 * spread], low, high)
    told = bool(low[1] < ends[0][1] and np.all(ends[1][1:] < high[1:]))
    values, lows, highs = (dict(zip(ranges, np.exp(one).tolist(), strict=True)) for one in (at, *ends))
    if ends[0][2] <= low[2]:
        lows["bandwidth_Hz"] = width.low  # a narrower peak looks the same
    params: dict[str, Estimate] = {name: (values[name], of[name].unit, (lows[name], highs[name])) for name in of}
    chance = float(chi2.sf(2 * (float(noise.fun) - float(best.fun)), len(of)))
    halves = [[one.at_top(effect, values, *best.x[3:], above=above) for one in records] for above in (False, True)]
    return Peak(params, chance, told, min(map(_filled, halves)))


class _Lines:
    """The lines of one record's periodogram between two frequencies."""

    def __init__(self, residual: RunResidual, sides_Hz: tuple[float, float], usual: Density, middle_Hz: float) -> None:
        n = len(residual.error_um)
        self.pieces = -(-n // MOST_ROWS)
        pieces = residual.error_um[: n // self.pieces * self.pieces].reshape(self.pieces, -1)
        f, each = periodogram(pieces, residual.rate_Hz, window="hann", detrend="linear")
        p = each.mean(axis=0)
        # The line at half the sampling rate is distributed otherwise.
        inside = (f >= sides_Hz[0]) & (f <= sides_Hz[1]) & (f < residual.rate_Hz / 2)
        self.rate_Hz, self.step_Hz, self.seen = residual.rate_Hz, float(f[1]), p[inside]
        self.usual = np.maximum(usual(f[inside]), LEAST_DENSITY)
        self.log_f = np.log(f[inside] / middle_Hz)
        # Share of the power so many lines away that a Hann window leaks into a line.
        off = (np.arange(4 * FINER) - 2 * FINER + 0.5) / FINER
        self.leaks = (np.sinc(off) / (1 - off**2)) ** 2
        self.leaks /= self.leaks.sum()
        self.around_Hz = np.abs(f[inside][:, None] + off * f[1])

    def peak(self, effect: Effect, params: Mapping[str, float]) -> Samples:
        """Density (k,) of an effect in the lines."""
        assert effect.spectrum is not None
        return np.asarray(effect.spectrum(self.around_Hz, params, self.rate_Hz) @ self.leaks)

    def misfit(self, peak: Samples | float, level: float, slope: float) -> float:
        """Minus the logarithm of how likely the lines are, but for a constant, as if all were independent."""
        density = self._density(peak, level, slope)
        return self.pieces * float(np.sum(np.log(density) + self.seen / density))

    def at_top(
        self, effect: Effect, params: Mapping[str, float], level: float, slope: float, *, above: bool
    ) -> tuple[Samples, int]:
        """What the lines (n,) in the upper or the lower half of the half-power bandwidth hold of what they should, and
        of how many pieces each is the average."""
        off_Hz = self.around_Hz.mean(axis=1) - params["f_Hz"]
        top = (np.abs(off_Hz) <= max(params["bandwidth_Hz"], self.step_Hz) / 2) & ((off_Hz >= 0) == above)
        return (self.seen / self._density(self.peak(effect, params), level, slope))[top], self.pieces

    def _density(self, peak: Samples | float, level: float, slope: float) -> Samples:
        """That is expected (k,)."""
        return np.asarray(self.usual * np.exp(np.clip(level + slope * self.log_f, -50, 50)) + peak)


def _filled(tops: Sequence[tuple[Samples, int]]) -> float:
    """Probability that lines hold as little as they do of what they should (n,), each of an average of so many."""
    told = sum(len(of) * pieces for of, pieces in tops) / INDEPENDENT
    held = sum(float(of.sum()) * pieces for of, pieces in tops) / INDEPENDENT
    return float(gamma.cdf(held, told)) if told > 0 else 1.0


def _misfit(records: Sequence[_Lines], peaks: Sequence[Samples | float], level: float, slope: float) -> float:
    """Minus the logarithm of how likely all lines are, and the noise's level and slope, but for a constant."""
    lines = sum(one.misfit(peak, level, slope) for one, peak in zip(records, peaks, strict=True))
    return lines / INDEPENDENT + (level**2 + slope**2) / (2 * NOISE_LOG_STD**2)


def _deviations(misfit: Callable[[Samples], float], at: Samples, widths: Samples) -> Samples:
    """Standard deviations of the first parameters, one for each of ``widths``: by the curvature of the misfit. A
    parameter that the lines do not determine has that of a uniform distribution over a range of this width."""
    steps = LOG_STEP * np.eye(len(at))
    curvature = np.zeros((len(at), len(at)))
    for i, j in product(range(len(at)), repeat=2):
        a, b = steps[i], steps[j]
        corners = misfit(at + a + b) - misfit(at + a - b) - misfit(at - a + b) + misfit(at - a - b)
        curvature[i, j] = corners / (2 * LOG_STEP) ** 2
    uniform = 12 / widths**2
    curvature[np.arange(len(widths)), np.arange(len(widths))] += uniform
    informed, axes = np.linalg.eigh(curvature)
    return np.asarray(np.sqrt((axes**2 / np.maximum(informed, uniform.min())).sum(axis=1))[: len(widths)])
