"""Which sets of effects are worth comparing: a beam search over sets, each effect begun from several shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phaselead.gap.base_refit import base_columns
from phaselead.gap.error_rates import SURE
from phaselead.gap.history import LEAST_STANDING, stands_off
from phaselead.gap.parameters import SizedEffect, stands_at_an_end
from phaselead.gap.posterior.blocks import blocked
from phaselead.gap.posterior.detectable import detectable
from phaselead.gap.posterior.levels import zeros_of_sessions
from phaselead.gap.posterior.likeliest import Start
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.noise_and_base_share import noise_and_base_share_of
from phaselead.gap.posterior.priors import log_prior_of_set
from phaselead.gap.posterior.sets import Begun, Fit, Names, confused, has_history, names_of
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect

BEAM, LARGEST_SET, TRIED_BESIDE, TRIED_ALONE = 2, 4, 4, 9
"""Sets that grow at a time, the most effects of one, and how many effects are tried beside a set and alone: what the
time for an answer allows."""
ROUGH_STEPS, ROUGH_GAIN = 2, 0.5
"""Steps in which every start is tried before the best is fitted, and log units of a step that end that: the last
contest fits to the end."""
WITHIN, MOST_CONTESTED = 15.0, 12
"""Log units behind the best set, beyond which a set has no part in the last contest (a probability of e^-15), and the
most sets in it."""
EXCHANGES = 3
"""Times at most that each effect of the best set is replaced by each that it may be taken for."""
CONTESTS = 3
"""Contests at most until the winner is one whose misfit all sets were given before."""


@dataclass(frozen=True)
class Contest:
    """Sets of effects beside one base."""

    likelihood: Likelihood
    fits: Mapping[Names, Fit]
    starts: Starts
    """Of all effects that were looked at."""
    detectable: Mapping[str, float] = field(default_factory=dict)
    """First size, in its unit, that each effect must have for a name to be expected, stated without what the records
    show."""

    @property
    def names(self) -> set[str]:
        """Of all effects that were looked at, or that stand in one of its sets."""
        return {effect.name for effect in self.starts.effects} | {name for names in self.fits for name in names}

    def log_evidence(self, names: Names) -> float:
        """Of a set. Where records stand speaks neither for nor against effects that go on between them, as nobody
        knows how: a set of such is granted as much as that brings to the most probable of the others, so that the two
        are compared by what the records hold."""
        fit = self.fits[names]
        return fit.log_evidence + self._granted(fit, held_out=True)

    def log_posterior(self, names: Names) -> float:
        """Log evidence and log prior of a set."""
        return self.log_evidence(names) + log_prior_of_set(len(names), len(self.starts.effects))

    def log_posterior_fitted(self, names: Names) -> float:
        """The same without the held-out records."""
        fit = self.fits[names]
        log_evidence = fit.log_evidence_fitted + self._granted(fit, held_out=False)
        return log_evidence + log_prior_of_set(len(names), len(self.starts.effects))

    def _granted(self, fit: Fit, *, held_out: bool) -> float:
        if not has_history(fit.entries):
            return 0.0
        others = [one for one in self.fits.values() if not has_history(one.entries)]
        if not others:
            return -fit.levels(held_out)
        log_posterior = self.log_posterior if held_out else self.log_posterior_fitted
        return max(others, key=lambda one: log_posterior(one.names)).levels(held_out) - fit.levels(held_out)


def likelihood_of(runs: Sequence[ModelledRun], base_may_be_off: bool = False, open_plays: bool = False) -> Likelihood:
    """Of what effects do in the runs that are no reference. ``base_may_be_off``: its gain, plays and bends, as far as
    no reference record holds them. ``open_plays``: these were fitted to the training records."""
    every = blocked(runs)
    zeros = zeros_of_sessions(every)
    sessions = zeros[0].shape[1]
    of_no_session = (lambda run: np.zeros((run.edges[-1], sessions)),)  # as any further run is
    likelihood = Likelihood(tuple(every), noise_and_base_share_of(every), tuple(zeros), of_no_session)
    if not base_may_be_off:
        return likelihood
    likelihood = likelihood.missing(lambda run: run.coefficients(base_columns(run.modelled, open_plays)))
    return likelihood.missing_beyond()


def search_sets(likelihood: Likelihood, effects: Sequence[Effect], on_progress: Callable[[float], None]) -> Contest:
    """The sets of ``effects`` that are worth comparing, and nothing. Where reference records say what the base misses,
    any effect that explains much by itself may be what the base lacks in all records."""
    nothing = likelihood.fit(())
    starts = Starts(likelihood, effects)
    alone = _beside(starts, nothing, TRIED_ALONE)
    needed = log_prior_of_set(0, len(effects)) - log_prior_of_set(1, len(effects)) + np.log(SURE / (1 - SURE))
    least = detectable(likelihood, starts.shapes, needed)
    on_progress(0.3)
    likelihood = likelihood.knowing([fit.entries[0] for fit in alone])
    nothing, alone = likelihood.fit(()), [likelihood.fit(fit.begun) for fit in alone]
    starts = starts.of(likelihood)
    pool = {fit.names: fit for fit in [nothing, *alone]}
    contest = Contest(likelihood, pool, starts)
    frontier = _better(contest, alone, contest.log_posterior(()))
    for size in range(1, LARGEST_SET):
        on_progress(0.3 + 0.6 * size / LARGEST_SET)
        grown = [fit for parent in frontier for fit in _beside(starts, parent, TRIED_BESIDE)]
        for fit in grown:
            if fit.names not in pool or fit.log_evidence > pool[fit.names].log_evidence:
                pool[fit.names] = fit
        frontier = _better(contest, grown, max((contest.log_posterior(fit.names) for fit in frontier), default=0.0))
    exchange(starts, pool)
    return replace(_last_contest(starts, pool), detectable=least)


def _better(contest: Contest, fits: Sequence[Fit], than: float) -> list[Fit]:
    """The best sets, of those that are more probable than what they grew from."""
    better = {fit.names: contest.fits[fit.names] for fit in fits if contest.log_posterior(fit.names) > than}
    return sorted(better.values(), key=lambda fit: -contest.log_posterior(fit.names))[:BEAM]


def _beside(starts: Starts, parent: Fit, most: int) -> list[Fit]:
    """Sets of one effect more, of those that are expected to bring what the prior asks for one more."""
    size, catalogue_size = len(parent.names), len(starts.effects)
    if size == catalogue_size:
        return []
    asked = log_prior_of_set(size, catalogue_size) - log_prior_of_set(size + 1, catalogue_size)
    worth = [several for several in starts.beside(parent).values() if several[0].gain > asked]
    found = [_grown(starts.likelihood, parent, several) for several in worth[:most]]
    return [fit for fit in found if fit is not None]


def exchange(starts: Starts, pool: dict[Names, Fit]) -> None:
    """Add to a pool of sets, of the likelihood of ``starts``, its best with one effect replaced by each that this may
    be taken for, and again where one of these is better.

    A beam that has taken a rival for what is there grows from it and does not come back. Sets that are in the pool are
    not begun anew.
    """
    likelihood = starts.likelihood
    contest = Contest(likelihood, pool, starts)
    for _ in range(EXCHANGES):
        best = max(pool, key=contest.log_posterior)
        for i, (effect, _) in enumerate(pool[best].entries):
            begun = pool[best].begun_without(i)
            rivals = {one.name for one in starts.effects if one.name not in best and confused(effect, one)}
            rivals = {name for name in rivals if tuple(sorted((*names_of(begun.entries), name))) not in pool}
            if not rivals:
                continue
            rest = likelihood.fit(begun, least_gain=ROUGH_GAIN)
            for name, several in starts.beside(rest).items():
                fit = _grown(likelihood, rest, several) if name in rivals else None
                if fit is not None:
                    pool[fit.names] = fit
        if max(pool, key=contest.log_posterior) == best:
            break


def _grown(likelihood: Likelihood, parent: Fit, starts: Sequence[Start]) -> Fit | None:
    """A set and one effect more, from the best of its starts that stays within its range; None where none does."""
    rough = []
    for start in starts:
        begun = parent.begun.and_one(start.entry, start.is_over)
        try:
            terms, _, log_density = likelihood.fitted_terms(begun, ROUGH_STEPS, LEAST_STANDING)
        except np.linalg.LinAlgError:
            continue
        known = begun.moving_found and terms.moments.moving.size > 0
        rough.append((log_density, replace(terms.begun, moving_found=True) if known else terms))
    for _, begun_there in sorted(rough, key=lambda one: -one[0]):
        try:
            fit = likelihood.fit(begun_there, least_gain=ROUGH_GAIN)
        except np.linalg.LinAlgError:
            continue
        if not at_an_end(fit.entries):
            return fit
    return None


def _last_contest(starts: Starts, pool: Mapping[Names, Fit]) -> Contest:
    """Nothing, the sets that are not far behind the best, and the best less one of its effects each, or with one
    exchanged for what it may be taken for, once more: now any effect of theirs, as it is beside the others, may be what
    the base lacks, and what the equations of the winner miss may look like its rivals. A winner that was far behind
    before is given the same company."""
    contest = Contest(starts.likelihood, pool, starts)
    ranked = sorted(pool, key=lambda names: -contest.log_posterior(names))
    least = contest.log_posterior(ranked[0]) - WITHIN
    close = [pool[names] for names in ranked[:MOST_CONTESTED] if contest.log_posterior(names) > least]
    begun: dict[Names, list[Begun]] = {(): [Begun(())], **{fit.names: [fit.begun] for fit in close}}
    seen = {effect.name: (effect, params) for fit in reversed(close) for effect, params in fit.entries}
    known = starts.likelihood.known
    likelihood = starts.likelihood.knowing([entry for entry in seen.values() if entry not in known])
    best, tried = close[0], set[Names]()
    while best.names not in tried and len(tried) < CONTESTS:
        tried.add(best.names)
        for i in range(len(best.entries)):
            rest = best.begun_without(i)
            names = names_of(rest.entries)
            less = begun.setdefault(names, [pool[names].begun] if names in pool else [])
            if rest.entries:  # a set that grew in one way may have missed what another way leads to
                less.append(rest)
            begun = {**{fit.names: [fit.begun] for fit in _exchanged(pool, best.entries, i)}, **begun}
        among = _beyond_beside(likelihood.with_misfit_of(best.entries), contest)
        fits = {names: _fitted(among, several) for names, several in begun.items()}
        contest = Contest(among, fits, starts)
        begun = {names: [fit.begun] for names, fit in fits.items()}
        best = max(contest.fits.values(), key=lambda fit: contest.log_posterior(fit.names))
    return contest


def _beyond_beside(likelihood: Likelihood, contest: Contest) -> Likelihood:
    """The same likelihood, where the base may be off over the voltages to which the likeliest set with a leak, or what
    else has a past like a voltage, drives the ceramic; unchanged where no set has one."""
    moving = [fit for fit in contest.fits.values() if any(stands_off(effect) for effect, _ in fit.entries)]
    if not moving or likelihood.beyond is None:
        return likelihood
    likeliest = max(moving, key=lambda fit: contest.log_posterior(fit.names))
    return likelihood.missing_beyond(likeliest.entries, likeliest.terms.stood)


def _fitted(likelihood: Likelihood, starts: Sequence[Begun]) -> Fit:
    """A set fitted from the start that is the most likely before."""
    if len(starts) == 1:
        return likelihood.fit(starts[0])
    return likelihood.fit(max(starts, key=lambda one: likelihood.fitted_terms(one, 0)[2]))


def _exchanged(pool: Mapping[Names, Fit], entries: Sequence[SizedEffect], index: int) -> list[Fit]:
    """Sets of a pool that have, in the place of one of the effects, another that it may be taken for."""
    rest = {effect.name for i, (effect, _) in enumerate(entries) if i != index}
    found = []
    for names, fit in pool.items():
        others = [effect for effect, _ in fit.entries if effect.name not in rest]
        if len(names) == len(entries) and len(others) == 1 and confused(entries[index][0], others[0]):
            found.append(fit)
    return found


def at_an_end(entries: Sequence[SizedEffect]) -> bool:
    """Whether a parameter of one of the effects stands at an end of its range beyond which no stage lies, where it is
    no longer that effect: an end of 0 is where it vanishes or takes another form."""
    return any(
        stands_at_an_end(p, params[p.name])
        for effect, params in entries
        for p in effect.parameters
        if not p.between_forms
    )
