"""From the evidences of sets to probabilities of effects, and from these to names and ties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phaselead.gap.posterior.evidence import SetFit
from phaselead.gap.posterior.priors import log_prior_of_set
from phaselead.gap.posterior.search import Contest, Names
from phaselead.model import Effect

SURE = 0.99
"""Probability from which an effect is named, and from which a tie holds the truth: one error in a hundred."""
MOST_TIED = 5
"""Names in a tie: more say nothing."""


@dataclass(frozen=True)
class Claim:
    """One effect that is there, or one of several that cannot be told apart."""

    effect: Effect
    """The most probable."""
    probability: float
    log_odds: float
    """Of the most probable set against the best without any of ``tied``."""
    tied: Names
    """Names that these records cannot tell apart, its own first."""


@dataclass(frozen=True)
class Judgement:
    """What the contest says."""

    best: SetFit
    """The most probable set."""
    claims: tuple[Claim, ...]
    probability: Mapping[str, float]
    """Of each effect that was in the contest, by name."""
    sets: Mapping[Names, float]
    """Probability of each set."""


def judge(contest: Contest) -> Judgement:
    """Names and ties: an effect that is sure is named, the smallest group of rivals that is sure together is tied."""
    sets = _probabilities(contest)
    best = max(sets, key=lambda names: sets[names])
    single = {name: _with_any(sets, (name,)) for names in sets for name in names}
    claims = [claim for effect, _ in contest.fits[best].entries if (claim := _claim(effect, best, sets, single))]
    return Judgement(contest.fits[best], tuple(claims), single, sets)


def _probabilities(contest: Contest) -> dict[Names, float]:
    """Of every set in the contest."""
    logs = {n: f.log_evidence + log_prior_of_set(len(n), contest.catalogue_size) for n, f in contest.fits.items()}
    top = max(logs.values())
    weights = {names: float(np.exp(log - top)) for names, log in logs.items()}
    total = sum(weights.values())
    return {names: weight / total for names, weight in weights.items()}


def _with_any(sets: Mapping[Names, float], names: Names) -> float:
    """Probability that at least one of some effects is there."""
    return min(1.0, sum(p for members, p in sets.items() if set(members) & set(names)))


def _claim(effect: Effect, best: Names, sets: Mapping[Names, float], single: Mapping[str, float]) -> Claim | None:
    """What can be said of one effect of the best set; None where no small group is sure."""
    group: Names = (effect.name,)
    while _with_any(sets, group) < SURE and len(group) < MOST_TIED:
        gains = {n: _with_any(sets, (*group, n)) for n in single if n not in best and n not in group}
        if not gains:
            break
        group = (*group, max(gains, key=lambda n: gains[n]))
    if (together := _with_any(sets, group)) < SURE:
        return None
    odds = np.log(max(together, 1e-300)) - np.log(max(1 - together, 1e-300))
    return Claim(effect, single[effect.name], float(odds), group)
