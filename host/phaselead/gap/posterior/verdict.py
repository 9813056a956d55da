"""From the evidences of sets to probabilities of effects, and from these to names and ties.

A set may explain more than any other and still leave more than its equations may miss. Then its effects are only the
nearest, and count as not there. What counts are the names that a set bears: a loop that does not open, and yet takes
travel off, is a change of gain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phaselead.gap.error_rates import INSIDE, SURE, TWO_SIDED_95
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.contest import WITHIN, Contest
from phaselead.gap.posterior.interval import deviation_of, names_borne
from phaselead.gap.posterior.sets import Fit, Names, confused
from phaselead.model import Effect, Mode

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
    borne: Mapping[Names, frozenset[str]]
    """The names that each set bears."""
    nearest_only: float
    """Probability that no set is there: the nearest leaves more than its equations may miss."""
    in_place: tuple[str, ...] = ()
    """Names of effects of the most probable set that may be in the place of a mode that the model has."""

    @property
    def something_unnamed(self) -> bool:
        """Whether something is there, beside what is claimed, that no name is sure to be."""
        claimed = {name for claim in self.claims for name in claim.tied}
        more = 1 - sum(p for names, p in self.sets.items() if claimed.issuperset(self.borne[names]))
        return more > (SURE if claimed else INSIDE)


def judge(contest: Contest, nameless: AbstractSet[str] = frozenset(), modes: Sequence[Mode] = ()) -> Judgement:
    """Names and ties: an effect that is sure is named, the smallest group of rivals that is sure together is tied, and
    what is sure but may be a part of another effect is tied with that. Neither where the nearest set is probably no
    more than that. Effects that are ``nameless`` are no part of another. ``modes``: those that the model has; an effect
    that is in the place of one is tied with what changes such a mode, and has no name where that was not looked at.
    """
    sets = _Sets.of(contest)
    best = sets.best
    nearest_only = 1 - sum(p * contest.fits[names].named for names, p in sets.probability.items())
    effects = {effect.name: effect for fit in contest.fits.values() for effect, _ in fit.entries}
    claims, in_place = [], []
    for effect, params in contest.fits[best].entries:
        rivals = {n: other for n, other in effects.items() if n not in best and confused(effect, other)}
        claim = _claim(sets, effect, rivals)
        if claim is None or nearest_only > MORE_LIKELY_THAN_NOT:
            continue
        changed = _changed(contest.fits[best], effect, modes)
        if changed is not None:
            in_place.append(effect.name)
            if changed not in contest.names:
                continue
        whole = _whole(contest, effect, params) if effect.name not in nameless else None
        for other in filter(None, (changed, whole)):
            claim = _tied_with(sets, claim, other, best)
        claims.append(claim)
    return Judgement(
        contest.fits[best], tuple(claims), sets.single, sets.probability, sets.borne, nearest_only, tuple(in_place)
    )


@dataclass(frozen=True)
class _Sets:
    """The sets of a contest."""

    contest: Contest
    probability: Mapping[Names, float]
    """Of each."""
    borne: Mapping[Names, frozenset[str]]
    """The names that each bears."""

    @classmethod
    def of(cls, contest: Contest) -> _Sets:
        """All of a contest."""
        logs = {names: contest.log_posterior(names) for names in contest.fits}
        top = max(logs.values())
        weights = {names: float(np.exp(log - top)) for names, log in logs.items()}
        total = sum(weights.values())
        borne = {names: names_borne(fit) for names, fit in contest.fits.items()}
        return cls(contest, {names: weight / total for names, weight in weights.items()}, borne)

    @property
    def best(self) -> Names:
        """The most probable one; in place of one that bears other names than those of its effects the set of these, if
        it is not so far behind that it says something else, nor behind nothing."""
        most_probable = max(self.probability, key=self.probability.__getitem__)
        of_its_names = tuple(sorted(self.borne[most_probable]))
        least = max(self.probability[most_probable] * np.exp(-WITHIN), self.probability[()])
        return of_its_names if self.probability.get(of_its_names, 0.0) > least else most_probable

    @cached_property
    def single(self) -> dict[str, float]:
        """Probability of every effect that one of them has, by name."""
        every = dict.fromkeys(name for names in self.probability for name in names)
        return {name: self.with_any((name,)) for name in every}

    def with_any(self, group: Names) -> float:
        """Probability that at least one of some effects is there."""
        return min(1.0, sum((p for names, p in self.probability.items() if self.borne[names] & set(group)), 0.0))

    def log_odds(self, group: Names, log_posterior: Callable[[Names], float]) -> float:
        """Of the best set with any of a group against the best without."""
        logs = {True: -np.inf, False: -np.inf}
        for names, borne in self.borne.items():
            there = bool(borne & set(group))
            logs[there] = max(logs[there], log_posterior(names))
        return float(logs[True] - logs[False])

    def best_fitted(self, name: str) -> float:
        """Log posterior, without the held-out records, of the best set with an effect."""
        with_it = [names for names, borne in self.borne.items() if name in borne]
        return max(map(self.contest.log_posterior_fitted, with_it), default=-np.inf)

    def most_probable_with(self, name: str, group: Names) -> tuple[SizedEffect, ...]:
        """The most probable set with one of a group and none of the others, its entry last; empty without one."""
        allowed = [names for names, borne in self.borne.items() if name in names and borne & set(group) == {name}]
        if not allowed:
            return ()
        entries = self.contest.fits[max(allowed, key=self.probability.__getitem__)].entries
        return tuple(sorted(entries, key=lambda entry: entry[0].name == name))


def _claim(sets: _Sets, effect: Effect, rivals: Mapping[str, Effect]) -> Claim | None:
    """That an effect is there, or one of the smallest group of it and its rivals of which that is sure, and which the
    records that were fitted speak for by themselves. Only what may be taken for the effect can stand in its place.

    A group that is not sure grows by the rival that makes it surest, one that is sure but not borne out by the rival
    that the fitted records prefer.
    """
    single = sets.single

    def claimed(group: Names) -> Claim | None:
        if sets.with_any(group) < SURE:
            return None
        claim = _claim_of(sets, effect, group)
        return claim if claim.borne_out else None

    group: Names = (effect.name,)
    while (claim := claimed(group)) is None:
        more = [name for name in single if name in rivals and name not in group]
        if not more or len(group) == MOST_TIED:
            return None
        if sets.with_any(group) >= SURE:
            group = (*group, max(more, key=sets.best_fitted))
        else:
            surest = {name: (sets.with_any((*group, name)), single[name]) for name in more}
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


def _changed(fit: Fit, effect: Effect, modes: Sequence[Mode]) -> str | None:
    """The effect that changes one of the ``modes`` of the model, where one of a set may be in the place of such a mode;
    None where it surely is not, and where the set has that effect beside it."""
    in_place = effect.in_place_of
    if in_place is None or not modes or in_place.effect in fit.names:
        return None

    def apart(entries: Sequence[SizedEffect]) -> float:
        return in_place.apart(next(params for one, params in entries if one.name == effect.name), modes)

    off, deviation = apart(fit.entries), deviation_of(apart, fit)
    told = math.isfinite(off) and math.isfinite(deviation)
    return in_place.effect if told and abs(off) <= TWO_SIDED_95 * deviation else None


def _tied_with(sets: _Sets, claim: Claim, name: str, best: Names) -> Claim:
    """The claim that an effect, or one more, is there; the claim itself where that is one of the best set, or tied with
    it already, or the tie is full."""
    if name in claim.tied or name in best or len(claim.tied) == MOST_TIED:
        return claim
    tied = (*claim.tied, name)
    return replace(claim, rivals=_rivals(sets, tied), tied=tied)


def _claim_of(sets: _Sets, effect: Effect, group: Names) -> Claim:
    """The claim that one of a group is there."""
    odds = sets.log_odds(group, sets.contest.log_posterior)
    fitted = sets.log_odds(group, sets.contest.log_posterior_fitted)
    return Claim(effect, sets.with_any((effect.name,)), odds, odds - fitted, _rivals(sets, group), group)


def _rivals(sets: _Sets, tied: Names) -> tuple[tuple[SizedEffect, ...], ...]:
    """One set for each of those that are tied, if there is one."""
    return tuple(entries for name in tied if (entries := sets.most_probable_with(name, tied)))
