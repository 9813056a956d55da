"""Sampling jitter: fast noise that grows with the square of the speed."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from phaselead.gap.disturbance import HOLDOUT_CHANCE, NEW_FROM, TRAIN_CHANCE, Disturbance
from phaselead.gap.records import Run
from phaselead.gap.residual import RunResidual
from phaselead.gap.result import Value
from phaselead.record import Samples

LATEST = 0.05
"""Of the sampling step: a clock that is off by more is no clock, and what grows with speed is a fault of the model."""
SEEN_Z, UNALIKE, TELLING = 2.0, 2.5, 0.05
"""From where the reference's own slope counts; the factor by which a record's slope may be off where what it says is
more than the last share of the record's whole residual."""
SHORTEST, BLOCK_ROWS = 256, 64
ROUGH, ROUGHER = 4, 7
"""Differences that are taken to be rid of what a model misses of its modes."""
WHITE = 1.3
"""The factor by which the slopes at the two may differ: a clock's noise is white, what a model misses is not."""
JUMP_SHARE, AFTER_JUMP_ROWS = 0.02, 40
"""Of the voltage's range, in one row; and for how long a fast mode rings."""


def jitter(
    train: Sequence[RunResidual], holdout: Sequence[RunResidual], reference: Sequence[RunResidual]
) -> Disturbance | None:
    """Fast white noise whose variance grows with the square of the speed, more than in the reference."""
    if not reference:
        return None
    slope, std = _speed_slope(train)
    known, known_std = _speed_slope(reference)
    known = max(known, 0.0)
    again, again_std = _speed_slope(holdout)
    z, z_again = (
        (found - known) / max(float(np.hypot(own, known_std)), 1e-300)
        for found, own in ((slope, std), (again, again_std))
    )
    seen = (train, slope), (holdout, again)
    if norm.sf(z) > TRAIN_CHANCE or norm.sf(z_again) > HOLDOUT_CHANCE:
        return None
    if not all(found / WHITE < _speed_slope(part, ROUGHER)[0] < found * WHITE for part, found in seen):
        return None
    # What a model misses grows with the speed too, on some records more than on others: a clock does on all alike.
    if not all(_alike(part, slope) for part, _ in seen):
        return None
    each = [_speed_slope([left]) for left in reference]
    before = max([known, *(one for one, one_std in each if one > SEEN_Z * one_std)])
    if slope < NEW_FROM**2 * before:
        return None
    rms = float(np.sqrt(slope - known))
    if rms > LATEST * train[0].run.step_s:
        return None
    half = min(1.96 / z, 1.0)
    params: dict[str, Value] = {"rms_s": (rms, "s", (rms * np.sqrt(1 - half), rms * np.sqrt(1 + half)))}
    speed = float(np.mean([np.mean(left.speed_um_per_s**2) for left in train]))
    return Disturbance("sampling_jitter", params, rms**2 * speed, f"fast noise of {1e6 * rms:.3g} us times the speed")


def _alike(part: Sequence[RunResidual], slope: float) -> bool:
    """Whether each record that is fast enough to know has about this slope."""
    knowing = [left for left in part if slope * _fastest(left) > TELLING * float(np.mean(left.error_um**2))]
    return all(slope / UNALIKE < _speed_slope([left])[0] < slope * UNALIKE for left in knowing)


def _fastest(left: RunResidual) -> float:
    """(um/s)^2 in the fastest tenth of the rows that count."""
    blocks = _rough_and_speed(left, ROUGH)
    return float(np.quantile(blocks[1], 0.9)) if blocks is not None else 0.0


def _rough_and_speed(left: RunResidual, order: int) -> tuple[Samples, Samples] | None:
    """Fast variance of the residual, um^2, and mean squared speed, (um/s)^2, of blocks (b,); None of a short record."""
    if not left.run.driven or len(left.error_um) < SHORTEST:
        return None
    rough = np.diff(left.error_um, order) ** 2 / comb(2 * order, order)
    v2 = np.convolve(left.speed_um_per_s**2, np.ones(order + 1) / (order + 1), "valid")
    known = ~_after_jump(left.run)[order:]
    count = int(known.sum()) // BLOCK_ROWS
    if count < 2:
        return None
    rough, v2 = (values[known][: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS).mean(axis=1) for values in (rough, v2))
    return rough, v2


def _after_jump(run: Run) -> NDArray[np.bool_]:
    """Scored rows (n,) in which a model that is wrong by a fraction of a row is rough too."""
    u = run.u_V[run.rows]
    steps = np.abs(np.diff(u, prepend=u[0]))
    jumped = steps > max(JUMP_SHARE * float(np.ptp(run.u_V)), 5 * float(np.quantile(steps, 0.9)))
    return np.convolve(jumped, np.ones(AFTER_JUMP_ROWS))[: len(u)] > 0


def _speed_slope(part: Sequence[RunResidual], order: int = ROUGH) -> tuple[float, float]:
    """s^2 of fast residual variance per squared speed, and its deviation."""
    blocks = [found for found in (_rough_and_speed(left, order) for left in part) if found is not None]
    if not blocks:
        return 0.0, 0.0
    y, x = (np.concatenate(values) for values in zip(*blocks, strict=True))
    if np.ptp(x) == 0:
        return 0.0, 0.0
    # A block's variance of 64 rows is known to a share of itself: weigh by what the first line says.
    weights = 1 / (np.median(y) + np.polyval(np.polyfit(x, y, 1), x).clip(min=0)) ** 2
    mean = np.average(x, weights=weights)
    spread = float(np.sum(weights * (x - mean) ** 2))
    slope = float(np.sum(weights * (x - mean) * y)) / spread
    left_over = y - np.average(y, weights=weights) - slope * (x - mean)
    std = float(np.sqrt(np.sum((weights * (x - mean) * left_over) ** 2))) / spread
    return slope, std
