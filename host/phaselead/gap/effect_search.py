"""The search of one axis: its memory first, where the base has none, then the posterior over sets of effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phaselead.gap.base_operator import find_memory
from phaselead.gap.best_prediction import best_predicting
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import NAMED, NOT_NAMED, Candidate, Estimate, Posterior
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import (
    Claim,
    Contest,
    Fit,
    Judgement,
    Likelihood,
    at_an_end,
    goes_on_between_records,
    intervals,
    judge,
    likelihood_of,
    posteriors,
    search_sets,
    shows_itself,
)
from phaselead.gap.records import GapRun
from phaselead.gap.residual import base_modes, modelled_run
from phaselead.gap.savings import probability_by_chance, saved_by_block
from phaselead.gap.selection import Selection, with_a_name
from phaselead.model import AxisModel, Effect

SHOWN_SETS = 12
"""Sets in the table of candidates."""

Progress = Callable[[float], None]
"""Takes the share that is done, 0 to 1."""


def select_effects(
    axis: AxisModel,
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    nameless: Sequence[Effect],
    frozen: bool,
    on_progress: Progress,
) -> Selection:
    """The effects of ``effects`` that are there. The base ``axis`` has a time view.

    ``frozen``: without reference runs, whether nothing may be wrong with the base; reference runs say by themselves
    what may. A base without plays is given its memory first, where that explains most.

    ``nameless``: effects that change what the base has, and so cannot be told from a base that was wrong. They compete
    like any other, so that no rival gets the name in their place, and may be in a tie; what they alone explain has no
    name.
    """
    base, memory = find_memory(axis, runs, effects)
    on_progress(0.1)
    left = [effect for effect in effects if memory is None or effect.name != memory.effect.name]
    referenced = any(run.role == "reference" for run in runs)
    of_runs = [modelled_run(base, run) for run in runs]
    # Where references do not move a play or a bend of the base, a difference there may be the base's.
    likelihood = likelihood_of(of_runs, base_may_be_off=referenced or not frozen, open_plays=memory is not None)
    contest = search_sets(likelihood, [*left, *nameless], lambda share: on_progress(0.1 + 0.9 * share))
    names = frozenset(effect.name for effect in nameless)
    judgement = judge(contest, names, base_modes(base))
    claims, found = _estimated(contest, judgement, open_plays=memory is not None)
    # Where every claim was withdrawn, what it was for is still there.
    judged = replace(judgement, claims=with_a_name(judgement.claims, names) if claims else ())
    all_named = with_a_name(claims, names) == claims
    return Selection(
        base=base,
        start=axis,
        entries=found.entries,
        contest=contest,
        found=claims,
        nameless=names,
        probability=judgement.probability,
        something_unnamed=judged.something_unnamed,
        estimates=found.intervals,
        posteriors=found.posteriors,
        candidates=_candidates(contest, replace(judgement, claims=claims if all_named else ())),
        memory=memory,
        in_place=judgement.in_place,
    )


@dataclass(frozen=True)
class _Estimated:
    """Effects with the parameters that predict best."""

    entries: tuple[SizedEffect, ...] = ()
    intervals: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    """Of each parameter, by effect."""
    posteriors: Mapping[str, Posterior] = field(default_factory=dict)
    """Of these, by effect."""


def _estimated(contest: Contest, judgement: Judgement, open_plays: bool) -> tuple[tuple[Claim, ...], _Estimated]:
    """The claims that do not harm, are of some size and at no end of what is known, and their effects with the
    parameters that predict best.

    What is adopted is learned without the held-out records, so that these may judge it. Where the base's plays move
    with every effect (``open_plays``), they say nothing before these are fitted anew.
    """
    claims = judgement.claims
    everything, learned = contest.likelihood, contest.likelihood.without_held_out()

    def best_of(fit: Fit) -> tuple[SizedEffect, ...]:
        train = [run for run in everything.runs if run.modelled.run.role == "train"]
        levelled = [run.levelled for run in train]
        return best_predicting(fit.entries, fit.covariance, [run.modelled for run in train], levelled)

    while claims:
        entries = tuple(
            entry for entry in judgement.best.entries if entry[0].name in {claim.effect.name for claim in claims}
        )
        kept = claims if open_plays else _that_pay(everything, best_of(everything.fit(entries)), claims)
        if len(kept) == len(claims):
            fit = learned.fit(entries)
            adopted = best_of(fit)
            values = intervals(fit.entries, fit.covariance, adopted)
            shown = shows_itself(fit.entries, fit.covariance, adopted)
            pairs = zip(adopted, shown, strict=True)
            no_name = {entry[0].name for entry, one in pairs if not one or at_an_end([entry])}
            kept = tuple(claim for claim in claims if len(claim.tied) > 1 or claim.effect.name not in no_name)
            if len(kept) == len(claims):
                names = [effect.name for effect, _ in adopted]
                told = posteriors(fit.entries, fit.covariance)
                return claims, _Estimated(
                    adopted, dict(zip(names, values, strict=True)), dict(zip(names, told, strict=True))
                )
        claims = kept
    return (), _Estimated()


def _that_pay(likelihood: Likelihood, entries: Sequence[SizedEffect], claims: Sequence[Claim]) -> tuple[Claim, ...]:
    """The claims without which the held-out records are not predicted better than with them. Better is less in um; for
    what goes on between records it is the odds, and for what moves the zero, where levels say something, the odds with
    these."""
    kept, levelled = list(claims), any(run.levelled for run in likelihood.runs)
    held = [run.modelled for run in likelihood.runs if run.modelled.run.role == "holdout"]
    for claim in claims:
        names = {one.effect.name for one in kept}
        tried = [entry for entry in entries if entry[0].name in names]
        without = [entry for entry in tried if entry[0].name != claim.effect.name]
        if goes_on_between_records(claim.effect):
            # What it had done before a held-out record is unknown, and integrated out of the odds.
            worse = claim.held_out_log_odds < np.log(ERROR_RATE)
        elif levelled and claim.effect.moves_zero is not None:
            gained = likelihood.held_out_log_density(tried) - likelihood.held_out_log_density(without)
            worse = gained < np.log(ERROR_RATE)
        else:
            worse = probability_by_chance(saved_by_block(held, tried, held, without)) < ERROR_RATE
        if worse:
            kept.remove(claim)
    return tuple(kept)


def _candidates(contest: Contest, found: Judgement) -> tuple[Candidate, ...]:
    """The sets of the contest, the best first and then the most probable, and how they did."""
    ranked = sorted(contest.fits, key=lambda names: (names != found.best.names, -found.sets[names]))[:SHOWN_SETS]
    leader, nothing = max(ranked, key=contest.log_posterior), contest.log_evidence(())
    first, rows = "the most probable set" if leader else "nothing", []
    for names in filter(None, ranked):
        remark = f"log odds {contest.log_posterior(leader) - contest.log_posterior(names):.1f} behind {first}"
        if names == found.best.names:
            remark = NAMED if found.claims else NOT_NAMED
        elif found.borne[names] != set(names):
            remark = f"counts as {' + '.join(sorted(found.borne[names]))}"
        rows.append(Candidate(len(names), " + ".join(names), contest.log_evidence(names) - nothing, remark))
    return tuple(rows)
