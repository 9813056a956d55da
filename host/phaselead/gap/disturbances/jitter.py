"""Sampling jitter: white noise whose variance grows with the square of the speed."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Residuals
from phaselead.gap.error_rates import FOUND, FOUND_AGAIN, TWO_SIDED_95
from phaselead.gap.findings import Estimate
from phaselead.gap.records import GapRun
from phaselead.gap.residual import RunResidual
from phaselead.record import Samples

LATEST = 0.05
"""Largest jitter, as a share of the sampling step. Noise that would take more is a fault of the model."""
SEEN_Z = 2.0
"""Significance from which a slope that the reference itself shows counts."""
SAME_SLOPE = 2.5
"""Largest factor between the slope of one record and that of all: a clock treats all records alike."""
LEAST_JITTER_SHARE = 0.05
"""Of a record's residual, that jitter must explain before the record's own slope is asked for."""
SHORTEST, BLOCK_ROWS = 256, 64
DIFFERENCES, MORE_DIFFERENCES = 4, 7
"""Order of the differences that remove the slow part of the residual, which the model's modes may leave."""
WHITE = 1.3
"""Largest factor between the slopes at the two orders: the noise of a clock is white, what a model misses is not."""
ABRUPT_SHARE, AFTER_ABRUPT_ROWS = 0.02, 40
"""A change of the voltage in one row, as a share of its range, that counts as a jump, and the rows left out after it:
a fast mode rings that long."""


def find_jitter(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """White noise that grows with speed more than in the reference records, as the effect ``name``; None where there
    is none."""
    slope, std = _speed_slope(train)
    known, known_std = _speed_slope(reference)
    known = max(known, 0.0)
    again, again_std = _speed_slope(holdout)
    z, z_again = (
        (found - known) / max(float(np.hypot(own, known_std)), 1e-300)
        for found, own in ((slope, std), (again, again_std))
    )
    seen = (train, slope), (holdout, again)
    if norm.sf(z) > FOUND or norm.sf(z_again) > FOUND_AGAIN:
        return None
    if not all(found / WHITE < _speed_slope(part, MORE_DIFFERENCES)[0] < found * WHITE for part, found in seen):
        return None
    # What a model misses grows with speed too, but more on some records than on others.
    if not all(_alike(part, slope) for part, _ in seen):
        return None
    each = [_speed_slope([residual]) for residual in reference]
    before = max([known, *(one for one, one_std in each if one > SEEN_Z * one_std)])
    if slope < NEW_FROM**2 * before:
        return None
    rms = float(np.sqrt(slope - known))
    if rms > LATEST * train[0].run.step_s:
        return None
    half = min(TWO_SIDED_95 / z, 1.0)
    params: dict[str, Estimate] = {"rms_s": (rms, "s", (rms * np.sqrt(1 - half), rms * np.sqrt(1 + half)))}
    speed = float(np.mean([np.mean(residual.speed_um_per_s**2) for residual in train]))
    return Disturbance(name, params, rms**2 * speed, f"fast noise of {1e6 * rms:.3g} us times the speed")


def _alike(part: Residuals, slope: float) -> bool:
    """Whether every record that is fast enough to tell has about this slope."""
    telling = [
        residual
        for residual in part
        if slope * _fastest(residual) > LEAST_JITTER_SHARE * float(np.mean(residual.error_um**2))
    ]
    return all(slope / SAME_SLOPE < _speed_slope([residual])[0] < slope * SAME_SLOPE for residual in telling)


def _fastest(residual: RunResidual) -> float:
    """Squared speed, (um/s)^2, that a tenth of the blocks of a record exceed."""
    blocks = _noise_and_speed(residual, DIFFERENCES)
    return float(np.quantile(blocks[1], 0.9)) if blocks is not None else 0.0


def _noise_and_speed(residual: RunResidual, order: int) -> tuple[Samples, Samples] | None:
    """Variance of the fast noise (um^2) and mean squared speed, (um/s)^2, of the blocks (b,) of a record.

    None for a record at rest or one that is too short.
    """
    if not residual.run.driven or len(residual.error_um) < SHORTEST:
        return None
    noise = np.diff(residual.error_um, order) ** 2 / comb(2 * order, order)
    v2 = np.convolve(residual.speed_um_per_s**2, np.ones(order + 1) / (order + 1), "valid")
    known = ~_after_jump(residual.run)[order:]
    count = int(known.sum()) // BLOCK_ROWS
    if count < 2:
        return None
    noise, v2 = (values[known][: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS).mean(axis=1) for values in (noise, v2))
    return noise, v2


def _after_jump(run: GapRun) -> NDArray[np.bool_]:
    """Whether each scored row (n,) comes soon after a jump, where a delay of a fraction of a row looks like noise."""
    u = run.u_V[run.rows]
    steps = np.abs(np.diff(u, prepend=u[0]))
    jumped = steps > max(ABRUPT_SHARE * float(np.ptp(run.u_V)), 5 * float(np.quantile(steps, 0.9)))
    return np.convolve(jumped, np.ones(AFTER_ABRUPT_ROWS))[: len(u)] > 0


def _speed_slope(part: Residuals, order: int = DIFFERENCES) -> tuple[float, float]:
    """Variance of the fast noise per squared speed (s^2), fitted over all blocks, and its standard deviation."""
    blocks = [found for found in (_noise_and_speed(residual, order) for residual in part) if found is not None]
    if not blocks:
        return 0.0, 0.0
    y, x = (np.concatenate(values) for values in zip(*blocks, strict=True))
    if np.ptp(x) == 0:
        return 0.0, 0.0
    # The variance of a block is known to a fixed share of itself, so its weight is the inverse square of a first fit.
    weights = 1 / (np.median(y) + np.polyval(np.polyfit(x, y, 1), x).clip(min=0)) ** 2
    mean = np.average(x, weights=weights)
    spread = float(np.sum(weights * (x - mean) ** 2))
    slope = float(np.sum(weights * (x - mean) * y)) / spread
    left_over = y - np.average(y, weights=weights) - slope * (x - mean)
    std = float(np.sqrt(np.sum((weights * (x - mean) * left_over) ** 2))) / spread
    return slope, std
