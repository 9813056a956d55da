"""Operator, modes and creep of one axis: what creeps is taken out of the records, and the others are fitted again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.identify.modal.one_axis import MANY_RUNS, FittedModes, fit_together, go_on, left_um_by
from phaselead.identify.operator import OperatorFit, apart_from_before, creep_beside
from phaselead.identify.runs import AxisRun
from phaselead.model import AxisModel


def fit_with_creep(runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedModes | None]:
    """As ``fit_together``, with creep where that leaves much less beside what was found without it, and less when
    operator and modes are fitted again: fitted to what creeps, plays fade and loops bend that do not.

    Beside what was fitted again creep is told once more, and the fit goes on from there; to many records, whose
    memories tell each other, from the beginning.
    """
    without = fit_together(runs)
    first = _creeping(without, runs, anew=len(runs) < MANY_RUNS)
    return first if first is without else _creeping(first, runs)


def _creeping(
    fit: tuple[OperatorFit, FittedModes | None], runs: Sequence[AxisRun], *, anew: bool = False
) -> tuple[OperatorFit, FittedModes | None]:
    """The fit of the records without what creeps beside ``fit``, or that as it is where it leaves less. ``anew``: not
    only from there on. Where records began is told by what is left of them, and the search is not convex."""
    operator, modes = fit
    creep = creep_beside(runs, operator, () if modes is None else modes.modes)
    if creep is None:
        return fit
    less = [creep.taken_from(run) for run in runs]
    again = [go_on(operator, modes, less), *([fit_together(less)] if anew else [])]
    tried = [fit, *((one.creeping(creep), ringing) for one, ringing in again)]
    return min(tried, key=lambda one: _squares(one, runs))


def _squares(fit: tuple[OperatorFit, FittedModes | None], runs: Sequence[AxisRun]) -> float:
    """That are left of the records as they were measured, each in its own range, without what may have crept on from
    before it began."""
    operator, modes = fit
    found = 0.0
    for run, left_um in zip(runs, left_um_by(operator, modes, runs), strict=True):
        rows = np.arange(len(run.x_um), dtype=np.uintp)[run.scored]
        apart = apart_from_before(left_um[:, None], left_um, run, rows, AxisModel(time=operator.view))
        found += float(np.mean(apart**2)) / run.range_um**2
    return found
