"""What the next model adopts without vouching for its name: the nearest set that pays on held-out records.

A gap that can be shrunk is shrunk; what it is called is another question. So nothing here is whitened, weighed or
vetoed: effects are fitted to the training records as they stand, in um, and one is adopted where the next model then
predicts the held-out records better than chance would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from phaselead.gap.adopt import adopted
from phaselead.gap.confidence import confidence_intervals
from phaselead.gap.findings import NamedEffect
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.problem import make_problem
from phaselead.gap.records import GapRun
from phaselead.gap.refit import SizedEffect, refit
from phaselead.gap.savings import BY_CHANCE, probability_by_chance, saved_by_block
from phaselead.gap.scan import refit_best, scan
from phaselead.model import AxisModel, Effect

MOST_PROVISIONAL = 3
"""Effects that are adopted one after the other: as many as the trials hide."""


@dataclass(frozen=True)
class FittedSet:
    """Effects with values, as the engine simulates them and as they are reported."""

    entries: tuple[SizedEffect, ...]
    effects: tuple[NamedEffect, ...]


def nearest_that_pays(
    final: FinalFit,
    named: Sequence[NamedEffect],
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    label: str | None,
    seed: int,
) -> tuple[FinalFit, list[NamedEffect]]:
    """The final fit with the set of ``effects`` that predicts the held-out records best beside it, and that set.

    The set grows one by one, as long as the last one pays. ``named`` are the effects of the fit already. ``label`` is
    the axis in the result, ``seed`` of the intervals.
    """
    found: list[NamedEffect] = []
    learned = [run for run in runs if run.role != "reference"]
    for _ in range(MOST_PROVISIONAL):
        taken = {e.name for e in (*named, *found)}
        left = [e for e in effects if e.name not in taken]
        tried = _each_refitted(adopted(final.axis, [*named, *found]), learned, left, label, seed)
        best = _best_that_pays(final, tried)
        if best is None:
            break
        final = final.with_entries(best.entries)
        found += best.effects
    return final, [replace(e, share=final.share_of(e.name)) for e in found]


def _each_refitted(
    axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], label: str | None, seed: int
) -> list[FittedSet]:
    """Every promising effect by itself, fitted to what the axis leaves of the training runs."""
    problem = make_problem(axis, runs, effects, frozen=True, unwhitened=True)
    bare = refit(problem.train_common, problem.discrepancy, [])
    found = []
    for one in refit_best(problem, bare, scan(problem, bare, effects)):
        values = confidence_intervals(one.fitted, problem.train_common, problem.discrepancy, seed)
        found.append(FittedSet(one.fitted.entries, (NamedEffect(one.effect.name, label, values[0], 0.0),)))
    return found


def _best_that_pays(final: FinalFit, tried: Sequence[FittedSet]) -> FittedSet | None:
    """The set that saves most of the held-out squares, of those that save some beyond chance; None without one."""
    held = [t for t in final.after if t.run.role == "holdout"]
    best, most = None, 0.0
    for one in tried:
        saved = saved_by_block(held, final.fitted.entries, held, (*final.fitted.entries, *one.entries))
        if float(saved.sum()) > most and probability_by_chance(saved) * len(tried) < BY_CHANCE:
            best, most = one, float(saved.sum())
    return best
