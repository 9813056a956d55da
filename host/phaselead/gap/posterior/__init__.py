"""Which effects are there, as one posterior over sets of them: evidence, beam search, probabilities, intervals. Beside
it fits of effects by themselves, in um."""

from __future__ import annotations

from phaselead.gap.posterior.blocks import levels_say
from phaselead.gap.posterior.contest import Contest, at_an_end, likelihood_of, search_sets
from phaselead.gap.posterior.detectable import MOST_STATED
from phaselead.gap.posterior.equation_misfit import LEAST_OF_MATERIAL, MOST_MISSED, TIMES_BASE
from phaselead.gap.posterior.forecast import Forecast
from phaselead.gap.posterior.interval import intervals, intervals_alone, posteriors, shows_itself
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.plain_fits import each_fitted
from phaselead.gap.posterior.priors import KNOWN_BEFORE
from phaselead.gap.posterior.sets import Fit, confused, goes_on_between_records, names_of
from phaselead.gap.posterior.starts import SizedGroup
from phaselead.gap.posterior.verdict import MORE_LIKELY_THAN_NOT, MOST_TIED, Claim, Judgement, judge

__all__ = [
    "KNOWN_BEFORE",
    "LEAST_OF_MATERIAL",
    "MORE_LIKELY_THAN_NOT",
    "MOST_MISSED",
    "MOST_STATED",
    "MOST_TIED",
    "TIMES_BASE",
    "Claim",
    "Contest",
    "Fit",
    "Forecast",
    "Judgement",
    "Likelihood",
    "SizedGroup",
    "at_an_end",
    "confused",
    "each_fitted",
    "goes_on_between_records",
    "intervals",
    "intervals_alone",
    "judge",
    "levels_say",
    "likelihood_of",
    "names_of",
    "posteriors",
    "search_sets",
    "shows_itself",
]
