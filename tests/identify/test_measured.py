"""Measured records of other people's rigs: fitted on one stretch, judged on the next, nothing refitted."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from phaselead.identify.fitting import fit
from phaselead.identify.verification import verify
from phaselead.model.prediction import predict
from phaselead.record.read import read_recording
from phaselead.record.recording import Recording

DATA = Path(os.environ.get("PHASELEAD_DATA") or Path(__file__).parents[3] / "shared" / "data")


def measured(name: str, window: str = "") -> Recording:
    path, columns, rate = {
        "dbo": ("dbo/Model_Vi_Do.dat", {"u_V": (1, 1.0), "x_um": (5, 1.0)}, 200.0),
        "stage150": ("stage150/hysteresis_v_150_1hz.csv", {"u_V": (4, 1.0), "x_um": (3, 1.0)}, 5000.0),
    }[name]
    if not (DATA / path).exists():
        pytest.skip(f"{DATA / path} is not there; set PHASELEAD_DATA to the folder of measured data")
    return read_recording(f"{DATA / path}{window}", columns=columns, rate_Hz=rate)


@pytest.mark.parametrize(
    ("name", "fitted", "judged", "rms_um"),
    [("dbo", "@0:30", "@30:40", 0.30), ("stage150", "@5:7", "@7:10", 0.070)],
)
def test_predicts_the_rest_of_a_record(name, fitted, judged, rms_um):
    """The issue asks for 0.40 and 0.075 um."""
    stage, report = fit([measured(name, fitted)])
    assert any("time view only" in m for m in report.messages)
    whole, window = measured(name), measured(name, judged)
    # From rest at 0 V through the whole file, scored on the window.
    predicted = predict(stage, whole).axes["x"].x_um[window.scored.start : len(window.t_s)]
    error = window.axes["x"].x_um[window.scored] - predicted
    assert np.sqrt(np.mean(error**2)) < rms_um
    (verdict,) = verify(stage, [window])
    assert verdict.mean_um == pytest.approx(np.abs(error).mean())
    assert verdict.mean_pct < 0.6


def test_a_slower_answer_is_called_lag_only_where_a_jump_allows_it():
    """stage150 answers its switch-on within a millisecond; dbo has no jump inside and lags 17 ms."""
    assert fit([measured("stage150", "@5:7")])[0].axis("x").time.delay_s < 1e-3
    assert 5e-3 < fit([measured("dbo", "@0:30")])[0].axis("x").time.delay_s < 20e-3


def test_memory_beats_a_line_many_times_over():
    record = measured("stage150", "@5:7")
    linear = verify(fit([record], base="linear")[0], [record])[0].mean_um
    assert verify(fit([record])[0], [record])[0].mean_um < linear / 10
