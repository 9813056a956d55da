"""Whether an effect is named: its score against what a name costs, its held-out score, and what references say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from phaselead.gap.comparison import MARGIN, Comparison, Rival, residual_amounts
from phaselead.gap.discrepancy import Discrepancy
from phaselead.gap.metric import Regressors
from phaselead.gap.problem import Problem
from phaselead.gap.refit import SizedEffect
from phaselead.gap.residual import ModelledRun
from phaselead.gap.scan import block_inflation, no_mode_of_its_own, projection
from phaselead.model import Effect

HELD_OUT_Z = 3.3
"""Standard deviations by which held-out records must show an effect: errors of 1 in 2000."""
FAMILY_RISK = 0.0125
"""Family-wise risk of a held-out test (Holm over the rest of the catalogue)."""
HELD_OUT_SLOPE = (0.4, 2.5)
"""Share of what an effect says that held-out records must show of it."""
UNTESTED_FACTOR = 10.0
"""Times the usual margin, for an effect that the held-out records lack the drive to show: a mode without a jump."""
NO_DRIVE_SHARE = 0.05
"""Of what an effect gains on training records: held-out records whose drive would show less of it lack that drive."""
MOST_HARM, CERTAIN_Z = 0.01, 10.0
"""An effect may raise the held-out mean square by this share and no more: a disturbance that is not there does. From
this z on it is there all the same."""
REFERENCE_SHOWS_SHARE, REFERENCE_SHOWS_Z = 0.8, 3.0
"""Share of an effect, and how surely, that makes reference records show it too."""
LEAST_UNABSORBED = 0.05
"""Share of an effect's squares that must be left once the base absorbed what it can, for that question to be asked."""
ALIKE_SHARE, UNLIKE_SHARE, OPERATOR_SHARE = 0.05, 0.0015, 0.02
"""Of what was gained before, what a further effect must gain, when it is confused with what was named, when it is not,
and when the name was a whole operator. No equation of the catalogue is the stage's own: what one that is right by and
large leaves is explained best by those it is confused with, and is no evidence for them; an operator leaves less."""
CLOSE_SHARE = 0.5
"""Of the score of what was named: an effect that explains this much by itself is alike, whatever the catalogue says."""
REFERENCE_MARGIN = 30.0
"""More points than the usual margin with reference records, which are believed to say all that the base misses: on
trials, of 14 names for less than 60 points in all 12 were wrong."""
NEGLIGIBLE = 0.005
"""Of its typical size, below which an effect is no more than what the base's own numbers are off by."""
NO_POWER = 1e-9
"""Whitened squares from which a regression on what an effect says means anything."""


@dataclass(frozen=True)
class HeldOutScore:
    """How much of what an effect adds is found in the held-out records: 1 is all of it."""

    slope: float
    """Share of it that the held-out records show."""
    z: float
    """The slope in its standard deviations."""
    power: float
    """The z that a slope of 1 would have: what the held-out records can show."""
    drive: float
    """Whitened squares of what the effect says there, whatever else the held-out records hold: how far the drive of
    these records shows it at all."""
    harm: float
    """Relative change of the held-out mean square in um^2 when the effect is added: positive is a larger residual."""

    @property
    def testable(self) -> bool:
        """Whether the held-out records could show it at all."""
        return self.power >= HELD_OUT_Z

    @property
    def contradicted(self) -> bool:
        """Whether they show that it is not there as the training records say."""
        return abs(self.z - self.power) > HELD_OUT_Z


def held_out_score(
    problem: Problem, before: Sequence[SizedEffect], after: Sequence[SizedEffect], least: float = 1.0
) -> HeldOutScore:
    """Regress the held-out residual on what the effects ``after`` add to those ``before``, all else projected out.

    The variance of the slope is inflated by ``least`` or more.
    """
    found = _regression(problem.holdout, problem.discrepancy, before, after)
    if not found.power > 0:
        return HeldOutScore(0.0, 0.0, 0.0, 0.0, 0.0)
    whole = float(np.sqrt(found.power / max(least, found.inflation)))
    return HeldOutScore(found.slope, found.slope * whole, whole, found.power, _harm(problem, before, after))


