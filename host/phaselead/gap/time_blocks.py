"""Blocks of time into which records are cut, so long that what is found in one hardly depends on the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

BLOCK_s = 0.25
"""Shortest wish for a block; where the drive repeats more slowly, its period is."""
FEWEST_BLOCKS = 24
"""Over all records, before blocks are made shorter than wished: fewer do not tell how a score scatters."""
SHORTEST_BLOCK_ROWS = 64
"""Several times longer than a sensor's noise remembers."""


def wanted_rows(step_s: float, period_rows: int | None) -> int:
    """Rows of BLOCK_s, or of a period of the drive where that is longer."""
    return max(round(BLOCK_s / step_s), period_rows or 0)


def block_edges(rows: Sequence[int], wanted: int) -> list[list[int]]:
    """Edges of blocks of about ``wanted`` rows in series of these lengths, shorter where that leaves too few in all."""
    total = sum(rows)
    length = max(SHORTEST_BLOCK_ROWS, min(wanted, total // FEWEST_BLOCKS))
    edges = []
    for n in rows:
        count = max(1, round(n / length))
        edges.append(np.linspace(0, n, count + 1).astype(int).tolist())
    return edges
