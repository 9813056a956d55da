"""Records in which the axes of a stage move together: the modes that the axes share, and what couples them."""

from __future__ import annotations

from phaselead.gap.several_axes.joint_search import search_together

__all__ = ["search_together"]
