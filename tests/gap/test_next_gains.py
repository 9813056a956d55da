"""Gains in the next model: designed ones follow it, somebody's choice stays."""

from phaselead.control.gains import design_gains, with_gains
from phaselead.gap.adopt import next_stage
from phaselead.gap.run import _gains_that_stay
from phaselead.model.axis import AdoptedEffect, AxisModel, Gains, TimeView
from phaselead.model.loop_filter import LoopFilter
from phaselead.model.stage_file import Stage


def axis(f_Hz, gains=None):
    view = TimeView(gain_um_per_V=15.0, delay_s=0.0003, u_range_V=(0.0, 10.0), rate_Hz=5000.0)
    mode = AdoptedEffect(name="resonance", params={"f_Hz": f_Hz, "zeta": 0.02})
    return AxisModel(time=view, effects=(mode,), gains=gains)


def test_designed_gains_follow_a_mode_that_moved():
    before = with_gains(Stage(name="s", axes={"x": axis(200.0)}))
    moved = before.axes["x"].model_copy(update={"effects": axis(450.0).effects})
    assert next_stage(before, {"x": moved}, []).axes["x"].gains == design_gains("x", axis(450.0))


def test_chosen_and_tuned_gains_and_none_stay():
    own = Gains(kp_V_per_um=0.0, ki_V_per_um_s=2.0, kd_V_s_per_um=0.0)
    notch = LoopFilter(zeros_Hz=200.0, zeros_zeta=0.02, poles_Hz=200.0, poles_zeta=1.0)
    tuned = own.model_copy(update={"origin": "tuned on sim://xyz250", "filters": (notch,)})
    for gains in (own, tuned, None):
        before = Stage(name="s", axes={"x": axis(200.0, gains)})
        assert next_stage(before, {"x": axis(450.0, gains)}, []).axes["x"].gains == gains


def test_what_the_next_model_says_against_gains_that_stay_is_told_once():
    """Of an axis that changed, and not of what was so before."""
    wild = Gains(kp_V_per_um=0.0, ki_V_per_um_s=60.0, kd_V_s_per_um=0.0)
    calm = Gains(kp_V_per_um=0.0, ki_V_per_um_s=4.0, kd_V_s_per_um=0.0)
    before = Stage(name="s", axes={"x": axis(200.0, calm), "y": axis(200.0, wild)})
    assert not _gains_that_stay(before, before)
    slower = before.axes["x"].model_copy(update={"effects": axis(20.0).effects})
    (line,) = _gains_that_stay(before, before.model_copy(update={"axes": {**before.axes, "x": slower}}))
    assert line.startswith("x: the loop on the model")
    assert "chosen or tuned before; `phaselead tune`" in line
    designed = with_gains(Stage(name="s", axes={"x": axis(200.0)}))
    assert not _gains_that_stay(before, designed)


def test_an_axis_without_gains_stays_so_beside_one_whose_gains_were_designed():
    before = with_gains(Stage(name="s", axes={"x": axis(200.0)}))
    before = before.model_copy(update={"axes": {**before.axes, "y": axis(300.0)}})
    found = next_stage(before, {"x": before.axes["x"].model_copy(update={"effects": axis(450.0).effects})}, [])
    assert found.axes["x"].gains == design_gains("x", axis(450.0))
    assert found.axes["y"].gains is None
