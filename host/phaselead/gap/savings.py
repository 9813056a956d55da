"""What one model saves of the squares of another on the same runs, block by block, and whether that is chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.residual import ModelledRun
from phaselead.gap.time_blocks import block_edges, wanted_rows
from phaselead.record import Samples


def squares_by_block(
    before: Sequence[ModelledRun],
    before_with: Sequence[SizedEffect],
    after: Sequence[ModelledRun],
    after_with: Sequence[SizedEffect],
) -> tuple[Samples, Samples]:
    """Squares in um^2 (blocks,) that the runs leave under a model with some effects, and under another, each about its
    own mean."""
    edges = block_edges(
        [t.run.stop - t.run.start for t in before], max(wanted_rows(t.run.step_s, t.period_rows) for t in before)
    )

    def squares(runs: Sequence[ModelledRun], entries: Sequence[SizedEffect]) -> Samples:
        pairs = zip(runs, edges, strict=True)
        return np.concatenate([np.add.reduceat(one.error_about_mean(entries) ** 2, e[:-1]) for one, e in pairs])

    return squares(before, before_with), squares(after, after_with)


def saved_by_block(
    before: Sequence[ModelledRun],
    before_with: Sequence[SizedEffect],
    after: Sequence[ModelledRun],
    after_with: Sequence[SizedEffect],
) -> Samples:
    """Squares in um^2 (blocks,) that the second model saves of those that the first leaves."""
    was, now = squares_by_block(before, before_with, after, after_with)
    return was - now


def shares_saved(was: Samples, now: Samples) -> Samples:
    """What (blocks,) is saved where squares (blocks,) become others, as a share of both together: 1 is all, -1 as much
    lost. Each block says as much as the others then, also where one record holds nearly all of the squares."""
    both = was + now
    return np.divide(was - now, both, out=np.zeros_like(both), where=both > 0)


def probability_by_chance(saved: Samples) -> float:
    """Probability of so large a mean over blocks (m,) where none is saved: Student's t of the paired differences."""
    if len(saved) < 2:
        return 1.0
    mean, spread = float(saved.mean()), float(saved.std(ddof=1))
    if not spread > 0:
        return 0.0 if mean > 0 else 1.0
    return float(t_distribution.sf(mean / spread * np.sqrt(len(saved)), len(saved) - 1))
