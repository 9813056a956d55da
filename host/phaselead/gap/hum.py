"""Mains hum: lines at the mains frequency and its multiples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from phaselead.gap.disturbance import HOLDOUT_CHANCE, NEW_FROM, TRAIN_CHANCE, Disturbance
from phaselead.gap.residual import RunResidual
from phaselead.gap.result import Value

MAINS_Hz = (50.0, 60.0)
WITHIN_Hz = 0.2
BESIDE_Hz = 6.0


def is_mains(f_Hz: float) -> bool:
    return any(abs(f_Hz - h * m) < 2.0 for m in MAINS_Hz for h in (1, 2, 3))


def hum(
    train: Sequence[RunResidual], holdout: Sequence[RunResidual], reference: Sequence[RunResidual]
) -> Disturbance | None:
    """Lines at the mains frequency: three harmonics at the frequency that explains most, over the noise beside them."""
    best: Disturbance | None = None
    for mains in MAINS_Hz:
        if 2.2 * mains > train[0].rate_Hz:
            continue
        longest_s = max(len(left.error_um) / left.rate_Hz for left in train)
        grid = np.linspace(mains - WITHIN_Hz, mains + WITHIN_Hz, 2 * int(4 * WITHIN_Hz * longest_s) + 5)
        beside = [[_beside(left, h * mains) for h in (1, 2, 3)] for left in train]
        scores = np.array(
            [sum(_line_statistic(left, f, b) for left, b in zip(train, beside, strict=True)) for f in grid]
        )
        f_Hz, score = float(grid[int(np.argmax(scores))]), float(scores.max())
        again = sum(_line_statistic(left, f_Hz, [_beside(left, h * f_Hz) for h in (1, 2, 3)]) for left in holdout)
        p = chi2.sf(score, 6 * len(train)) * len(grid)
        if p > TRAIN_CHANCE or chi2.sf(again, 6 * len(holdout)) > HOLDOUT_CHANCE:
            continue
        power = _line_power(train, f_Hz)
        if power < NEW_FROM**2 * _line_power(reference, f_Hz):
            continue
        if best is None or power > best.power_um2:
            why = f"lines at {f_Hz:.2f} Hz and multiples, {1e3 * np.sqrt(2 * power):.3g} nm, held-out records too"
            best = Disturbance("mains_hum", _hum_params(train, f_Hz), power, why)
    return best


def _line_statistic(left: RunResidual, f_Hz: float, beside: Sequence[float]) -> float:
    """Sum over three harmonics of line power over the mean density beside it: chi squared with six degrees."""
    return float(sum(2 * _line(left, h * f_Hz)[0] / max(b, 1e-300) for h, b in zip((1, 2, 3), beside, strict=True)))


def _line(left: RunResidual, f_Hz: float) -> tuple[float, complex]:
    """Periodogram ordinate |sum|^2/n at a frequency and the complex amplitude, absolute time."""
    if f_Hz > 0.5 * left.rate_Hz:
        return 0.0, 0j
    t = left.run.t_s[left.run.rows]
    n = len(t)
    window = np.hanning(n)
    raw = complex(np.sum(left.error_um * window * np.exp(-2j * np.pi * f_Hz * t)))
    return abs(raw) ** 2 / float(np.sum(window**2)), 2 * raw / float(window.sum())


def _beside(left: RunResidual, f_Hz: float) -> float:
    """Mean periodogram ordinate close by, the line itself left out."""
    width = 3.0 * left.rate_Hz / len(left.error_um)
    away = np.concatenate([np.linspace(-BESIDE_Hz, -width, 12), np.linspace(width, BESIDE_Hz, 12)])
    values = [_line(left, f_Hz + d)[0] for d in away if 0 < f_Hz + d < 0.5 * left.rate_Hz]
    return float(np.median(values)) / 0.693 if values else np.inf


def _line_power(part: Sequence[RunResidual], f_Hz: float) -> float:
    """Mean square in um^2 of the three lines."""
    if not part:
        return 0.0
    return float(np.mean([sum(abs(_line(left, h * f_Hz)[1]) ** 2 / 2 for h in (1, 2, 3)) for left in part]))


def _hum_params(train: Sequence[RunResidual], f_Hz: float) -> dict[str, Value]:
    """Sine and cosine parts of each line, averaged over the records with the scatter between them."""
    params: dict[str, Value] = {}
    for h in (1, 2, 3):
        amplitudes = np.array([_line(left, h * f_Hz)[1] for left in train])
        noise = float(np.mean([2 * np.sqrt(_beside(left, h * f_Hz) / len(left.error_um)) for left in train]))
        for name, values in ((f"sin{h}_um", -amplitudes.imag), (f"cos{h}_um", amplitudes.real)):
            value = float(values.mean())
            spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
            half = 1.96 * float(np.hypot(spread, noise)) / np.sqrt(len(values))
            params[name] = (value, "um", (value - half, value + half))
    resolution = 0.2 / max(float(left.run.t_s[-1] - left.run.t_s[0]) for left in train)
    params["f_Hz"] = (f_Hz, "Hz", (f_Hz - resolution, f_Hz + resolution))
    return params
