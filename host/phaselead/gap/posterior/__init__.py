"""Which effects are there, as one posterior over sets of them: evidence, beam search, probabilities, intervals."""

from __future__ import annotations

from phaselead.gap.posterior.interval import intervals
from phaselead.gap.posterior.search import Contest, search_sets
from phaselead.gap.posterior.verdict import Claim, Judgement, judge

__all__ = ["Claim", "Contest", "Judgement", "intervals", "judge", "search_sets"]
