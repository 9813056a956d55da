"""Plays for a model that has no memory yet, from records that start and stand where they like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench_stage import BenchStage, Grid, rising_sine

from phaselead.identify.operator import fit_plays, play_thresholds
from phaselead.identify.runs import AxisRun, axis_run
from phaselead.model.operator import predict_time_view

STAGE = BenchStage(d=(), s=(), creep=(), mode_Hz=0.0, delay_ticks=0, noise_um=0.005)
GRID = Grid(levels=(2.0, 5.0, 10.0), f_Hz=(2.0, 5.0), rate_Hz=500.0, periods=3, stage=STAGE)


@pytest.fixture(scope="module")
def runs() -> list[AxisRun]:
    return [axis_run(r, "x") for r in GRID.records()]


def after_an_excursion(run: AxisRun) -> AxisRun:
    """The same voltage on a stage that has been to 10 V before the record began."""
    warm = np.concatenate([np.linspace(0, 10, 50), np.linspace(10, 0, 50), run.u_V])
    return replace(run, x_um=STAGE.measure(warm, 500)[100:])


def test_a_symmetric_stage_is_followed(runs):
    view = fit_plays(runs)
    t, u = rising_sine(7.0, 3.0, 3, 500)
    error = predict_time_view(view, t, u) - STAGE.measure(u, 500)
    assert np.abs(error).max() < 0.01 * 7 * 20
    assert (view.deadzone_d_V, view.delay_s) == ((), 0.0)


def test_offsets_and_starting_memories_are_the_records_own(runs):
    plain = fit_plays(runs).residual_um_rms
    shifted = [replace(run, x_um=run.x_um + 5 * i) for i, run in enumerate(runs)]
    assert fit_plays(shifted).residual_um_rms == pytest.approx(plain, rel=1e-3)
    odd = after_an_excursion(runs[0])
    assert fit_plays([odd, *runs[1:]]).residual_um_rms < 1.5 * plain


def test_a_sensor_that_counts_backwards_turns_all_of_it(runs):
    plain, other = fit_plays(runs), fit_plays([replace(run, x_um=-run.x_um) for run in runs])
    assert other.play_w_um_per_V == tuple(-w for w in plain.play_w_um_per_V)
    assert (other.gain_um_per_V, other.offset_um) == (-plain.gain_um_per_V, -plain.offset_um)


def test_plays_stand_behind_a_known_delay(runs):
    """Fitted without it, they would take the lag for memory."""
    late_s = 4 / 500
    late = [replace(run, x_um=np.interp(run.t_s - late_s, run.t_s, run.x_um)) for run in runs]
    view = fit_plays(late, late_s)
    assert view.delay_s == late_s
    assert view.residual_um_rms < 0.5 * fit_plays(late).residual_um_rms


def test_thresholds_rise_to_half_of_the_swing():
    r = play_thresholds(8.0, 20)
    assert np.all(np.diff(r, prepend=0.0) > 0)
    assert np.all(np.diff(r, 2) > 0)
    assert r[-1] == 4.0
    assert len(play_thresholds(8.0, 0)) == 0
