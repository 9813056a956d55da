"""Effects fitted one by one to records as they stand, in um: nothing is whitened, weighed or shrunk.

So they are found from far away, also where a whitened metric hides what is slow; and they predict.
"""

from __future__ import annotations

from collections.abc import Sequence

from phaselead.gap.problem import Problem, make_problem
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted, refit
from phaselead.gap.scan import refit_best, scan
from phaselead.model import AxisModel, Effect


def plain_problem(
    axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], open_plays: bool = False
) -> Problem:
    """What the axis leaves of the runs that are no reference, in um. ``open_plays``: its plays move along."""
    learned = [run for run in runs if run.role != "reference"]
    return make_problem(axis, learned, effects, frozen=True, open_plays=open_plays, unwhitened=True)


def each_fitted(problem: Problem, effects: Sequence[Effect]) -> list[Fitted]:
    """Every promising effect by itself, fitted to the training runs of a plain problem."""
    bare = refit(problem.train_common, problem.discrepancy, [])
    return [one.fitted for one in refit_best(problem, bare, scan(problem, bare, effects))]
