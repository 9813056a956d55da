"""Which effects are there, as one posterior over sets of them: evidence, beam search, probabilities, intervals."""

from __future__ import annotations

from phaselead.gap.posterior.search import Contest, search_sets
from phaselead.gap.posterior.verdict import Claim, Judgement, judge

__all__ = ["Claim", "Contest", "Judgement", "judge", "search_sets"]
