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
from scipy.optimize import OptimizeResult, minimize
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
    middle_Hz = math.sqrt(sides_Hz[0] * sides_Hz[1])
    records = [_Lines(one, sides_Hz, usual, middle_Hz) for part, usual in shaken for one in part]
    model = _PeakBesideNoise(effect, records, _looked_for(effect, records, band_Hz))
    fits = [model.fitted((*start[:2], share * start[2])) for share in START_BANDWIDTHS]
    best = min(fits, key=lambda fit: float(fit.fun))
    noise = minimize(model.misfit_of_noise, np.zeros(2), method="Nelder-Mead")
    chance = float(chi2.sf(2 * (float(noise.fun) - float(best.fun)), len(model.ranges)))
    params, told = model.estimates(best.x)
    values = {name: value for name, (value, _, _) in params.items()}
    halves = [[one.at_top(effect, values, *best.x[3:], above=above) for one in records] for above in (False, True)]
    return Peak(params, chance, told, min(map(_filled, halves)))


def _looked_for(
    effect: Effect, records: Sequence[_Lines], band_Hz: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each parameter of a peak with a frequency in a band."""
    rms, f, width = (effect.parameter(name) for name in ("rms_um", "f_Hz", "bandwidth_Hz"))
    narrowest_Hz = max(width.low, NARROWEST * min(one.step_Hz for one in records))
    return {
        rms.name: (1e-6 * rms.typical, rms.high),
        f.name: (max(band_Hz[0], f.low), min(band_Hz[1], f.high)),
        width.name: (narrowest_Hz, width.high),
    }


class _PeakBesideNoise:
    """A peak beside noise of another level and slope: the logarithms of its parameters within ``ranges``, then these
    two."""

    def __init__(self, effect: Effect, records: Sequence[_Lines], ranges: Mapping[str, tuple[float, float]]) -> None:
        self.effect, self.records, self.ranges = effect, records, ranges
        self.low, self.high = np.log(list(ranges.values())).T

    def misfit(self, x: Samples) -> float:
        """Of ``x`` (5,): minus the logarithm of how likely the lines are, but for a constant."""
        inside = np.clip(x[:3], self.low, self.high)
        params = self._named(inside)
        peaks = [one.peak(self.effect, params) for one in self.records]
        return _misfit(self.records, peaks, x[3], x[4]) + float(np.sum((x[:3] - inside) ** 2))

    def misfit_of_noise(self, x: Samples) -> float:
        """The same of level and slope (2,) without a peak."""
        return _misfit(self.records, [0.0] * len(self.records), x[0], x[1])

    def fitted(self, start: tuple[float, float, float]) -> OptimizeResult:
        """The likeliest ``x``, from rms in um, frequency and bandwidth in Hz on."""
        begun = np.concatenate([np.clip(np.log(start), self.low, self.high), np.zeros(2)])
        options = {"adaptive": True, "maxiter": 2000}
        return minimize(self.misfit, begun, method="Nelder-Mead", options=options)

    def estimates(self, x: Samples) -> tuple[dict[str, Estimate], bool]:
        """The peak's parameters at the likeliest ``x``, with intervals, and whether those of its frequency and its
        bandwidth end within the ranges."""
        at = np.clip(x[:3], self.low, self.high)
        spread = _deviations(self.misfit, np.concatenate([at, x[3:]]), self.high - self.low)
        ends = np.clip([at - TWO_SIDED_95 * spread, at + TWO_SIDED_95 * spread], self.low, self.high)
        told = bool(self.low[1] < ends[0][1] and np.all(ends[1][1:] < self.high[1:]))
        values, lows, highs = map(self._named, (at, *ends))
        if ends[0][2] <= self.low[2]:
            lows["bandwidth_Hz"] = self.effect.parameter("bandwidth_Hz").low  # a narrower peak looks the same
        of = self.effect.parameters
        return {p.name: (values[p.name], p.unit, (lows[p.name], highs[p.name])) for p in of}, told

    def _named(self, logs: Samples) -> dict[str, float]:
        """Parameters of these logarithms (3,)."""
        return dict(zip(self.ranges, np.exp(logs).tolist(), strict=True))


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
