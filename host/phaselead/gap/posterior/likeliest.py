"""How much of the columns of a group, an effect at one shape, is the likeliest to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.gap.parameters import SizedEffect, bounded
from phaselead.gap.posterior.priors import LARGEST
from phaselead.gap.regressors import RegressorGroup, typical_sizes
from phaselead.record import Samples

APART = 2.0
"""Ratio of a size to that at which it was simulated, up to which another of ``SIZES`` is no nearer."""
LEAST_POWER = 1e-6
"""Precision of a size, in squares of a typical one, below which the records say nothing of it."""
TAIL_STEPS = 5
"""In which the most likely amount in the tails of the prior is found."""


@dataclass(frozen=True)
class Likeliest:
    """The likeliest amounts of the columns of a group."""

    entry: SizedEffect
    """The effect at these sizes, within its range."""
    amounts: Samples
    """(sizes and histories,)"""
    gain: float
    """Log units that they bring."""
    log_volume: float
    """The part of that for which the width of the amounts of histories stands; 0 where they are over."""
    of_size: bool
    """Whether the group was simulated at about these sizes, as far as that matters."""
    is_over: bool
    """Whether what the effect had done before is taken to be over in all records."""


def likeliest_amounts(
    group: RegressorGroup, slope: Samples, curvature: Samples, with_tails: bool = True
) -> list[Likeliest]:
    """The likeliest where what the effect had done before the records is over in all of them, and behind that, if there
    is anything, where it goes on in all of them. ``slope`` and ``curvature`` of the log density are over the sizes and
    the histories; ``with_tails``: sizes that are linear may be far out in the tails of their prior."""
    sizes, unit = len(group.steps), in_typical_sizes(group)
    far_out = with_tails and group.effect.basis is not None
    amounts, gain = _likeliest(slope[:sizes], curvature[:sizes, :sizes], unit, far_out)
    entry, amounts, gain = _within_range(group, slope[:sizes], curvature[:sizes, :sizes], amounts, gain)
    over = np.append(amounts, np.zeros(len(slope) - sizes))
    found = [Likeliest(entry, over, gain, 0.0, _of_size(group, amounts), True)]
    if len(slope) > sizes:
        alone = _SizesAlone.of(slope, curvature, sizes)
        amounts, gain = _likeliest(alone.slope, alone.curvature, unit, far_out)
        entry, amounts, gain = _within_range(group, alone.slope, alone.curvature, amounts, gain)
        going_on = np.append(amounts, alone.histories(amounts))
        found.append(Likeliest(entry, going_on, gain + alone.gain, alone.log_volume, _of_size(group, amounts), False))
    return found


def _within_range(
    group: RegressorGroup, slope: Samples, curvature: Samples, amounts: Samples, gain: float
) -> tuple[SizedEffect, Samples, float]:
    """The effect with amounts (sizes,) that its range allows, these amounts, and what they bring: a rail that would be
    pushed outwards brings nothing."""
    effect = group.effect
    entry = effect, bounded(effect, group.params(amounts.tolist()))
    within = np.array([entry[1][p.name] for p in effect.sizes]) / group.steps
    if np.allclose(within, amounts):
        return entry, amounts, gain
    return entry, within, min(gain, float(slope @ within - 0.5 * within @ curvature @ within))


def _of_size(group: RegressorGroup, amounts: Samples) -> bool:
    return group.effect.basis is not None or bool(1 / APART <= np.abs(amounts).max() <= APART)


@dataclass(frozen=True)
class _SizesAlone:
    """What is told of sizes where the amounts of histories, of a prior deviation of 1, are integrated out."""

    slope: Samples
    """(sizes,)"""
    curvature: Samples
    """(sizes, sizes)"""
    gain: float
    """Log units that the amounts bring by themselves."""
    log_volume: float
    by_themselves: Samples
    """(h,) amounts, and by how much they change with the sizes, (h, sizes)."""
    with_sizes: Samples

    @classmethod
    def of(cls, slope: Samples, curvature: Samples, sizes: int) -> _SizesAlone:
        """From slope and curvature over the sizes and what is behind them."""
        precision = curvature[sizes:, sizes:] + np.eye(len(slope) - sizes)
        right = np.column_stack([slope[sizes:], curvature[sizes:, :sizes]])
        across: Samples = np.asarray(np.linalg.solve(precision, right), dtype=np.float64)
        log_volume = -0.5 * float(np.linalg.slogdet(precision)[1])
        left = curvature[:sizes, sizes:] @ across
        return cls(
            slope[:sizes] - left[:, 0], curvature[:sizes, :sizes] - left[:, 1:],
            0.5 * float(slope[sizes:] @ across[:, 0]) + log_volume, log_volume, across[:, 0], across[:, 1:],
        )  # fmt: skip

    def histories(self, sizes: Samples) -> Samples:
        """(h,) where the sizes are these."""
        return np.asarray(self.by_themselves - self.with_sizes @ sizes)


def _likeliest(slope: Samples, curvature: Samples, unit: float, far_out: bool) -> tuple[Samples, float]:
    """Amounts (sizes,) in steps of so many typical sizes, and the log units that they bring: the most likely within the
    usual sizes or, if asked (``far_out``), in the tails of their prior, where that brings more: records that an effect
    of many times its size makes outliers say little of it."""
    diagonal = np.eye(len(slope)) * unit**2
    near: Samples = np.asarray(np.linalg.solve(curvature + diagonal / LARGEST**2, slope), np.float64)
    gain = 0.5 * float(slope @ near)
    if not far_out:
        return near, gain
    far: Samples = np.asarray(np.linalg.solve(curvature + diagonal * LEAST_POWER, slope), np.float64)
    for _ in range(TAIL_STEPS):
        far[:] = np.linalg.solve(curvature + 2 * diagonal / (LARGEST**2 + (far * unit) ** 2), slope)
    out = float(slope @ far - 0.5 * far @ curvature @ far - np.log1p((far * unit / LARGEST) ** 2).sum())
    return (far, out) if out > gain else (near, gain)


def in_typical_sizes(group: RegressorGroup) -> float:
    """A step of a shape, which is as many typical sizes for each of its sizes."""
    return group.steps[0] / typical_sizes(group.effect)[0]
