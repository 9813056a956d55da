"""A stage file that names its recordings is played as the model says, a virtual stage as its delay says."""

from __future__ import annotations

import numpy as np
import pytest

import phaselead as pl
from phaselead.model import HOLD_S, Provenance, Stage
from phaselead.model.prediction import predict
from phaselead.model.stage_file import DataSource
from phaselead.sim import built_in, virtual_stage

FITTED = Provenance(data=(DataSource(file="a.csv", sha256="0" * 64),))
SWING_V, F_HZ = 6.0, 40.0


def late_s(played: Stage, model: Stage, folder) -> float:
    """By how much later than ``model`` predicts, the file of ``played`` answers a sine."""
    path = folder / "played.toml"
    played.save(path, overwrite=True)
    with pl.connect(f"sim://{path}") as dev:
        record = dev.record(f"sine:{SWING_V}V@{F_HZ}Hz", duration=0.5)
    x, expected = record.axes["x"].x_um, predict(model, record).axes["x"].x_um
    assert x is not None
    assert expected is not None
    steady = slice(-round(2 * record.rate_Hz / F_HZ), None)
    wave = np.exp(-2j * np.pi * F_HZ * record.t_s[steady])
    return float(np.angle((expected[steady] @ wave) / (x[steady] @ wave)) / (2 * np.pi * F_HZ))


@pytest.mark.parametrize("delay_s", [1.5e-4, 4e-4])
def test_a_fitted_stage_is_as_late_as_its_recordings_were(tmp_path, delay_s):
    stage = built_in("xyz250")
    axes = {
        a: m.model_copy(update={"time": m.time.model_copy(update={"delay_s": delay_s})}) for a, m in stage.axes.items()
    }
    virtual = stage.model_copy(update={"axes": axes})
    fitted = virtual.model_copy(update={"provenance": FITTED})
    assert late_s(fitted, fitted, tmp_path) == pytest.approx(0.0, abs=5e-6)
    assert late_s(virtual, fitted, tmp_path) == pytest.approx(HOLD_S, abs=5e-6)
    assert late_s(virtual_stage(fitted), fitted, tmp_path) == pytest.approx(0.0, abs=5e-6)


def test_a_delay_shorter_than_what_the_output_holds_is_none():
    stage = built_in("xyz250")
    x = stage.axes["x"]
    short = x.model_copy(update={"time": x.time.model_copy(update={"delay_s": HOLD_S / 2})})
    virtual = virtual_stage(stage.model_copy(update={"axes": {"x": short}, "provenance": FITTED}))
    assert virtual.axes["x"].time.delay_s == 0.0
    assert virtual.provenance == Provenance()
