"""Paths that no output is fast enough for are refused before anything moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.control.motion_limits import motion_limits
from phaselead.control.path_speed import refuse_path_too_fast
from phaselead.control.tracking import track
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model import AxisModel, Gains
from phaselead.sim import built_in
from phaselead.waveforms import parse_wave

GAINS = {"x": Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)}
X = built_in("xyz250").axes["x"]
TICK_S = 0.0002


def streamed(folder, t_s, x_um):
    path = folder / "path.csv"
    np.savetxt(path, np.column_stack([t_s, x_um]), delimiter=",", header="t_s,x_um", comments="", fmt="%.9g")
    return parse_wave(f"path:{path}")


@given(values=st.lists(st.floats(0, 100), min_size=3, max_size=12).filter(lambda v: np.ptp(v) > 0.1), data=st.data())
def test_the_fastest_stretch_is_that_of_every_place_tried(values, data, tmp_path_factory):
    gaps = data.draw(st.lists(st.floats(1e-5, 1e-3), min_size=len(values) - 1, max_size=len(values) - 1))
    t_s = np.round(np.concatenate([[0.0], np.cumsum(gaps)]), 8)
    wave = streamed(tmp_path_factory.mktemp("fast"), t_s, values)
    tried_s = np.linspace(-TICK_S, t_s[-1], 5001)
    ways = np.abs(wave._at(tried_s + TICK_S) - wave._at(tried_s))
    rate, at_s = wave.fastest(TICK_S)
    assert rate >= ways.max() / TICK_S * (1 - 1e-9)
    assert rate == pytest.approx(np.abs(wave._at(at_s + TICK_S) - wave._at(at_s)) / TICK_S, rel=1e-6) or at_s == 0
    assert rate <= np.abs(np.diff(wave.values) / np.diff(wave.times_s)).max() * (1 + 1e-9)


@pytest.mark.parametrize(("share", "refused"), [(0.95, False), (1.05, True)])
def test_the_limit_of_a_known_stage_is_its_slew_limit_times_its_gain(tmp_path, share, refused):
    ramp_s = 20 / (share * motion_limits(X).velocity_um_per_s)
    wave = streamed(tmp_path, [0, 1, 1 + ramp_s, 2], [10, 10, 30, 30])
    if not refused:
        return refuse_path_too_fast("x", wave, X)
    with pytest.raises(BadInput, match=r"x: it goes at \d+ um/s at 1.*s; .* let it take longer there"):
        refuse_path_too_fast("x", wave, X)


@pytest.mark.parametrize("wave", ["sine:60um@300Hz", "triangle:200um@100Hz"])
def test_without_a_model_it_is_that_of_the_whole_span(wave):
    """The sine tripped the error limit on the way, the triangle was left by 42 %, without a word."""
    with Device.open("sim://xyz250") as device:
        with pytest.raises(BadInput, match="as far as is known without --model"):
            track(device, {"x": parse_wave(wave)}, "pid", gains=GAINS)
        assert device.status().state == "parked"


@pytest.mark.parametrize("wave", ["square:40um@3Hz", "goto:60um", "sine:60um@100Hz", "staircase:60um/12@0.5Hz"])
def test_what_may_jump_or_is_slow_enough_is_not_refused(wave):
    refuse_path_too_fast("x", parse_wave(wave), AxisModel())
