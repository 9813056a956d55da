"""Another lab's stages with something hidden in them: generator B of the blind trials.

Shares no code and no model family with the package, nor with the generator in ``truth``: what it takes from the package
is the form of a recording. ``phaselead gap campaign --truth tests/gap/truth_b`` runs it; `docs/gap-campaign.md` says
how it differs. Nothing is tuned on it.
"""

from .cases import KINDS, SETS, Case, Hidden, case, cases

__all__ = ["KINDS", "SETS", "Case", "Hidden", "case", "cases"]
