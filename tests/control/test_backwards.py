"""A stage whose sensor counts backwards: what can be done with it is done, and what cannot says the true reason."""

from __future__ import annotations

import pytest

import phaselead as pl
from phaselead.control import lacking_gains
from phaselead.control.gains import gains_in_mode
from phaselead.model import AdoptedEffect, AxisModel, Sensor, Stage, TimeView

MODE = AdoptedEffect(name="resonance", params={"f_Hz": 150.0, "zeta": 0.04, "c": 1.0})
VIEW = TimeView(gain_um_per_V=-10.0, play_r_V=(0.5,), play_w_um_per_V=(-1.0,), u_range_V=(0.0, 5.0), rate_Hz=5000.0)
STAGE = Stage(
    name="backwards",
    axes={"x": AxisModel(time=VIEW, effects=(MODE,), sensor=Sensor(x_min_um=-150.0, x_max_um=50.0))},
)


@pytest.fixture(name="dev")
def _dev(tmp_path):
    STAGE.save(tmp_path / "stage.toml", overwrite=True)
    with pl.connect(f"sim://{tmp_path / 'stage.toml'}") as dev:
        yield dev


def test_it_is_driven_in_volts(dev):
    """Mode open was refused for want of gains, which it does not use."""
    run = dev.track("sine:2V@5Hz", mode="open", model=STAGE, duration=0.4)
    assert run.x_um.min() < -15
    with pytest.raises(pl.BadInput, match="paper, or KP,KI,KD"):
        dev.track("sine:2V@5Hz", mode="open", model=STAGE, gains="none", duration=0.4)


@pytest.mark.parametrize("mode", ["inverse", "inverse+pid", "ff", "ff+pid", "pid"])
def test_other_modes_say_why_not(dev, mode):
    with pytest.raises(pl.BadInput, match="its sensor counts backwards") as refused:
        dev.track("sine:20um@5Hz", mode=mode, model=STAGE, duration=0.4)
    assert "--gains" not in str(refused.value)
    assert "use mode pid" not in str(refused.value)


def test_lacking_gains_have_their_true_reason():
    """A mode was found, and the records were said to show none."""
    (line,) = lacking_gains(STAGE)
    assert line.startswith("axis x: no gains, since its sensor counts backwards")
    assert "swap its polarity" in line


@pytest.mark.parametrize("mode", ["inverse", "ff", "open"])
def test_modes_without_feedback_take_no_gains_for_nothing(mode):
    gains = gains_in_mode(mode, None, STAGE, "x")
    assert (gains.kp_V_per_um, gains.ki_V_per_um_s, gains.kd_V_s_per_um) == (0, 0, 0)
