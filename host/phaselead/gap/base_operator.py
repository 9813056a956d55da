"""A hysteresis operator for a base that has none: symmetric plays behind the base's own delay, fitted to the training
records.

Asymmetry, more delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.gap.plain_fits import each_fitted
from phaselead.gap.posterior import intervals_alone, likelihood_of
from phaselead.gap.records import GapRun, Role
from phaselead.gap.residual import ModelledRun, modelled_run
from phaselead.gap.savings import BY_CHANCE, probability_by_chance, saved_by_block
from phaselead.gap.selection import Memory
from phaselead.identify import fit_plays
from phaselead.model import AxisModel, Effect
from phaselead.record import Samples


def find_memory(axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect]) -> tuple[AxisModel, Memory | None]:
    """The axis with plays of its own, and what they are, where it has none and plays predict the held-out records
    better than the line and than any other single effect; otherwise the axis as it is, and None. Not where they predict
    reference records better too: a base that lacks them there has a fault, and they are not what is new.

    Everything is compared in um, where memory is largest.
    """
    view = axis.time
    assert view is not None
    becoming = [effect for effect in effects if effect.becomes_plays]
    if view.play_r_V or not becoming:
        return axis, None
    given = with_operator(axis, [run for run in runs if run.role == "train"])
    as_line = [modelled_run(axis, run) for run in runs]

    def of_role(role: Role) -> list[ModelledRun]:
        return [modelled for modelled in as_line if modelled.run.role == role]

    def saved_by_plays(role: Role) -> Samples:
        lines = of_role(role)
        return saved_by_block(lines, (), [modelled_run(given, line.run) for line in lines], ())

    if of_role("reference") and probability_by_chance(saved_by_plays("reference")) < BY_CHANCE:
        return axis, None
    saved = saved_by_plays("holdout")
    chance = probability_by_chance(saved)
    if chance > BY_CHANCE:
        return axis, None
    train, held = of_role("train"), of_role("holdout")
    described = each_fitted(train, becoming[:1], base_may_be_off=True)
    others = each_fitted(train, [one for one in effects if one is not becoming[0]], base_may_be_off=True)
    saved_by_another = max((float(saved_by_block(held, (), held, [one]).sum()) for one in others), default=0.0)
    if saved.sum() <= saved_by_another or not described:
        return axis, None
    params = intervals_alone(likelihood_of(as_line), described)[0]
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
