"""From the evidences of sets to probabilities of effects, and from these to names and ties.

A set may explain more than any other and still leave more than its equations may miss. Then its effects are only the
nearest, and count as not there."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from phaselead.gap.error_rates import INSIDE, SURE
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.search import Contest
from phaselead.gap.posterior.sets import Fit, Names, confused
from phaselead.model import Effect

MORE_LIKELY_THAN_NOT = 0.5
"""Probability from which the nearest set is no more than that, and names nothing."""
MOST_TIED = 5
"""Names in a tie: more say nothing."""


@dataclass(frozen=True)
class Claim:
    """One effect that is there, or one of several that cannot be told apart."""

    effect: Effect
    """The member of ``tied`` that the most probable set of all has."""
    probability: float
    log_odds: float
    """Of the most probable set against the best without any of ``tied``."""
    held_out_log_odds: float
    """What the held-out records add to those of the training records, whose best sets may be others."""
    rivals: tuple[tuple[SizedEffect, ...], ...]
    """One set of effects for each of ``tied``: the most probable one that has this member and none of the others, with
    the entry of the member last. A member that no such set has is left out."""
    tied: Names
    """Names that these records cannot tell apart, its own first."""

    @property
    def borne_out(self) -> bool:
        """Whether the records that were fitted speak for it by themselves."""
        return self.log_odds > self.held_out_log_odds


@dataclass(frozen=True)
class Judgement:
    """What the contest says."""

    best: Fit
    """The most probable set."""
    claims: tuple[Claim, ...]
    probability: Mapping[str, float]
    """Of each effect that was in the contest, by name."""
    sets: Mapping[Names, float]
    """Probability of each set."""
    nearest_only: float
    """Probability that no set is there: the nearest leaves more than its equations may miss."""

    @property
    def something_unnamed(self) -> bool:
        """Whether something is there, beside what is claimed, that no name is sure to be."""
        claimed = {name for claim in self.claims for name in claim.tied}
        more = 1 - sum(p for names, p in self.sets.items() if claimed.issuperset(names))
        return more > (SURE if claimed else INSIDE)


def judge(contest: Contest, nameless: AbstractSet[str] = frozenset()) -> Judgement:
    """Names and ties: an effect that is sure is named, the smallest group of rivals that is sure together is tied, and
    what is sure but may be a part of another effect is tied with that. Neither where the nearest set is probably no
    more than that. Effects that are ``nameless`` are no part of another.
    """
    sets = _probabilities(contest)
    best = max(sets, key=lambda names: sets[names])
    single = {name: _with_any(sets, (name,)) for names in sets for name in names}
    nearest_only = 1 - sum(probability * contest.fits[names].named for names, probability in sets.items())
    effects = {effect.name: effect for fit in contest.fits.values() for effect, _ in fit.entries}
    claims = []
    for effect, params in contest.fits[best].entries:
        rivals = {n: other for n, other in effects.items() if n not in best and confused(effect, other)}
        claim = _claim(contest, effect, rivals, sets, single)
        if claim is not None and nearest_only <= MORE_LIKELY_THAN_NOT:
            whole = _whole(contest, effect, params) if effect.name not in nameless else None
            claims.append(claim if whole is None else _tied_with(contest, claim, whole, best, sets))
    return Judgement(contest.fits[best], tuple(claims), single, sets, nearest_only)


def _probabilities(contest: Contest) -> dict[Names, float]:
    """Of every set in the contest."""
    logs = {names: contest.log_posterior(names) for names in contest.fits}
    top = max(logs.values())
    weights = {names: float(np.exp(log - top)) for names, log in logs.items()}
    total = sum(weights.values())
    return {names: weight / total for names, weight in weights.items()}


def _with_any(sets: Mapping[Names, float], names: Names) -> float:
    """Probability that at least one of some effects is there."""
    return min(1.0, sum(p for members, p in sets.items() if set(members) & set(names)))


def _claim(
    contest: Contest,
    effect: Effect,
    rivals: Mapping[str, Effect],
    sets: Mapping[Names, float],
    single: Mapping[str, float],
) -> Claim | None:
    """That an effect is there, or one of the smallest group of it and its rivals of which that is sure, and which the
    records that were fitted speak for by themselves. Only what may be taken for the effect can stand in its place.

    A group that is not sure grows by the rival that makes it surest, one that is sure but not borne out by the rival
    that the fitted records prefer.
    """

    def claimed(group: Names) -> Claim | None:
        claim = _claim_of(contest, effect, group, sets, single)
        return claim if _with_any(sets, group) >= SURE and claim.borne_out else None

    group: Names = (effect.name,)
    while (claim := claimed(group)) is None:
        more = [name for name in single if name in rivals and name not in group]
        if not more or len(group) == MOST_TIED:
            return None
        if _with_any(sets, group) >= SURE:
            group = (*group, max(more, key=partial(_best_fitted, contest)))
        else:
            surest = {name: (_with_any(sets, (*group, name)), single[name]) for name in more}
            group = (*group, max(more, key=surest.__getitem__))
    for name in sorted(group[1:], key=single.__getitem__):
        fewer = claimed(tuple(one for one in claim.tied if one != name))
        claim = claim if fewer is None else fewer
    return claim


def _whole(contest: Contest, effect: Effect, params: Mapping[str, float]) -> str | None:
    """The effect of which one of the best set may be a part, at its size; None where none is."""
    whole = effect.part_of
    if whole is None or whole.effect not in contest.names:
        return None
    return whole.effect if abs(params[effect.sizes[0].name]) <= whole.up_to else None


def _tied_with(contest: Contest, claim: Claim, name: str, best: Names, sets: Mapping[Names, float]) -> Claim:
    """The claim that an effect, or one more, is there; the claim itself where that is one of the best set, or tied with
    it already, or the tie is full."""
    if name in claim.tied or name in best or len(claim.tied) == MOST_TIED:
        return claim
    tied = (*claim.tied, name)
    rivals = [entries for one in tied if (entries := _most_probable_with(contest, one, tied, sets))]
    return replace(claim, rivals=tuple(rivals), tied=tied)


def _best_fitted(contest: Contest, name: str) -> float:
    """Log posterior, without the held-out records, of the best set with an effect."""
    return max(contest.log_posterior_fitted(names) for names in contest.fits if name in names)


def _claim_of(
    contest: Contest, effect: Effect, group: Names, sets: Mapping[Names, float], single: Mapping[str, float]
) -> Claim:
    """The claim that one of a group is there."""
    odds = _log_odds(group, {names: contest.log_posterior(names) for names in sets})
    fitted = _log_odds(group, {names: contest.log_posterior_fitted(names) for names in sets})
    rivals = [entries for name in group if (entries := _most_probable_with(contest, name, group, sets))]
    return Claim(effect, single[effect.name], odds, odds - fitted, tuple(rivals), group)


def _log_odds(group: Names, logs: Mapping[Names, float]) -> float:
    """Of the best set with any of a group against the best without, by the log posterior of each."""
    with_it = max(log for names, log in logs.items() if set(names) & set(group))
    return with_it - max(log for names, log in logs.items() if not set(names) & set(group))


def _most_probable_with(
    contest: Contest, name: str, group: Names, sets: Mapping[Names, float]
) -> tuple[SizedEffect, ...]:
    """The most probable set with one of a group and none of the others, its entry last; empty without one."""
    allowed = [names for names in sets if name in names and len(set(group) & set(names)) == 1]
    if not allowed:
        return ()
    entries = contest.fits[max(allowed, key=lambda names: sets[names])].entries
    return tuple(sorted(entries, key=lambda entry: entry[0].name == name))
