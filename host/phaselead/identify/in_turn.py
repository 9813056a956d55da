"""Operator and mode fitted in turn: each to the records without what the other says.

An operator fitted to a ringing stage takes up part of the ringing, which then misleads the fit of the mode, and the
other way round: in turn they part. Only as long as it pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.effects.filters import resonant
from phaselead.identify.checks import AxisRun
from phaselead.identify.mode_fit import FittedMode, fit_mode
from phaselead.identify.operator_fit import fit_operator
from phaselead.identify.operator_result import OperatorFit
from phaselead.record.recording import Samples
from phaselead.stage.operator import predict_time_view

TURNS = 3
MANY_RUNS = 8
"""A grid of sines away from the mode parts them by itself, and would take minutes."""
PAYS = 0.7
"""Another turn is kept when it leaves less than this share of the squared residual of the turn before."""


def fit_in_turn(runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedMode | None]:
    """The operator of an axis and its first mode, if it shows one. Raises BadInput as ``fit_operator`` does."""
    operator = fit_operator(runs)
    mode = fit_mode(operator.view, runs)
    if mode is None or len(runs) >= MANY_RUNS:
        return operator, mode
    left = _left(operator, mode, runs)
    for _ in range(TURNS):
        again = fit_operator([_without_ringing(operator, mode, run) for run in runs])
        mode_again = fit_mode(again.view, runs)
        if mode_again is None or (left_again := _left(again, mode_again, runs)) > PAYS * left:
            break
        operator, mode, left = again, mode_again, left_again
    return operator, mode


def _answers(operator: OperatorFit, mode: FittedMode, run: AxisRun) -> tuple[Samples, Samples]:
    """Of the operator alone, and with the mode behind it."""
    view, _ = mode.adopted(operator.view)
    still = predict_time_view(view, run.t_s, run.u_V)
    return still, resonant(still, mode.f_Hz, mode.zeta, run.step_s)


def _without_ringing(operator: OperatorFit, mode: FittedMode, run: AxisRun) -> AxisRun:
    still, ringing = _answers(operator, mode, run)
    return replace(run, x_um=run.x_um - (ringing - still))


def _left(operator: OperatorFit, mode: FittedMode, runs: Sequence[AxisRun]) -> float:
    """Squared residual, each run in its own range."""
    errors = [(run.x_um - _answers(operator, mode, run)[1])[run.scored] / run.range_um for run in runs]
    return sum(float(np.var(error)) for error in errors)
