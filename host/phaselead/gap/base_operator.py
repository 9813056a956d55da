"""A hysteresis operator for a base that has none: symmetric plays behind the base's own delay, fitted to the training
records.

Asymmetry, more delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.gap.posterior import intervals_alone, likelihood_of
from phaselead.gap.problem import make_problem
from phaselead.gap.records import GapRun
from phaselead.gap.refit import refit
from phaselead.gap.residual import modelled_run
from phaselead.gap.savings import BY_CHANCE, probability_by_chance, saved_by_block
from phaselead.gap.scan import refit_best, scan
from phaselead.gap.selection import Memory
from phaselead.identify import fit_plays
from phaselead.model import AxisModel, Effect
from phaselead.record import Samples


def find_memory(
    axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], frozen: bool
) -> tuple[AxisModel, Memory | None]:
    """The axis with plays of its own, and what they are, where it has none and plays predict the held-out records
    better than the line and than any other single effect; otherwise the axis as it is, and None.

    Everything is compared in um, where memory is largest: the metric that expects the slow misfit of a memory model
    would forgive just that.
    """
    view = axis.time
    assert view is not None
    becoming = [effect for effect in effects if effect.becomes_plays]
    if view.play_r_V or not becoming:
        return axis, None
    train = [run for run in runs if run.role == "train"]
    given = with_operator(axis, train)
    problem = make_problem(axis, runs, effects, frozen, unwhitened=True)
    bare = refit(problem.train_common, problem.discrepancy, [])
    tried = {one.effect.name: one.fitted for one in refit_best(problem, bare, scan(problem, bare, effects))}
    held = [run for run in runs if run.role == "holdout"]
    as_line = [modelled_run(axis, run) for run in held]
    saved = saved_by_block(as_line, (), [modelled_run(given, run) for run in held], ())
    others = [
        saved_by_block(as_line, (), as_line, one.entries).sum() for n, one in tried.items() if n != becoming[0].name
    ]
    chance = probability_by_chance(saved)
    described = tried.get(becoming[0].name)
    if chance > BY_CHANCE or saved.sum() <= max(others, default=0.0) or described is None:
        return axis, None
    likelihood = likelihood_of([modelled_run(axis, run) for run in runs], None)
    params = intervals_alone(likelihood, described.entries)[-1]
    why = "plays of its own predict the held-out records better than the line, and than any other effect alone"
    return given, Memory(becoming[0], params, 1 - chance, why)


def with_operator(axis: AxisModel, runs: Sequence[GapRun], beyond_um: Sequence[Samples] | None = None) -> AxisModel:
    """The axis with plays, fitted to the runs, in place of its line. Raises BadInput where no run is driven.

    ``beyond_um``: per run what effects add to the operator, (n,) over the scored rows, taken out before the fit.
    """
    if beyond_um is not None:
        runs = [_without(run, beyond) for run, beyond in zip(runs, beyond_um, strict=True)]
    driven = [r.as_fitted for r in runs if r.driven]
    if not driven:
        raise BadInput("no training record is driven; nothing can be learned about its memory")
    return axis.model_copy(update={"time": fit_plays(driven, axis.time.delay_s if axis.time is not None else 0.0)})


def _without(run: GapRun, beyond_um: Samples) -> GapRun:
    """The run with (n,) taken out of its position over the scored rows."""
    x = run.x_um.copy()
    x[run.rows] -= beyond_um
    return replace(run, x_um=x)
