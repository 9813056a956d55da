"""The bench that drives rivals meets the stage as the firmware does."""

from __future__ import annotations

import numpy as np
import pytest
from rival_stages import evidence

import phaselead as pl
from phaselead.sim import built_in
from rivals import RIVALS, drive, paths_for
from rivals.bench import Reference
from rivals.evidence import TICK_S
from rivals.paths import PATHS, Path

SHORT = Path("", 60.0, 20.0, PATHS[0].shape, 4)


class Gains:
    """The published PID, in double precision."""

    def __init__(self, reference):
        from rivals import Pid

        self._pid = Pid(evidence(), SHORT, reference)
        self._pid.gains = (0.017, 8.62, 2.33e-5)

    def step(self, tick, measured_um):
        return self._pid.step(tick, measured_um)


def test_a_rival_moves_the_stage_as_the_same_law_in_the_firmware_does():
    driven = drive(built_in("xyz250"), Gains(Reference(SHORT, 0.03)), SHORT, enter_s=0.03)
    with pl.connect("sim://xyz250?seed=1") as device:
        run = device.track("sine:60um@20Hz", mode="pid", gains="paper", duration=SHORT.seconds, follows="measured")
    period = slice(-250, None)  # the last: each was entered in its own way
    assert driven.ended is None
    assert np.abs(driven.true_um[period] - run.true_um["x"][period]).max() < 0.1  # um; 10 nm of noise each
    assert np.abs(driven.asked_um - driven.true_um)[period].max() > 5  # PID alone lags: the comparison is of something


@pytest.mark.parametrize("name", RIVALS)
def test_every_rival_follows_a_slow_path_on_a_stage_much_like_its_evidence(name):
    path = Path("", 40.0, 2.0, PATHS[0].shape, 2)
    controller = RIVALS[name](evidence(), path, Reference(path, 0.05))
    driven = drive(built_in("xyz250"), controller, path, enter_s=0.05)
    assert driven.ended is None
    error_um = (driven.asked_um - driven.true_um)[2500:]
    assert np.abs(error_um).max() < 0.25 * path.swing_um


def test_a_sensor_at_its_rail_ends_the_run():
    class Full:
        def step(self, tick, measured_um):
            return 10.0 if tick < 50 else -10.0

    driven = drive(built_in("xyz250"), Full(), SHORT, enter_s=0.03)
    assert driven.ended == "rail"
    assert len(driven.true_um) < round(SHORT.seconds / TICK_S)


@pytest.mark.parametrize("stage", ["xyz250", "xyz250-hard", "xy30", "x100", "x500"])
def test_paths_repeat_within_the_stage_and_begin_at_rest(stage):
    axis = built_in(stage).axis("x")
    for path in paths_for(stage):
        t_s = np.linspace(0, 1 / path.f_Hz, 5000)
        assert path(0.0) == pytest.approx(0, abs=0.03 * path.swing_um)
        assert path(t_s).min() == pytest.approx(0, abs=1e-3 * path.swing_um)
        assert path(t_s).max() == pytest.approx(path.swing_um, rel=1e-3)
        assert path.swing_um < 0.5 * axis.sensor.x_max_um
        assert path(t_s + 1 / path.f_Hz) == pytest.approx(path(t_s), abs=1e-6 * path.swing_um)
        assert path(np.arange(1024) / (1024 * path.f_Hz)) == pytest.approx(path.rows())


def test_the_way_into_a_path_does_not_jump():
    into = Reference(PATHS[2], 0.03)
    values = into(np.arange(-0.04, 0.02, 1e-5))
    assert values[0] == 0
    assert np.abs(np.diff(values, 2)).max() / 1e-10 < 1.5 * PATHS[2].swing_um * (2 * np.pi * PATHS[2].f_Hz) ** 2
