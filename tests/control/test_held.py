"""A device that holds a model already, driven without its stage file: limits and gains are those of what it holds."""

import pytest

import phaselead as pl
from phaselead.control.gains import PAPER_GAINS, design_gains
from phaselead.control.held import held_stage
from phaselead.device import device_model
from phaselead.model import AdoptedEffect, AxisModel, Stage, TimeView

AXIS = AxisModel(
    time=TimeView(
        gain_um_per_V=15.0, play_r_V=(0.2, 1.0), play_w_um_per_V=(3.0, 3.0), delay_s=0.0003, u_range_V=(-2.0, 10.0),
        rate_Hz=5000.0,
    ),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 400.0, "zeta": 0.01}),),
)  # fmt: skip
STAGE = Stage(name="stiff", axes={"x": AXIS})
"""One whose loop the paper's gains drive unstable."""


@pytest.fixture
def dev(tmp_path):
    """A new session on a device that holds the model of ``STAGE``, on that stage."""
    path = tmp_path / "stiff.toml"
    STAGE.save(path)
    with pl.connect(f"sim://{path}") as device:
        device.device.upload(device_model(STAGE))
        assert device.model is None
        yield device


@pytest.mark.parametrize("mode", [None, "pid"])
def test_a_move_is_made_with_gains_for_the_held_model(dev, mode):
    """It took the paper's, with which this loop is not stable, and drove the stage into a fault."""
    with pytest.warns(UserWarning, match="does not tell the modes of its model"):
        moved = dev.move(x=50, mode=mode)
    used = dev._mover.gains["x"]
    assert used == design_gains("x", held_stage(dev.device).axes["x"])
    assert used != PAPER_GAINS
    dev.device.wait(0.5)
    assert dev.where().x.x_um == pytest.approx(50, abs=1)
    assert moved.axes["x"].predicted_s is None
    assert (dev.model, dev._mover.stage) == (None, None)


def test_a_hold_too(dev):
    with pytest.warns(UserWarning, match="does not tell the modes"):
        found = dev.hold()
    assert (found.state, found.x.held) == ("running", True)
    dev.device.wait(0.5)
    assert dev.status().state == "running"


def test_the_mode_is_the_best_that_the_held_model_allows(dev):
    with pytest.warns(UserWarning, match="does not tell"):
        dev.move(x=50)
    assert dev._mover.mode == "inverse+pid"


def test_an_axis_that_the_held_model_says_nothing_of_moves_by_feedback(dev):
    assert dev._mover.choose("y", None) == []
    assert (dev._mover.mode, dev._mover.gains["y"]) == ("pid", PAPER_GAINS)
