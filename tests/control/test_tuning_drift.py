"""A stage that drifts while its response is measured in open loop: what the drift is, is taken out."""

import numpy as np

from phaselead.control.tuning.course import FINE
from phaselead.control.tuning.response import measure
from phaselead.device import Device
from phaselead.model import load_stage
from phaselead.model.axis import AdoptedEffect
from phaselead.sim import built_in

TEN_um_PER_MIN = {"rise_um": 50.0, "tau_s": 300.0}
TEN_TIMES = {"k": (0.08, 0.12, 0.16), "tau_s": (0.1, 1.0, 10.0)}
"""Creep of 12 % of a step a decade."""


def response(folder, **drifts):
    stage = built_in("xyz250")
    effects = [one for one in stage.axes["x"].effects if one.name != "creep"]
    effects += [AdoptedEffect(name=name, params=params) for name, params in drifts.items()]
    axis = stage.axes["x"].model_copy(update={"effects": tuple(effects)})
    stage.model_copy(update={"axes": {**stage.axes, "x": axis}}).save(folder / "stage.toml", overwrite=True)
    with Device.open(f"sim://{folder}/stage.toml") as device:
        return measure(device, "x", FINE, swing=0.2, middle=4.0, stage=load_stage(folder / "stage.toml"))


def test_a_drift_of_10_um_a_minute_costs_no_line_and_no_accuracy(tmp_path):
    """Half a period at either end kept its slope: the lowest lines were 6 % off, and one was lost."""
    still, drifting = response(tmp_path), response(tmp_path, thermal_drift=TEN_um_PER_MIN)
    assert drifting.reliable().all()
    assert np.abs(drifting.gain / still.gain - 1).max() < 0.005
    assert drifting.levels_dB()["noise"] < still.levels_dB()["noise"] + 3


def test_ten_times_the_creep_of_piezo_stages_costs_lines_below_2_Hz_alone(tmp_path):
    """Creep answers to the multisine too, so that the lowest lines differ by what it truly adds."""
    still, creeping = response(tmp_path), response(tmp_path, creep=TEN_TIMES)
    assert creeping.reliable()[creeping.f_Hz > 2].all()
    s = 2j * np.pi * creeping.f_Hz
    added = 1 + sum(k / (tau_s * s + 1) for k, tau_s in zip(*TEN_TIMES.values(), strict=True))
    off = np.abs(creeping.gain / (still.gain * added) - 1)[creeping.reliable()]
    assert off.max() < 0.05
    assert np.median(off) < 0.002
