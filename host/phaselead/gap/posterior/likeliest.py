"""How much of the columns of a group, an effect at one shape, is the likeliest to first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.priors import LARGEST
from phaselead.gap.regressors import RegressorGroup, typical_sizes
from phaselead.record import Samples

APART = 2.0
"""Within this factor of the size that was simulated, a start counts as simulated at its own size: ``SIZES`` are factors
of 2.5 to 4 apart."""
LEAST_POWER = 1e-6
"""Precision of a size, in squares of a typical one, below which the records say nothing of it."""
TAIL_STEPS = 5
"""In which the most likely amount in the tails of the prior is found."""


@dataclass(frozen=True, eq=False)
class Start:
    """An effect at a shape, with the amounts of its columns that are the likeliest: where a fit may begin."""

    entry: SizedEffect
    """The effect at these sizes, within its range."""
    amounts: Samples
    """(sizes and histories,)"""
    gain: float
    """Log units that it is expected to bring."""
    log_volume: float
    """The part of that for which the width of the amounts of histories stands; 0 where they are over."""
    of_size: bool
    """Whether the group was simulated at about these sizes, as far as that matters."""
    is_over: bool
    """Whether what the effect had done before is taken to be over in all records."""


def likeliest_amounts(
    group: RegressorGroup, slope: Samples, curvature: Samples, with_tails: bool = True
) -> list[Start]:
    """The likeliest where what the effect had done before the records is over in all of them, and behind that, if there
    is anything, where it goes on in all of them. ``slope`` and ``curvature`` of the log density are over the sizes and
    the histories; ``with_tails``: sizes that are linear may be far out in the tails of their prior."""
    sizes, unit = len(group.steps), in_typical_sizes(group)
    far_out = with_tails and group.effect.basis is not None

    def best(slope: Samples, curvature: Samples) -> tuple[SizedEffect, Samples, float]:
        amounts, gain = _likeliest(slope, curvature, unit, far_out)
        return _within_range(group, slope, curvature, amounts, gain)

    entry, amounts, gain = best(slope[:sizes], curvature[:sizes, :sizes])
    over = np.append(amounts, np.zeros(len(slope) - sizes))
    found = [Start(entry, over, gain, 0.0, _of_size(group, amounts), True)]
    if len(slope) > sizes:
        # What is told of the sizes where the amounts of histories, of a prior deviation of 1, are integrated out.
        precision = curvature[sizes:, sizes:] + np.eye(len(slope) - sizes)
        right = np.column_stack([slope[sizes:], curvature[sizes:, :sizes]])
        across: Samples = np.asarray(np.linalg.solve(precision, right), dtype=np.float64)
        log_volume = -0.5 * float(np.linalg.slogdet(precision)[1])
        left = curvature[:sizes, sizes:] @ across
        entry, amounts, gain = best(slope[:sizes] - left[:, 0], curvature[:sizes, :sizes] - left[:, 1:])
        gain += 0.5 * float(slope[sizes:] @ across[:, 0]) + log_volume
        going_on = np.append(amounts, across[:, 0] - across[:, 1:] @ amounts)
        found.append(Start(entry, going_on, gain, log_volume, _of_size(group, amounts), False))
    return found


def _within_range(
    group: RegressorGroup, slope: Samples, curvature: Samples, amounts: Samples, gain: float
) -> tuple[SizedEffect, Samples, float]:
    """The effect with amounts (sizes,) that its range allows, these amounts, and what they bring: a rail that would be
    pushed outwards brings nothing."""
    entry = group.entry(amounts.tolist())
    within = np.array([entry[1][p.name] for p in group.effect.sizes]) / group.steps
    if np.allclose(within, amounts):
        return entry, amounts, gain
    return entry, within, min(gain, float(slope @ within - 0.5 * within @ curvature @ within))


def _of_size(group: RegressorGroup, amounts: Samples) -> bool:
    return group.effect.basis is not None or bool(1 / APART <= np.abs(amounts).max() <= APART)


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
