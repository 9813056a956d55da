"""Operator, modes and creep of one axis: what creeps is taken out of the records, and the others are fitted again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.modal.one_axis import MANY_RUNS, FittedModes, fit_together, go_on, left_um_by
from phaselead.identify.operator import PART_PAYS, Creep, OperatorFit, apart_from_before, creep_beside
from phaselead.identify.runs import AxisRun
from phaselead.model import AxisModel

CREEP_ROUNDS = 4
"""How often creep is told anew beside what was fitted again: a budget of time."""
SAME_CREEP = 0.1
"""Of creep, chosen: told anew by less than this beside what it led to, it is the same."""

Found = tuple[OperatorFit, FittedModes | None]


def fit_with_creep(runs: Sequence[AxisRun]) -> Found:
    """As ``fit_together``, with creep where that leaves much less, beside what was found without it and when operator
    and modes are fitted again: fitted to what creeps, plays fade and loops bend that do not.

    Beside what was fitted again creep is told anew, and the fit goes on from there, as long as that leaves less.
    """
    without = fit_together(runs)
    before = _squares(without, runs)
    found = _with_creep_beside(without, runs, PART_PAYS * before)
    if found is None:
        return without
    for _ in range(CREEP_ROUNDS):
        left, fit = found
        better = _with_creep_beside(fit, runs, left, anew=False)
        if better is None:
            break
        found = better
    left, (operator, modes) = found
    return replace(operator, creep_share=1 - left / before), modes


def _with_creep_beside(
    fit: Found, runs: Sequence[AxisRun], below: float, *, anew: bool = True
) -> tuple[float, Found] | None:
    """The fit of the records without what creeps beside ``fit``, from there on, behind the squares that it leaves; None
    where nothing creeps but what the fit has, or these are not ``below``. ``anew``: where records are few, or going on
    does not get ``below``, from the beginning as well: where records began is told by what is left of them, and the
    search is not convex."""
    operator, modes = fit
    creep = creep_beside(runs, operator, () if modes is None else modes.modes)
    if creep is None or _same(creep, operator.creep):
        return None
    less = [creep.taken_from(run) for run in runs]
    best = _judged(go_on(operator, modes, less), creep, runs)
    if anew and (len(runs) < MANY_RUNS or not best[0] < below):
        best = min(best, _judged(fit_together(less), creep, runs), key=lambda pair: pair[0])
    return best if best[0] < below else None


def _same(creep: Creep, known: Creep | None) -> bool:
    """Whether both begin together and creep as far."""
    return (
        known is not None
        and creep.first_s == known.first_s
        and abs(creep.per_decade - known.per_decade) <= SAME_CREEP * known.per_decade
    )


def _judged(of_less: Found, creep: Creep, runs: Sequence[AxisRun]) -> tuple[float, Found]:
    """The fit of the records without this creep as one of the records with it, behind the squares that it leaves."""
    operator, modes = of_less
    fit = operator.creeping(creep), modes
    return _squares(fit, runs), fit


def _squares(fit: Found, runs: Sequence[AxisRun]) -> float:
    """That are left of the records as they were measured, each in its own range, without what may have crept on from
    before it began."""
    operator, modes = fit
    found = 0.0
    for run, left_um in zip(runs, left_um_by(operator, modes, runs), strict=True):
        rows = np.arange(len(run.x_um), dtype=np.uintp)[run.scored]
        apart = apart_from_before(left_um[:, None], left_um, run, rows, AxisModel(time=operator.view))
        found += float(np.mean(apart**2)) / run.range_um**2
    return found
