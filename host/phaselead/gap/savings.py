"""What one model saves of the squares of another on the same runs, block by block, and whether that is chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.residual import ModelledRun
from phaselead.gap.time_blocks import block_edges, wanted_rows
from phaselead.record import Samples


def saved_by_block(
    before: Sequence[ModelledRun],
    before_with: Sequence[SizedEffect],
    after: Sequence[ModelledRun],
    after_with: Sequence[SizedEffect],
) -> Samples:
    """Squares in um^2 (blocks,) that the runs under a model with some effects save of the same under another, each
    about its own mean."""
    edges = block_edges(
        [t.run.stop - t.run.start for t in before], max(wanted_rows(t.run.step_s, t.period_rows) for t in before)
    )
    pairs = zip(before, after, edges, strict=True)
    parts = [
        np.add.reduceat(a.error_about_mean(before_with) ** 2 - b.error_about_mean(after_with) ** 2, e[:-1])
        for a, b, e in pairs
    ]
    return np.concatenate(parts)


def probability_by_chance(saved: Samples) -> float:
    """Probability of so large a mean over blocks (m,) where none is saved: Student's t of the paired differences."""
    spread = float(saved.std(ddof=1)) if len(saved) > 1 else 0.0
    if not spread > 0:
        return 1.0
    return float(t_distribution.sf(float(saved.mean()) / spread * np.sqrt(len(saved)), len(saved) - 1))
