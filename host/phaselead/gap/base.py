"""A hysteresis operator for a base that has none: symmetric plays without delay, fitted to the training records.

Asymmetry, delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.errors import BadInput
from phaselead.gap.records import Run
from phaselead.identify import AxisRun, Basis, FitRun, Solved, design, fit_run, nested_basis, solved_at, time_view
from phaselead.model import AxisModel, TimeView
from phaselead.record import Samples

PLAYS = 20
ROWS = 12_000
REST = np.linspace(-0.8, 0.8, 9)
OTHER_MEMORY = 0.8


def with_operator(axis: AxisModel, runs: Sequence[Run], beyond_um: Sequence[Samples] | None = None) -> AxisModel:
    """The axis with plays in place of a line. Raises BadInput where the records determine none.

    ``beyond_um``: per run what effects add to the operator over the scored rows, taken out before the fit.
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
    fits = [_fit_run(run, max(200, ROWS // len(driven)), i) for i, run in enumerate(driven)]
    own_offsets = len(fits) > 1
    fits, rest = _remembering(fits, basis, own_offsets)
    solved = solved_at(fits, basis, 0.0, rest, own_offsets)
    left = np.concatenate([_left(f, basis, rest, solved) for f in fits])
    view = time_view(basis, solved.slopes, solved.at_rest_um, 0.0, rest, 1 / driven[0].step_s)
    fitted = TimeView(**{**view.model_dump(), "residual_um_rms": float(np.sqrt(np.mean(left**2)))})
    return axis.model_copy(update={"time": fitted})


def _without(run: Run, beyond_um: Samples) -> Run:
    x = run.x_um.copy()
    x[run.rows] -= beyond_um
    return replace(run, x_um=x)


def _fit_run(run: Run, most_rows: int, group: int) -> FitRun:
    """The rows of one run; of steps alone every row, since nothing but jumps would be left out of them."""
    u = np.abs(np.diff(run.u_V[run.rows]))
    if np.quantile(u, 0.99) > 0:
        return fit_run(_axis_run(run), most_rows, group, 1)
    rows = np.arange(run.start, run.stop, max(1, (run.stop - run.start) // most_rows)).astype(np.uintp)
    weight = 1.0 / (max(float(np.ptp(run.x_um[rows])), 1e-9) ** 2 * len(rows))
    return FitRun(_axis_run(run), rows, np.full(len(rows), group), weight)


def _axis_run(run: Run) -> AxisRun:
    return AxisRun(run.t_s, run.u_V, run.x_um, run.rows, run.axis, run.source)


def _left(fit: FitRun, basis: Basis, rest: float, solved: Solved) -> Samples:
    left = fit.position() - solved.at_rest_um - design(fit, basis, 0.0, rest) @ solved.slopes
    return np.asarray(left - left.mean())


def _remembering(fits: list[FitRun], basis: Basis, own_offsets: bool) -> tuple[list[FitRun], float]:
    """Each record's memory, and the fraction at which plays rest, by what is left."""
    rest = min(REST.tolist(), key=lambda r: solved_at(fits, basis, 0.0, r, own_offsets).error)
    if len(fits) < 2:
        return fits, rest
    solved = solved_at(fits, basis, 0.0, rest, own_offsets)
    found = []
    for fit in fits:
        tries = [replace(fit, came_from_V=float(v)) for v in np.linspace(basis.knots_V[0], basis.knots_V[-1], 9)]
        squares = [float(np.var(_left(f, basis, rest, solved))) for f in [fit, *tries]]
        best = int(np.argmin(squares))
        found.append([fit, *tries][best] if squares[best] < OTHER_MEMORY * squares[0] else fit)
    return found, rest
