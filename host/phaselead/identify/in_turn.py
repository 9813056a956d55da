"""Operator and mode fitted in turn: the operator with the mode behind it, the mode behind the operator.

An operator fitted to a ringing stage takes up part of the ringing, and chooses fewer plays than the records carry. Only
as long as it pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.mode_fit import FittedModes, fit_modes
from phaselead.identify.operator_fit import fit_linear, fit_operator, refit_operator
from phaselead.identify.operator_result import OperatorFit
from phaselead.identify.runs import AxisRun
from phaselead.model import behind_modes, predict_time_view

TURNS = 8
MANY_RUNS = 8
"""A grid of sines away from the mode parts them by itself, and would take minutes."""
ASTRAY = 0.5
"""Share of the squared residual below which modes from a straight line are believed."""
PAYS = 0.9
"""Another turn follows when one leaves less than this share of the squared residual of the turn before."""


def fit_in_turn(runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedModes | None]:
    """The operator of an axis and its first modes, if it shows any. Raises BadInput as ``fit_operator`` does."""
    operator = fit_operator(runs)
    found = fit_modes(operator.view, runs)
    if len(runs) >= MANY_RUNS:
        return operator, found
    if found is None:
        return _from_a_line(operator, runs)
    operator, found = _turns(operator, found, runs)
    if len(found.modes) == 1 and (more := fit_modes(operator.view, runs)) is not None and len(more.modes) > 1:
        operator, found = _turns(operator, more, runs)
    return operator, found


def _from_a_line(operator: OperatorFit, runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedModes | None]:
    """Where ringing has led the operator so far astray that no mode fits behind it: modes behind a straight line, which
    follows no ringing, and the operator after them. The operator as it was unless they leave much less."""
    straight = fit_modes(fit_linear(runs).view, runs)
    if straight is None:
        return operator, None
    view, _ = straight.adopted(operator.view)
    again = refit_operator(runs, replace(operator, view=view), straight.modes)
    found = fit_modes(again.view, runs, straight)
    if found is None:
        return operator, None
    again, found = _turns(again, found, runs)
    if _left(again, found, runs) > ASTRAY * _left(operator, None, runs):
        return operator, None
    return again, found


def _turns(operator: OperatorFit, found: FittedModes, runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedModes]:
    left = _left(operator, found, runs)
    for _ in range(TURNS):
        view, _ = found.adopted(operator.view)
        again = refit_operator(runs, replace(operator, view=view), found.modes)
        found_again = fit_modes(again.view, runs, found)
        if found_again is None or (left_again := _left(again, found_again, runs)) >= left:
            break
        operator, found, left, before = again, found_again, left_again, left
        if left > PAYS * before:
            break
    return operator, found


def _left(operator: OperatorFit, found: FittedModes | None, runs: Sequence[AxisRun]) -> float:
    """Squared residual, each run in its own range."""
    view = operator.view if found is None else found.adopted(operator.view)[0]
    errors = []
    for run in runs:
        answer = predict_time_view(view, run.t_s, run.u_V)
        answer = answer if found is None else behind_modes(answer, found.modes, run.step_s)
        errors.append((run.x_um - answer)[run.scored] / run.range_um)
    return sum(float(np.var(error)) for error in errors)
