"""What the next model adopts without vouching for its name: the nearest set that pays on held-out records.

A gap that can be shrunk is shrunk; what it is called is another question. So nothing here is whitened, weighed or
vetoed: effects are fitted to the training records as they stand, in um, and one is adopted where the next model then
predicts the held-out records better than chance would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.gap.adopt import adopted
from phaselead.gap.findings import NamedEffect
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.plain_fits import each_fitted, plain_problem
from phaselead.gap.posterior import intervals_alone, likelihood_of
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted
from phaselead.gap.residual import modelled_run
from phaselead.gap.savings import BY_CHANCE, probability_by_chance, saved_by_block
from phaselead.model import Effect

MOST_PROVISIONAL = 3
"""Effects that are adopted one after the other: as many as the trials hide."""


def nearest_that_pays(
    final: FinalFit,
    named: Sequence[NamedEffect],
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    label: str | None,
) -> tuple[FinalFit, list[NamedEffect]]:
    """The final fit with the set of ``effects`` that predicts the held-out records best beside it, and that set.

    The set grows one by one, as long as the last one pays. ``named`` are the effects of the fit already. ``label`` is
    the axis in the result.
    """
    found: list[NamedEffect] = []
    for _ in range(MOST_PROVISIONAL):
        taken = {e.name for e in (*named, *found)}
        left = [e for e in effects if e.name not in taken]
        problem = plain_problem(adopted(final.axis, [*named, *found]), runs, left)
        best = _best_that_pays(final, each_fitted(problem, left))
        if best is None:
            break
        final = final.with_entries(best.entries)
        beside = likelihood_of([modelled_run(problem.axis, run) for run in runs], None)
        params = intervals_alone(beside, best.entries)[0]
        found.append(NamedEffect(best.entries[0][0].name, label, params, 0.0))
    return final, [replace(e, share=final.share_of(e.name)) for e in found]


def _best_that_pays(final: FinalFit, tried: Sequence[Fitted]) -> Fitted | None:
    """The fit that saves most of the held-out squares, of those that save some beyond chance; None without one."""
    held = [t for t in final.after if t.run.role == "holdout"]
    best: Fitted | None = None
    most = 0.0
    for one in tried:
        saved = saved_by_block(held, final.entries, held, (*final.entries, *one.entries))
        if float(saved.sum()) > most and probability_by_chance(saved) * len(tried) < BY_CHANCE:
            best, most = one, float(saved.sum())
    return best
