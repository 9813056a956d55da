"""Where the residual lies: its power in cells, which of them stand out, and a sentence about each."""

from __future__ import annotations

from phaselead.gap.locate.ranking import axis_cells, rank_cells
from phaselead.gap.locate.sentences import excludes, explained, headline, typical_of, unit_of

__all__ = [
    "axis_cells",
    "excludes",
    "explained",
    "headline",
    "rank_cells",
    "typical_of",
    "unit_of",
]
