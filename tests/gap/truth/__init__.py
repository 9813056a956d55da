"""Stages with something hidden in them, for blind trials of the gap workflow.

Shares no code and no model family with the package: what it takes from it is the form of a recording. Each module says
what its truths are. ``phaselead gap campaign --truth tests/gap/truth`` runs it; `docs/gap-campaign.md` has the protocol
that any such folder follows.
"""

from .cases import KINDS, SETS, SIZES, Case, Hidden, case, cases

__all__ = ["KINDS", "SETS", "SIZES", "Case", "Hidden", "case", "cases"]
