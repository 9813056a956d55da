"""The search for delay and memory: its steps stay in bounds, and it ends where the records were made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_stage import BenchStage, Grid
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.identify.operator_design import fit_run, nested_basis
from phaselead.identify.operator_search import least_error, least_in_box
from phaselead.identify.runs import axis_run

NUMBER = st.floats(-5.0, 5.0)


@settings(deadline=None)
@given(st.tuples(NUMBER, NUMBER, NUMBER), st.tuples(NUMBER, NUMBER), st.floats(0.0, 2.0), st.integers(0, 99))
def test_no_point_of_the_box_is_lower(root, slope, size, seed):
    root = np.array([[root[0], root[1]], [0.0, root[2]]])
    curvature = root.T @ root + 1e-3 * np.eye(2)
    low, high = np.array([0.0, -1.0]) - size / 2, np.array([0.3, 1.0]) + size / 2
    found = least_in_box(curvature, np.array(slope), low, high)
    assert np.all((low <= found) & (found <= high))

    def value(x):
        return x @ curvature @ x / 2 - np.array(slope) @ x

    for other in np.random.default_rng(seed).uniform(low, high, (50, 2)):
        assert value(found) <= value(other) + 1e-9


@pytest.mark.parametrize("start", [(0.0, 0.0), (4e-3, 0.9), (0.0, -0.5)])
def test_any_start_ends_at_the_same_delay_and_memory(start):
    stage = BenchStage(creep=(), mode_Hz=0.0, delay_ticks=0, noise_um=0.005)
    grid = Grid(stage=stage, levels=(2.0, 6.0, 10.0), f_Hz=(2.0, 5.0), rate_Hz=500.0, periods=3)
    runs = [axis_run(r, "x") for r in grid.records()]
    # 3.4 rows late: the voltage that the fit is told of runs ahead by that much.
    late_s = 3.4 / 500
    runs = [replace(r, x_um=np.interp(r.t_s - late_s, r.t_s, r.x_um)) for r in runs]
    fits = [fit_run(run, 400, i, 1) for i, run in enumerate(runs)]
    found = least_error(fits, nested_basis(10.0, 0.0, 10.0, 12, 10), 0.02, False, start)
    assert found.delay_s == pytest.approx(late_s, abs=0.05 / 500)
    assert found.rest_fraction == pytest.approx(stage.rest, abs=0.08)
