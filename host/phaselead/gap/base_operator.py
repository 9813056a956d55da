"""A hysteresis operator for a base that has none: symmetric plays without delay, fitted to the training records.

Asymmetry, delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.errors import BadInput
from phaselead.gap.records import Run
from phaselead.gap.residual import best_turning_point
from phaselead.identify import AxisRun, Basis, FitRun, Solved, design, fit_run, nested_basis, solved_at, time_view
from phaselead.model import AxisModel, TimeView
from phaselead.record import Samples

PLAYS = 20
"""Of the operator."""
FIT_ROWS = 12_000
"""Over all records, that its fit uses."""
REST_FRACTIONS = np.linspace(-0.8, 0.8, 9)
"""Tried for where the plays stand at rest, in thresholds."""
TURNING_POINTS = 9
"""Tried for the start of each record's memory."""


def with_operator(axis: AxisModel, runs: Sequence[Run], beyond_um: Sequence[Samples] | None = None) -> AxisModel:
    """The axis with plays, fitted to the runs, in place of its line. Raises BadInput where no run is driven.

    ``beyond_um``: per run what effects add to the operator, (n,) over the scored rows, taken out before the fit.
    """
    if beyond_um is not None:
        runs = [_without(run, beyond) for run, beyond in zip(runs, beyond_um, strict=True)]
    driven = [run for run in runs if run.driven]
    if not driven:
        raise BadInput("no training record is driven; nothing can be learned about its memory")
    low = min(float(r.u_V[r.rows].min()) for r in driven)
    high = max(float(r.u_V[r.rows].max()) for r in driven)
    swing = max(float(np.ptp(r.u_V[r.rows])) for r in driven)
    basis = nested_basis(swing, low, high, PLAYS, 1)
    fits = [_fit_run(run, max(200, FIT_ROWS // len(driven)), i) for i, run in enumerate(driven)]
    own_offsets = len(fits) > 1
    fits, rest = _remembering(fits, basis, own_offsets)
    solved = solved_at(fits, basis, 0.0, rest, own_offsets)
    left = np.concatenate([_left(f, basis, rest, solved) for f in fits])
    view = time_view(basis, solved.slopes, solved.at_rest_um, 0.0, rest, 1 / driven[0].step_s)
    fitted = TimeView(**{**view.model_dump(), "residual_um_rms": float(np.sqrt(np.mean(left**2)))})
    return axis.model_copy(update={"time": fitted})


def _without(run: Run, beyond_um: Samples) -> Run:
    """The run with (n,) taken out of its position over the scored rows."""
    x = run.x_um.copy()
    x[run.rows] -= beyond_um
    return replace(run, x_um=x)


def _fit_run(run: Run, most_rows: int, group: int) -> FitRun:
    """The rows of one run that the fit uses: those that tell most, or of a record of steps alone rows at even
    spacing."""
    u = np.abs(np.diff(run.u_V[run.rows]))
    if np.quantile(u, 0.99) > 0:
        return fit_run(_axis_run(run), most_rows, group, 1)
    rows = np.arange(run.start, run.stop, max(1, (run.stop - run.start) // most_rows)).astype(np.uintp)
    weight = 1.0 / (max(float(np.ptp(run.x_um[rows])), 1e-9) ** 2 * len(rows))
    return FitRun(_axis_run(run), rows, np.full(len(rows), group), weight)


def _axis_run(run: Run) -> AxisRun:
    return AxisRun(run.t_s, run.u_V, run.x_um, run.rows, run.axis, run.source)


def _left(fit: FitRun, basis: Basis, rest: float, solved: Solved) -> Samples:
    """Residual (rows,) of an operator about its mean."""
    left = fit.position() - solved.at_rest_um - design(fit, basis, 0.0, rest) @ solved.slopes
    return np.asarray(left - left.mean())


def _remembering(fits: list[FitRun], basis: Basis, own_offsets: bool) -> tuple[list[FitRun], float]:
    """The runs with the start of memory, and the fraction of thresholds at which plays rest, that leave least."""
    rest = min(REST_FRACTIONS.tolist(), key=lambda r: solved_at(fits, basis, 0.0, r, own_offsets).error)
    if len(fits) < 2:
        return fits, rest
    solved = solved_at(fits, basis, 0.0, rest, own_offsets)
    tries_V = np.linspace(basis.knots_V[0], basis.knots_V[-1], TURNING_POINTS).tolist()

    def variance(fit: FitRun) -> float:
        return float(np.var(_left(fit, basis, rest, solved)))

    def started(fit: FitRun) -> FitRun:
        from_V = best_turning_point(variance(fit), tries_V, lambda v: variance(replace(fit, came_from_V=v)))
        return fit if from_V is None else replace(fit, came_from_V=from_V)

    return [started(fit) for fit in fits], rest
