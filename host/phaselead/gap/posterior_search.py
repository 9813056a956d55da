"""The search of one axis with reference records: the posterior over sets of effects, as a selection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.acceptance import Named, held_out_score
from phaselead.gap.comparison import Rival
from phaselead.gap.findings import NAMED, Candidate
from phaselead.gap.posterior import Claim, Contest, Judgement, judge, search_sets
from phaselead.gap.posterior.interval import intervals
from phaselead.gap.problem import Problem, make_problem, with_effects
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted, SizedEffect, squares_left, with_total
from phaselead.gap.search import Progress, Selection
from phaselead.model import AxisModel, Effect

SHOWN_SETS = 12
"""Sets in the table of candidates."""


def select_by_posterior(
    axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], on_progress: Progress
) -> Selection:
    """The effects that are there, by their posterior probability. There are reference runs; the base has plays."""
    problem = make_problem(axis, runs, effects, frozen=True)
    contest = search_sets(problem, effects, lambda share: on_progress(0.1 + 0.9 * share))
    found = judge(contest)
    claimed = {name for claim in found.claims for name in claim.tied}
    entries = tuple(entry for entry in found.best.entries if entry[0].name in claimed)
    after = with_effects(problem, entries) if entries else problem
    selection = Selection(after, axis, _fitted(after, entries), candidates=_candidates(contest, found))
    selection.named = [_named(problem, after, contest, found, claim, entries) for claim in found.claims]
    selection.probability = dict(found.probability)
    if entries:
        values = intervals(entries, contest.solver.spread(entries))
        selection.estimates = {effect.name: one for (effect, _), one in zip(entries, values, strict=True)}
    return selection


def _fitted(problem: Problem, entries: tuple[SizedEffect, ...]) -> Fitted:
    """The effects as they are."""
    return Fitted(entries, squares_left(problem.train_common, problem.discrepancy, entries))


def _named(
    problem: Problem,
    after: Problem,
    contest: Contest,
    found: Judgement,
    claim: Claim,
    entries: tuple[SizedEffect, ...],
) -> Named:
    """A claim with what held-out records show of it and with its rivals."""
    before = [entry for entry in entries if entry[0].name != claim.effect.name]
    held = held_out_score(problem, before, entries)
    rivals = [_rival(after, contest, found, claim, name) for name in claim.tied]
    return Named(claim.effect, 2 * claim.log_odds, held, tuple(r for r in rivals if r is not None), claim.tied)


def _rival(problem: Problem, contest: Contest, found: Judgement, claim: Claim, name: str) -> Rival | None:
    """A member of a tie in the most probable set that has it and none of the others."""
    others = set(claim.tied) - {name}
    sets = [names for names in found.sets if name in names and not others & set(names)]
    if not sets:
        return None
    best = max(sets, key=lambda names: found.sets[names])
    entries = sorted(contest.fits[best].entries, key=lambda entry: entry[0].name == name)
    fitted = with_total(problem.train_common, _fitted(problem, tuple(entries)))
    without = [names for names in found.sets if name not in names]
    odds = np.log(max(found.sets[best], 1e-300)) - np.log(max(*(found.sets[n] for n in without), 1e-300))
    return Rival(entries[-1][0], fitted, 2 * float(odds), 0.0)


def _candidates(contest: Contest, found: Judgement) -> list[Candidate]:
    """The sets of the contest, the most probable first, and how they did."""
    ranked = sorted(contest.fits.items(), key=lambda pair: -found.sets[pair[0]])[:SHOWN_SETS]
    best = ranked[0][1].log_evidence
    result = []
    for names, fit in ranked:
        if not names:
            continue
        behind = best - fit.log_evidence
        remark = NAMED if behind == 0 and found.claims else f"{behind:.1f} log units behind the best set"
        nothing = contest.fits[()].log_evidence
        result.append(Candidate(len(names), " + ".join(names), 2 * (fit.log_evidence - nothing), np.nan, np.nan, remark))
    return result
