"""The driver, used as PyMeasure's own procedures use an instrument."""

from __future__ import annotations

import subprocess
import sys

import pytest
from pymeasure.experiment import FloatParameter, Procedure
from pymeasure.instruments import Channel, Instrument

import phaselead as pl
from phaselead.drivers.pymeasure import PhaseleadStage


def test_targets_positions_and_shutdown():
    with PhaseleadStage("sim://xyz250", mode="pid") as stage:
        assert stage.controller.status().state == "parked"
        assert abs(stage.x.position_um) < 1
        stage.x.target_um = 40
        assert abs(stage.x.position_um - 40) < 0.3
        assert stage.x.target_um == 40
        assert stage.x.on_target
        assert stage.x.voltage_V > 1
        with pytest.raises(pl.BadInput, match="outside"):
            stage.x.target_um = stage.x.range_um[1] + 1
        assert stage.x.target_um == 40
        stage.hold()
    assert stage.isShutdown
    assert "closed" in repr(stage.controller)


def test_axes_move_together_by_a_model(tmp_path):
    with pl.connect() as dev:
        pl.fit(dev.record("sine:5V@5Hz", duration=1)).save(tmp_path / "stage.toml")
    with PhaseleadStage(model=tmp_path / "stage.toml") as stage:
        stage.move(x=30)
        stage.move(x=20)
        assert stage.controller.status().modes[0] == "inverse+pid"
        assert abs(stage.x.position_um - 20) < 0.3


def test_it_is_an_instrument_with_channels():
    with PhaseleadStage() as stage:
        assert isinstance(stage, Instrument)
        assert list(stage.channels) == ["x", "y", "z"]
        assert all(isinstance(axis, Channel) for axis in stage.channels.values())


class Scan(Procedure):
    """As a user writes one."""

    step = FloatParameter("Step", units="um", default=10)
    DATA_COLUMNS = ("target (um)", "position (um)")

    def startup(self):
        self.stage = PhaseleadStage("sim://xyz250", mode="pid")

    def execute(self):
        for k in range(3):
            self.stage.x.target_um = k * self.step
            self.emit("results", {"target (um)": k * self.step, "position (um)": self.stage.x.position_um})

    def shutdown(self):
        self.stage.shutdown()


def test_a_procedure_scans():
    rows, scan = [], Scan()
    scan.emit = lambda topic, record: rows.append(record)
    scan.startup()
    scan.execute()
    scan.shutdown()
    assert [abs(row["position (um)"] - row["target (um)"]) < 0.3 for row in rows] == [True] * 3


def test_phaselead_itself_does_without():
    program = "import sys, phaselead as pl; pl.connect; import phaselead.drivers; assert 'pymeasure' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
