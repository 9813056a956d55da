"""Operator, modes and creep of one axis: what creeps is taken out of the records, and the others are fitted again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.modal.one_axis import MANY_RUNS, FittedModes, fit_together, go_on, left_um_by
from phaselead.identify.operator import PART_PAYS, OperatorFit, apart_from_before, creep_beside
from phaselead.identify.runs import AxisRun
from phaselead.model import AxisModel

Found = tuple[OperatorFit, FittedModes | None]


def fit_with_creep(runs: Sequence[AxisRun]) -> Found:
    """As ``fit_together``, with creep where that leaves much less, beside what was found without it and when operator
    and modes are fitted again: fitted to what creeps, plays fade and loops bend that do not.

    Beside what was fitted again creep is told once more, and the fit goes on from there; to many records, whose
    memories tell each other, from the beginning.
    """
    without = fit_together(runs)
    before = _squares(without, runs)
    first = _with_creep_beside(without, runs, PART_PAYS * before, anew=len(runs) < MANY_RUNS)
    if first is None:
        return without
    left, (operator, modes) = _with_creep_beside(first[1], runs, first[0]) or first
    return replace(operator, creep_share=1 - left / before), modes


def _with_creep_beside(
    fit: Found, runs: Sequence[AxisRun], below: float, *, anew: bool = False
) -> tuple[float, Found] | None:
    """The fit of the records without what creeps beside ``fit``, from there on, behind the squares that it leaves; None
    where nothing creeps, or these are not ``below``. ``anew``: from the beginning as well, since where records began is
    told by what is left of them, and the search is not convex."""
    operator, modes = fit
    creep = creep_beside(runs, operator, () if modes is None else modes.modes)
    if creep is None:
        return None
    less = [creep.taken_from(run) for run in runs]
    again = [go_on(operator, modes, less), *([fit_together(less)] if anew else [])]
    fits: list[Found] = [(one.creeping(creep), ringing) for one, ringing in again]
    best = min(((_squares(one, runs), one) for one in fits), key=lambda pair: pair[0])
    return best if best[0] < below else None


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
