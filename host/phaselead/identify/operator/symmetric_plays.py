"""A hysteresis operator for a model that has none: symmetric plays behind the delay that the model has.

Asymmetry, more delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.operator.regressors import FEWEST_ROWS, FitRun, Turns, fitted_span_V, nested_basis, rows_to_fit
from phaselead.identify.operator.solution import Solution, best_slopes
from phaselead.identify.operator.starting_memories import starting_memory
from phaselead.identify.runs import AxisRun, sensor_counts_backwards, turned
from phaselead.model import TimeView, turned_view

SYMMETRIC_PLAYS = 20
MOST_PLAY_ROWS = 12_000
"""Of all records."""
REST_FRACTIONS = np.linspace(-0.8, 0.8, 9)
PLAY_TURNING_POINTS = 9
"""Evenly over the range: voltages a record can have come from."""
OWN_OFFSETS = 0.0
"""What offsets between records count."""
LEAST_RANGE_UM = 1e-9
"""Keeps the weight of a record that hardly moves finite."""


def fit_plays(runs: Sequence[AxisRun], delay_s: float = 0.0) -> TimeView:
    """Plays and a gain behind ``delay_s``, fitted to driven runs of one axis, each with an offset and a starting memory
    of its own.

    Raises BadInput for records that determine nothing.
    """
    if sensor_counts_backwards(runs):
        return turned_view(_fit_rising([turned(run) for run in runs], delay_s))
    return _fit_rising(runs, delay_s)


def _fit_rising(runs: Sequence[AxisRun], delay_s: float) -> TimeView:
    low, high = fitted_span_V(runs)
    swing = max(float(np.ptp(r.u_V[r.scored])) for r in runs)
    basis = nested_basis(swing, low, high, SYMMETRIC_PLAYS, 1)
    fits = [_thinned(run, max(FEWEST_ROWS, MOST_PLAY_ROWS // len(runs)), i) for i, run in enumerate(runs)]
    tried = [best_slopes(fits, basis, delay_s, rest, OWN_OFFSETS) for rest in REST_FRACTIONS.tolist()]
    solution = min(tried, key=lambda s: s.error)
    if len(fits) > 1:
        fits = [_from_its_memory(fit, solution) for fit in fits]
        solution = best_slopes(fits, basis, delay_s, solution.rest_fraction, OWN_OFFSETS)
    residuals = [solution.residual(f) for f in fits]
    return solution.time_view(1 / runs[0].step_s, [e - e.mean() for e in residuals])


def _thinned(run: AxisRun, most_rows: int, group: int) -> FitRun:
    """The rows of one run to fit; of steps alone every row, since nothing but jumps would be left out of them."""
    if np.quantile(np.abs(np.diff(run.u_V[run.scored])), 0.99) > 0:
        return rows_to_fit(run, most_rows, group, 1)
    start, stop, _ = run.scored.indices(len(run.u_V))
    rows = np.arange(start, stop, max(1, (stop - start) // most_rows)).astype(np.uintp)
    weight = 1.0 / (max(float(np.ptp(run.x_um[rows])), LEAST_RANGE_UM) ** 2 * len(rows))
    return FitRun(run, rows, np.full(len(rows), group), weight)


def _from_its_memory(fit: FitRun, solution: Solution) -> FitRun:
    """The record from rest, or from the turning point that explains it best."""

    def variance(turned_V: Turns | None) -> float:
        return float(np.var(solution.residual(replace(fit, turned_V=turned_V))))

    low, *_, high = solution.basis.knots_V.tolist()
    turned_V = starting_memory(variance, np.linspace(low, high, PLAY_TURNING_POINTS).tolist())
    return replace(fit, turned_V=turned_V)
