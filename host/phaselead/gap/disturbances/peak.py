"""The peak of a vibration: its equation of the catalogue fitted to the periodograms of records at rest, whose lines are
exponentially distributed about the density there (Whittle 1953).

Noise that has become louder, and more so at one end, is no peak: both are fitted as well, and a peak must be there
beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import minimize
from scipy.signal import periodogram

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
"""Places between lines at which a peak is looked at: it may be narrower than they are apart."""
WIDTHS = (0.1, 0.3, 1.0)
"""Bandwidths that are begun from, in that of the band in which the peak was seen."""
DIFFERENCE = 0.05
"""Finite difference of the logarithm of a parameter."""
LOUDER = 2.0
"""Prior deviation of the logarithm of the noise's level, and of its slope, from what is usual: a factor of 7 in
power."""
LEAST = 1e-6
"""Of a typical value: what counts as the lower end of a range that ends at 0."""


@dataclass(frozen=True)
class Peak:
    """A peak that was fitted."""

    params: dict[str, Estimate]
    log_likelihood_gained: float
    """Above noise of another level and slope alone."""


def fitted_peak(
    effect: Effect,
    part: Residuals,
    usual_um2_per_Hz: Callable[[Samples], Samples],
    within_Hz: tuple[float, float],
    start: Mapping[str, float],
) -> Peak:
    """Value, unit and 95 % interval of each parameter of ``effect``, which has a spectrum and whose parameters are all
    positive, from the lines between two frequencies of some records at rest; the peak is between these.

    ``usual_um2_per_Hz``: one-sided density without the effect at some frequencies, whose level and slope may be others;
    ``start``: parameters to begin from, each within its range.
    """
    of, middle_Hz = effect.parameters, float(np.sqrt(within_Hz[0] * within_Hz[1]))
    records = [_Lines(residual, within_Hz, usual_um2_per_Hz, middle_Hz) for residual in part]
    ranges = [within_Hz if p.name == "f_Hz" else (max(p.low, LEAST * p.typical), p.high) for p in of]
    low, high = np.log(ranges).T

    def misfit(x: Samples) -> float:
        """Of logarithms of the parameters, level and slope, in this order; of the last two alone there is no peak."""
        logs, (level, slope) = x[:-2], x[-2:]
        inside = np.clip(logs, low[: len(logs)], high[: len(logs)])
        params = {p.name: value for p, value in zip(of, np.exp(inside).tolist(), strict=False)}
        lines = sum(one.misfit(effect, params, level, slope) for one in records)
        unlikely = (level**2 + slope**2) / (2 * LOUDER**2)
        return float(lines / INDEPENDENT + np.sum((logs - inside) ** 2) + unlikely)

    noise = minimize(misfit, np.zeros(2), method="Nelder-Mead")
    at = np.log([start[p.name] for p in of])
    fits = []
    for times in WIDTHS:
        narrower = at + np.log([times if p.name == "bandwidth_Hz" else 1.0 for p in of])
        begun = np.concatenate([np.clip(narrower, low, high), np.zeros(2)])
        fits.append(minimize(misfit, begun, method="Nelder-Mead", options={"adaptive": True, "maxiter": 2000}))
    best = min(fits, key=lambda fit: float(fit.fun))
    logs = np.clip(best.x[:-2], low, high)
    # Of what the lines do not tell at all, any value of its range is as likely.
    least = np.concatenate([12 / (high - low) ** 2, np.zeros(2)])
    informed, axes = np.linalg.eigh(_curvature(misfit, np.concatenate([logs, best.x[-2:]])) + np.diag(least))
    spread = np.sqrt((axes**2 / np.maximum(informed, least[:-2].min())).sum(axis=1))[:-2]
    ends = np.clip([logs - TWO_SIDED_95 * spread, logs + TWO_SIDED_95 * spread], low, high)
    rows = zip(of, np.exp(logs).tolist(), *np.exp(ends).tolist(), strict=True)
    params: dict[str, Estimate] = {p.name: (value, p.unit, (least, most)) for p, value, least, most in rows}
    return Peak(params, float(noise.fun - best.fun))


class _Lines:
    """The lines of one record's periodogram between two frequencies."""

    def __init__(
        self,
        residual: RunResidual,
        within_Hz: tuple[float, float],
        usual_um2_per_Hz: Callable[[Samples], Samples],
        middle_Hz: float,
    ) -> None:
        f, p = periodogram(residual.error_um, residual.rate_Hz, window="hann", detrend="linear")
        inside = (f >= within_Hz[0]) & (f <= within_Hz[1])
        self.rate_Hz, self.seen, self.usual = residual.rate_Hz, p[inside], usual_um2_per_Hz(f[inside])
        self.log_f = np.log(f[inside] / middle_Hz)
        # Where the window sees a line: what is so many lines off leaks into it.
        off = (np.arange(4 * FINER) - 2 * FINER + 0.5) / FINER
        self.leaks = (np.sinc(off) / (1 - off**2)) ** 2
        self.leaks /= self.leaks.sum()
        self.f_Hz = np.abs(f[inside][:, None] + off * f[1])

    def misfit(self, effect: Effect, params: Mapping[str, float], level: float, slope: float) -> float:
        """Minus the logarithm of how likely the lines are, but for a constant; without parameters, without a peak."""
        assert effect.spectrum is not None
        density = self.usual * np.exp(np.clip(level + slope * self.log_f, -50, 50))
        if params:
            density = density + effect.spectrum(self.f_Hz, params, self.rate_Hz) @ self.leaks
        return float(np.sum(np.log(density) + self.seen / density))


def _curvature(misfit: Callable[[Samples], float], at: Samples) -> Samples:
    """Second derivatives (k, k) by central differences."""
    steps = DIFFERENCE * np.eye(len(at))
    found = np.zeros((len(at), len(at)))
    for i, j in product(range(len(at)), repeat=2):
        a, b = steps[i], steps[j]
        corners = misfit(at + a + b) - misfit(at + a - b) - misfit(at - a + b) + misfit(at - a - b)
        found[i, j] = corners / (2 * DIFFERENCE) ** 2
    return found
