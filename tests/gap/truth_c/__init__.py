"""A third lab's stages with something hidden in them: generator C of the blind trials.

Written from `docs/gap-campaign.md` and `docs/effects.md` alone. It shares no code with the package nor with the
generators in ``truth`` and ``truth_b``; what it takes from the package is the form of a recording. This lab sweeps and
scans: chirps, rasters, stairs, smooth random paths and sines that are on no common grid, from a place that may be
mid-range, with loops before a session that no record shows. Nothing is tuned on it.
"""

from .cases import KINDS, SETS, Case, Hidden, case, cases

__all__ = ["KINDS", "SETS", "Case", "Hidden", "case", "cases"]
