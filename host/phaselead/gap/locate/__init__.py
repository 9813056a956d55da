"""Where the residual lies: its power in cells, which of them stand out, and a sentence about each."""

from __future__ import annotations

from phaselead.gap.locate.ranking import axis_cells, rank_cells
from phaselead.gap.locate.sentences import excludes, headline, percent, three_digits, typical_of, unit_of

__all__ = [
    "axis_cells",
    "excludes",
    "headline",
    "percent",
    "rank_cells",
    "three_digits",
    "typical_of",
    "unit_of",
]
