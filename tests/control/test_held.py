"""A device that holds a model already, driven without its stage file: limits and gains are those of what it holds."""

import warnings

import pytest

import phaselead as pl
from phaselead.control.gains import PAPER_GAINS, design_gains
from phaselead.control.held import held_stage
from phaselead.device import device_model
from phaselead.model import AdoptedEffect, AxisModel, Sensor, Stage, TimeView

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
    STAGE.save(path, overwrite=True)
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


def test_a_move_on_a_path_has_the_limits_of_the_held_model(dev):
    """It was refused by the 1000 um/s that are assumed where no model is."""
    run = dev.track("goto:100um@0.05s", mode="inverse", duration=0.2)
    assert run.x_um[-1] == pytest.approx(100, abs=5)


@pytest.mark.parametrize("drive", ["track", "move"])
def test_a_refusal_says_that_the_limit_is_assumed(drive):
    with pl.connect() as device:
        with pytest.raises(pl.BadInput, match=r"1000 um/s, assumed.*the shortest is 18[78].* ms.*--model") as refusal:
            device.track("goto:100um@0.05s", mode="pid") if drive == "track" else device.move(x=100, duration=0.05)
        assert "\n" not in str(refusal.value)


def test_micrometres_are_by_the_model_that_was_uploaded_last(dev):
    """The calibration was read once and kept, whatever was uploaded after it."""
    before = dev.where().x
    shifted = AXIS.model_copy(update={"sensor": Sensor(x_min_um=90.0, x_max_um=370.0)})
    dev.device.upload(device_model(Stage(name="shifted", axes={"x": shifted})))
    assert dev.where().x.x_um == pytest.approx(before.x_um + 100, abs=0.2)
    assert dev.status().axes["x"].x_um == pytest.approx(before.x_um + 100, abs=0.2)


@pytest.fixture
def unringing(tmp_path):
    """A device with a stage whose model shows no mode."""
    stage = Stage(name="slow", axes={"x": AXIS.model_copy(update={"effects": ()})})
    stage.save(tmp_path / "slow.toml")
    with pl.connect(f"sim://{tmp_path / 'slow.toml'}") as device:
        yield device, stage


def test_gains_for_a_model_without_a_mode_are_said_to_be_low(unringing):
    """Half of the path was error, and nothing said why."""
    device, stage = unringing
    with pytest.warns(UserWarning, match="x: the model shows no mode: gains are low.* `phaselead tune`"):
        device.track("sine:30um@5Hz", mode="pid", model=stage, duration=0.4)
    chosen = pl.Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)
    tuned = chosen.model_copy(update={"origin": "tuned on the measured response for peak sensitivity 2.0"})
    for gains in (chosen, tuned):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            device.track("sine:30um@5Hz", mode="pid", model=stage, gains=gains, duration=0.4)


def test_an_upload_says_what_the_device_holds_no_inverse_of(unringing):
    device, stage = unringing
    steep = stage.axes["x"].time.model_copy(update={"gain_um_per_V": 1e5})
    with pytest.warns(UserWarning, match="axis x: uploaded without an inverse of its model: .*gain_um_per_V"):
        device.upload(Stage(name="steep", axes={"x": AxisModel(time=steep)}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        device.upload(stage)
        device.upload(Stage(name="limits alone", axes={"x": AxisModel()}))
