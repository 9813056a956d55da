"""Gains that suit a stage: the analysis of the loop against a loop stepped in time, designs against their promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.control.feedback_loop import HOLD_S, is_stable, loop_of, plant_response
from phaselead.control.gains import PAPER_GAINS, check_loop, design_gains, parse_gains, with_gains
from phaselead.control.tracking import track
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Gains, TimeView
from phaselead.model.linearised import SmallSignal, small_signal
from phaselead.model.sections import TICK_S
from phaselead.model.stage_file import Stage, save_stage
from phaselead.waveforms.catalogue import parse_wave

MODES = st.tuples(st.floats(80.0, 900.0), st.floats(0.005, 0.1)).map(lambda m: (1.0, *m))


def axis(f_Hz=200.0, zeta=0.02, delay_s=0.0003, slope=15.0, width=6.0, gains=None, **changes):
    view = TimeView(
        gain_um_per_V=slope, play_r_V=(0.2, 1.0), play_w_um_per_V=(width / 2, width / 2), delay_s=delay_s,
        u_range_V=(0.0, 10.0), rate_Hz=5000.0, **changes,
    )  # fmt: skip
    mode = (AdoptedEffect(name="resonance", params={"f_Hz": f_Hz, "zeta": zeta}),) if f_Hz else ()
    return AxisModel(time=view, effects=mode, gains=gains)


def ticks_of(plant: SmallSignal, gains: Gains, ticks: int) -> np.ndarray:
    """The loop in steps of a sixtieth of a tick, explicitly: position (ticks,) after a disturbance of 1 um."""
    ((_, f_Hz, zeta),) = plant.modes
    w, fine = 2 * np.pi * f_Hz, 60
    late = round((max(plant.delay_s - HOLD_S, 0.0) + 30e-6) / TICK_S * fine)
    held = np.zeros(fine * ticks + late + fine)
    x, v, integral, before, seen = 0.0, 0.0, 0.0, None, np.zeros(ticks)
    gain = plant.gain_um_per_V[1]
    for k in range(ticks):
        seen[k] = gain * x + 1.0
        error = -seen[k]
        before = error if before is None else before
        integral += gains.ki_V_per_um_s * TICK_S * error
        u = gains.kp_V_per_um * error + integral + gains.kd_V_s_per_um / TICK_S * (error - before)
        before = error
        held[fine * k + late : fine * (k + 1) + late] = u
        for i in range(fine * k, fine * (k + 1)):
            v += TICK_S / fine * (w * w * (held[i] - x) - 2 * zeta * w * v)
            x += TICK_S / fine * v
    return seen


@pytest.mark.parametrize(("ki", "kd"), [(8.0, 0.0), (2.0, 0.0), (20.0, 2.0e-5), (20.0, 4e-6), (5.0, 9e-5)])
def test_nyquist_agrees_with_the_loop_stepped_in_time(ki, kd):
    gains = Gains(kp_V_per_um=0.0, ki_V_per_um_s=ki, kd_V_s_per_um=kd)
    found = loop_of("x", axis(), gains)
    seen = np.abs(ticks_of(found.plant, gains, 1200))
    assert is_stable(found.open_loop[-1]) == (seen[900:].max() < seen[200:500].max())


@given(mode=MODES, delay_s=st.floats(0.0, 0.002), f_Hz=st.floats(1.0, 40.0))
def test_a_slow_sine_is_late_by_the_models_delay(mode, delay_s, f_Hz):
    """The hold and the latch are in the delay that a fit finds: they are not counted twice."""
    plant = SmallSignal((15.0, 20.0), (mode,), (), delay_s)
    alone = SmallSignal((15.0, 20.0), (mode,), (), HOLD_S)
    ratio = plant_response(plant, np.array([f_Hz])) / plant_response(alone, np.array([f_Hz]))
    late_s = -np.angle(ratio[0]) / (2 * np.pi * f_Hz)
    assert late_s == pytest.approx(max(delay_s - HOLD_S, 0.0), abs=5e-6)


@settings(max_examples=20)
@given(f_Hz=st.floats(80.0, 900.0), zeta=st.floats(0.005, 0.1), delay_s=st.floats(0.0, 0.001), width=st.floats(0, 20))
def test_a_design_keeps_its_promise_over_gains_and_shifted_modes(f_Hz, zeta, delay_s, width):
    gains = design_gains("x", axis(f_Hz, zeta, delay_s, width=width))
    assert gains.ki_V_per_um_s > 0
    for factor in (0.9, 0.93, 1.0, 1.07, 1.1):
        assert loop_of("x", axis(f_Hz * factor, zeta, delay_s, width=width), gains).peak_sensitivity < 2.05


def test_where_no_mode_is_known_the_loop_stands_any_mode_from_100_Hz():
    gains = design_gains("x", axis(f_Hz=None))
    assert gains.kd_V_s_per_um == 0
    assert "no mode is known" in gains.origin
    for f_Hz in (100.0, 130.0, 450.0, 2000.0):
        assert loop_of("x", axis(f_Hz), gains).peak_sensitivity <= 2.05


def test_the_default_is_the_files_then_a_design_then_the_papers():
    own = Gains(kp_V_per_um=0.0, ki_V_per_um_s=2.0, kd_V_s_per_um=0.0)
    stage = Stage(name="s", axes={"x": axis(gains=own), "y": axis(450.0), "z": AxisModel()})
    assert parse_gains(None, stage, "x") == own
    assert "designed" in parse_gains(None, stage, "y").origin
    assert parse_gains(None, stage, "z") == parse_gains(None, None, "x") == PAPER_GAINS
    assert parse_gains("paper", stage, "y") == PAPER_GAINS


def test_gains_of_somebodys_choice_stay_and_designed_ones_follow_the_model():
    own = Gains(kp_V_per_um=0.0, ki_V_per_um_s=2.0, kd_V_s_per_um=0.0)
    before = design_gains("x", axis(200.0))
    stage = with_gains(Stage(name="s", axes={"x": axis(gains=own), "y": axis(450.0, gains=before), "z": axis(None)}))
    assert stage.axes["x"].gains == own
    assert stage.axes["y"].gains == design_gains("y", axis(450.0))
    assert stage.axes["z"].gains is None


def test_a_sensor_that_counts_backwards_is_refused():
    model = AxisModel(time=TimeView(gain_um_per_V=-15.0, u_range_V=(0.0, 10.0), rate_Hz=5000.0))
    with pytest.raises(BadInput, match="backwards"):
        design_gains("x", model)
    with pytest.raises(BadInput, match="backwards"):
        small_signal(model)


def test_a_weak_loop_is_warned_of_and_one_that_runs_away_is_refused():
    paper, weak = PAPER_GAINS, PAPER_GAINS.model_copy(update={"kd_V_s_per_um": 6e-5})
    assert check_loop("x", axis(), paper) is None
    assert "peak sensitivity" in check_loop("x", axis(), weak)
    with pytest.raises(BadInput, match=r"mode at 450 Hz: gain margin -\d+ dB"):
        check_loop("x", axis(450.0), paper)
    assert "not stable" in check_loop("x", axis(450.0), paper, force=True)
    assert check_loop("x", axis(f_Hz=None), paper) is None


def test_gains_of_a_stage_file_are_refused_as_those():
    """Nobody had given --gains that could be left out."""
    weak = PAPER_GAINS.model_copy(update={"kd_V_s_per_um": 2e-4})
    with pytest.raises(BadInput, match=r"take gains out of the stage file \(\[axes\.y\.gains\]\)"):
        check_loop("y", axis(gains=weak), weak)
    with pytest.raises(BadInput, match="leave out --gains"):
        check_loop("y", axis(), weak)


def test_filters_of_amplifier_and_sensor_cost_phase():
    slow = axis().model_copy(
        update={"effects": (*axis().effects, AdoptedEffect(name="sensor_lowpass", params={"tau_s": 5e-4}))}
    )
    assert small_signal(slow).lags_s == (5e-4,)
    gains = design_gains("x", axis())
    assert loop_of("x", slow, gains).peak_sensitivity > loop_of("x", axis(), gains).peak_sensitivity


def test_a_stage_with_its_mode_elsewhere_is_driven_by_the_gains_made_for_it(tmp_path):
    """With the paper's gains this stage ran away within 84 ms."""
    # The simulator adds the hold and the latch to a file's delay; a model counts them in it.
    save_stage(tmp_path / "stage.toml", Stage(name="stage", axes={"x": axis(450.0, delay_s=0.00017)}))
    model = Stage(name="model", axes={"x": axis(450.0)})
    path = {"x": parse_wave("sine:60um@5Hz")}
    with Device.open(f"sim://{tmp_path}/stage.toml") as device:
        with pytest.raises(BadInput, match="not stable"):
            track(device, path, "pid", stage=model, gains={"x": PAPER_GAINS})
        gains = {"x": parse_gains(None, model, "x")}
        run = track(device, path, "inverse+pid", stage=model, gains=gains, duration_s=1.0)
    assert run.figures["max_pct"] < 1