def _harm(problem: Problem, before: Sequence[SizedEffect], after: Sequence[SizedEffect]) -> float:
    """Relative change of the held-out mean square about each record's own mean. It is 0 where the base's plays move
    with every effect: before they are fitted anew, the residual says nothing about the effect."""
    if problem.open_plays:
        return 0.0
    was, now = (sum(_squares_about_mean(t, e) for t in problem.holdout.metric.modelled_runs) for e in (before, after))
    return now / was - 1 if was > 0 else 0.0


def _squares_about_mean(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> float:
    """Squares in um^2 of the residual of one run about its mean."""
    error = modelled.error(entries)
    return float(np.sum((error - error.mean()) ** 2))


def shown_by_reference(problem: Problem, new: SizedEffect) -> bool:
    """Whether the reference records seem to show the new effect too. They are without it, so it is then the base's
    fault.

    They are without whatever was named before it, too. Only what the base could absorb is projected out, since the
    discrepancy has learned from these very records. Of an effect that the base absorbs nearly whole, they can show
    nothing.
    """
    regressors = problem.reference
    if regressors is None:
        return False
    index = regressors.layout.base
    base = Discrepancy(index, np.zeros(len(index)), np.eye(len(index)))
    found = _regression(regressors, base, (), (new,))
    if found.power < LEAST_UNABSORBED * found.whole:
        return False
    z = found.slope * float(np.sqrt(found.power / found.inflation))
    return found.slope > REFERENCE_SHOWS_SHARE and z > REFERENCE_SHOWS_Z


class _ResidualShare(NamedTuple):
    """Of the residual of some runs on what a new effect says."""

    slope: float
    """Share of what it says that the residual shows."""
    power: float
    """Whitened squares of what it says, conditional on the discrepancy."""
    inflation: float
    """By how much more than white noise the residual scatters along it, at least 1."""
    whole: float
    """Whitened squares of what it says, unconditional."""


def _regression(
    regressors: Regressors,
    discrepancy: Discrepancy,
    before: Sequence[SizedEffect],
    after: Sequence[SizedEffect],
) -> _ResidualShare:
    """Regress the residual of the effects ``before`` on what those ``after`` add, conditional on the discrepancy."""
    fresh = []
    for modelled in regressors.metric.modelled_runs:
        was = modelled.answer(before)
        fresh.append(np.stack([modelled.answer(after) - was, modelled.run.x_um[modelled.run.rows] - was], axis=1))
    moments = regressors.with_columns(fresh)
    target = moments.shape[-1] - 1
    total = discrepancy.conditional(moments.sum(axis=0), target)
    power = float(total[target - 1, target - 1])
    whole = float(moments[:, target - 1, target - 1].sum())
    if not power > NO_POWER:
        return _ResidualShare(0.0, 0.0, 1.0, whole)
    slope = float(total[target - 1, target]) / power
    explained = np.zeros(len(total))
    explained[target - 1] = 1.0
    projector = projection(moments.sum(axis=0), discrepancy)
    left = residual_amounts(moments, discrepancy) - slope * (projector @ explained)
    squares_left = float(total[target, target]) - slope**2 * power
    scatter = float(block_inflation(moments, projector, left)[target - 1])
    return _ResidualShare(slope, power, max(1.0, squares_left / regressors.metric.rows, scatter), whole)


@dataclass(frozen=True)
class Named:
    """One effect that the search named."""

    effect: Effect
    score: float
    """In the comparison that it won."""
    held_out: HeldOutScore
    rivals: tuple[Rival, ...]
    """All that were compared there, itself first."""
    tied: tuple[str, ...]
    """Names that these records cannot tell apart, its own first."""
    alike_share: float = ALIKE_SHARE
    """Share of its score that effects it is confused with must gain to be named as well."""


def cost(named: Sequence[Named], effect: Effect) -> float:
    """Score from which a further effect is more than what the equations of those named before leave."""
    owed = [n.score * (n.alike_share if _alike(n, effect) else UNLIKE_SHARE) for n in named]
    return MARGIN + sum(owed)


def _needed(found: Comparison, named: Sequence[Named]) -> float:
    """Score that the best effect of a comparison needs to be named."""
    return cost(named, found.best.effect) + (REFERENCE_MARGIN if found.problem.reference is not None else 0.0)


def _alike(named: Named, effect: Effect) -> bool:
    """Whether an effect is confused with one that was named, or explained nearly as much in its place."""
    rivals = {r.effect.name: r for r in named.rivals}
    if effect.name in rivals and rivals[effect.name].score > CLOSE_SHARE * named.score:
        return True
    group = [named.effect, *(rivals[name].effect for name in named.tied if name in rivals)]
    return any(effect.name in one.confused_with or one.name in effect.confused_with for one in group)


def pays_for_a_name(found: Comparison, held: HeldOutScore, family: int, named: Sequence[Named] = ()) -> bool:
    """Whether the best effect of a comparison is named, beside those ``named`` before it.

    ``held`` is its held-out score, ``family`` how many effects it was picked from.
    """
    needed, entry = _needed(found, named), found.best.fitted.entries[-1]
    if no_mode_of_its_own(found.problem, entry) or _negligible(entry):
        return False
    if _harms(found, held) or shown_by_reference(found.problem, entry):
        return False
    if not held.testable:
        lacking = held.drive < NO_DRIVE_SHARE * found.best.score
        return lacking and found.best.score >= needed + (UNTESTED_FACTOR - 1) * MARGIN and not held.contradicted
    certain = held.z >= HELD_OUT_Z and float(norm.sf(held.z)) * family <= FAMILY_RISK
    return found.best.score >= needed and certain and HELD_OUT_SLOPE[0] <= held.slope <= HELD_OUT_SLOPE[1]


def _negligible(entry: SizedEffect) -> bool:
    """Whether every one of its sizes is next to nothing beside what is typical."""
    effect, params = entry
    return all(abs(params[p.name]) < NEGLIGIBLE * p.typical for p in effect.sizes)


def _harms(found: Comparison, held: HeldOutScore) -> bool:
    """Whether it makes the held-out gap larger, and is not certainly there all the same.

    Of two effects that work against each other the first makes the gap larger though it is there. That is believed only
    where there are reference records, which tell in the end whether the names explain the gap, and not of a drift,
    which follows whatever moves slowly.
    """
    responds = found.best.effect.kind != "disturbance"
    certain = responds and found.problem.reference is not None and held.z > CERTAIN_Z
    return held.harm > MOST_HARM and not certain


def why_not_named(found: Comparison, held: HeldOutScore, named: Sequence[Named]) -> str:
    """Why the best effect of a comparison was not named, for a person; arguments as of ``pays_for_a_name``."""
    if found.best.score < (needed := _needed(found, named)):
        return f"gains {found.best.score:.1f}, less than the {needed:.3g} a name costs"
    if _negligible(found.best.fitted.entries[-1]):
        return f"gains {found.best.score:.0f}, but is far smaller than what is known to occur"
    if _harms(found, held):
        return f"gains {found.best.score:.0f}, but makes the held-out gap larger"
    if shown_by_reference(found.problem, found.best.fitted.entries[-1]):
        return f"gains {found.best.score:.0f}, but the reference records show it too"
    if not held.testable:
        return f"gains {found.best.score:.0f}, but the held-out records cannot show it"
    return f"does not hold on held-out records (z = {held.z:.1f}, {100 * held.slope:.0f} % of it found there)"
