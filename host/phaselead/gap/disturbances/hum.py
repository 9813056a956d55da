"""Mains hum: lines at the mains frequency and its first multiples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Residuals
from phaselead.gap.error_rates import FOUND, FOUND_AGAIN, TWO_SIDED_95
from phaselead.gap.findings import Estimate
from phaselead.gap.residual import RunResidual
from phaselead.record import Samples

MAINS_Hz = (50.0, 60.0)
HARMONICS = (1, 2, 3)
SEARCH_Hz = 0.2
"""How far the mains may be off its nominal frequency."""
BACKGROUND_Hz = 6.0
"""To either side of a line, over which the density of the noise is taken."""
MEDIAN_OVER_MEAN = 0.693
"""Of the power of noise in a periodogram, which is exponentially distributed."""
ROWS_A_PERIOD = 2.2
"""That a line needs to be seen, a little more than two."""
SAME_Hz = 2.0
"""A peak this near a multiple of the mains frequency is counted as mains."""


def is_mains(f_Hz: float) -> bool:
    """Whether a frequency is that of the mains or one of its first multiples."""
    return any(abs(f_Hz - h * m) < SAME_Hz for m in MAINS_Hz for h in HARMONICS)


def find_hum(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """Hum at 50 or 60 Hz, whichever is stronger, as the effect ``name``; None where neither stands out."""
    nominal = [mains for mains in MAINS_Hz if ROWS_A_PERIOD * mains <= train[0].rate_Hz]
    powers = [(power, f_Hz) for mains in nominal for f_Hz, power in _new_lines(mains, train, holdout, reference)]
    if not powers:
        return None
    power, f_Hz = max(powers, key=lambda one: one[0])
    why = f"lines at {f_Hz:.2f} Hz and multiples, {1e3 * np.sqrt(2 * power):.3g} nm, in the held-out records too"
    return Disturbance(name, _hum_params(train, f_Hz), power, why)


def without_hum(part: Residuals, f_Hz: float) -> list[RunResidual]:
    """Residuals without the lines of hum near ``f_Hz``, each fitted at the frequency that suits it best."""
    return [replace(residual, error_um=residual.error_um - _hum_um(residual, f_Hz)) for residual in part]


def _hum_um(residual: RunResidual, f_Hz: float) -> Samples:
    """Sines and cosines at the multiples of the mains frequency, fitted to a residual (n,)."""
    t_s, error_um = residual.run.t_s[residual.run.rows], residual.error_um - residual.error_um.mean()
    known = [h for h in HARMONICS if ROWS_A_PERIOD * h * f_Hz <= residual.rate_Hz]

    def fitted(f: float) -> Samples:
        turns = 2 * np.pi * np.outer(t_s - t_s[0], [h * f for h in known])
        columns = np.hstack([np.sin(turns), np.cos(turns)])
        return np.asarray(columns @ np.linalg.lstsq(columns, error_um, rcond=None)[0])

    def left(f: float) -> float:
        return float(np.sum((error_um - fitted(f)) ** 2))

    grid = _frequencies_near(f_Hz, len(t_s) / residual.rate_Hz)
    near, step = min(grid, key=left), float(grid[1] - grid[0])
    best = minimize_scalar(left, bounds=(near - step, near + step), method="bounded", options={"xatol": 1e-3 * step})
    return fitted(float(best.x))


def _frequencies_near(f_Hz: float, seconds: float) -> Samples:
    """Frequencies at which lines near one are looked for, as near to each other as records of this length tell."""
    return np.linspace(f_Hz - SEARCH_Hz, f_Hz + SEARCH_Hz, 2 * int(4 * SEARCH_Hz * seconds) + 5)


def _new_lines(
    mains_Hz: float, train: Residuals, holdout: Residuals, reference: Residuals
) -> list[tuple[float, float]]:
    """Exact frequency and power (um^2) of the lines near one mains frequency; empty where they are not beyond chance
    or not larger than in the reference records."""
    longest_s = max(len(residual.error_um) / residual.rate_Hz for residual in train)
    grid = _frequencies_near(mains_Hz, longest_s)
    background = [_backgrounds(residual, mains_Hz) for residual in train]
    scores = np.array(
        [sum(_line_statistic(residual, f, b) for residual, b in zip(train, background, strict=True)) for f in grid]
    )
    f_Hz, score = float(grid[int(np.argmax(scores))]), float(scores.max())
    again = sum(_line_statistic(residual, f_Hz, _backgrounds(residual, f_Hz)) for residual in holdout)
    p = chi2.sf(score, 6 * len(train)) * len(grid)
    if p > FOUND or chi2.sf(again, 6 * len(holdout)) > FOUND_AGAIN:
        return []
    power = _line_power(train, f_Hz)
    return [] if power < NEW_FROM**2 * _line_power(reference, f_Hz) else [(f_Hz, power)]


def _line_statistic(residual: RunResidual, f_Hz: float, background: Sequence[float]) -> float:
    """Power of the three lines, each over the density around it: chi squared with six degrees of freedom."""
    pairs = zip(HARMONICS, background, strict=True)
    return float(sum(2 * _line(residual, h * f_Hz)[0] / max(b, 1e-300) for h, b in pairs))


def _line(residual: RunResidual, f_Hz: float) -> tuple[float, complex]:
    """Power of the periodogram at a frequency (um^2) and the complex amplitude (um), with phases in absolute time."""
    if f_Hz > 0.5 * residual.rate_Hz:
        return 0.0, 0j
    t = residual.run.t_s[residual.run.rows]
    n = len(t)
    window = np.hanning(n)
    raw = complex(np.sum(residual.error_um * window * np.exp(-2j * np.pi * f_Hz * t)))
    return abs(raw) ** 2 / float(np.sum(window**2)), 2 * raw / float(window.sum())


def _backgrounds(residual: RunResidual, f_Hz: float) -> list[float]:
    """Density of the noise around each of the three lines."""
    return [_background(residual, h * f_Hz) for h in HARMONICS]


def _background(residual: RunResidual, f_Hz: float) -> float:
    """Mean power of the periodogram around a line, the line itself left out."""
    width = 3.0 * residual.rate_Hz / len(residual.error_um)
    away = np.concatenate([np.linspace(-BACKGROUND_Hz, -width, 12), np.linspace(width, BACKGROUND_Hz, 12)])
    values = [_line(residual, f_Hz + d)[0] for d in away if 0 < f_Hz + d < 0.5 * residual.rate_Hz]
    return float(np.median(values)) / MEDIAN_OVER_MEAN if values else np.inf


def _line_power(part: Residuals, f_Hz: float) -> float:
    """Mean square (um^2) of the three lines together."""
    if not part:
        return 0.0
    return float(np.mean([sum(abs(_line(residual, h * f_Hz)[1]) ** 2 / 2 for h in HARMONICS) for residual in part]))


def _hum_params(train: Residuals, f_Hz: float) -> dict[str, Estimate]:
    """Sine and cosine part of each line, averaged over the records, with an interval from noise and scatter."""
    params: dict[str, Estimate] = {}
    for h in HARMONICS:
        amplitudes = np.array([_line(residual, h * f_Hz)[1] for residual in train])
        noise = float(
            np.mean([2 * np.sqrt(_background(residual, h * f_Hz) / len(residual.error_um)) for residual in train])
        )
        for name, values in ((f"sin{h}_um", -amplitudes.imag), (f"cos{h}_um", amplitudes.real)):
            value = float(values.mean())
            spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
            half = TWO_SIDED_95 * float(np.hypot(spread, noise)) / np.sqrt(len(values))
            params[name] = (value, "um", (value - half, value + half))
    resolution = 0.2 / max(float(residual.run.t_s[-1] - residual.run.t_s[0]) for residual in train)
    params["f_Hz"] = (f_Hz, "Hz", (f_Hz - resolution, f_Hz + resolution))
    return params
