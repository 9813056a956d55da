"""Closing the loop: a stage with an effect, driven by a model without it and by one with it."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phaselead.control.tracking import check_paths, track
from phaselead.control.true_position import followed
from phaselead.device.device import Device
from phaselead.device.encode_model import inverse_refusal
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Gains, Limits, TimeView
from phaselead.model.effects import catalogue
from phaselead.model.inverse import PLAYS, compensation, coupling
from phaselead.model.operator import respond, rest_plays, rest_position_um
from phaselead.model.stage_file import Stage, save_stage
from phaselead.waveforms.catalogue import parse_waves

STAIRCASE_s = 0.00012
"""What a held, latched output is late of the straight line between ticks that models are fitted on."""
SENSOR = ("sensor_lowpass", {"tau_s": 8e-5})
GENTLE = Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)

# AdoptedEffect, path, and by what factor the rms error falls at least: less than half of what was measured.
CASES = [
    ("delay", {"delay_s": 1e-3}, "sine:60um@20Hz", 20),
    ("amplifier_lowpass", {"tau_s": 5e-4}, "sine:60um@20Hz", 25),
    ("sensor_lowpass", {"tau_s": 5e-4}, "sine:60um@20Hz", 25),
    ("resonance", {"f_Hz": 150.0, "zeta": 0.02}, "triangle:60um@20Hz", 6),
    ("hysteresis", {"width": 0.12}, "sine:60um@5Hz", 100),
    ("asymmetric_hysteresis", {"bend": 0.03}, "sine:60um@5Hz", 25),
    ("cross_coupling", {"from_y": 0.04}, "x=sine:60um@5Hz,y=sine:60um@7Hz", 25),
    ("creep", {"gamma": 0.03}, "goto:60um", 60),
    ("gain_change", {"gain": 0.05}, "sine:60um@5Hz", 25),
    ("offset", {"offset_um": 2.0}, "sine:60um@5Hz", 25),
]


def view(delay_s=0.0, **changes):
    shape = dict(
        gain_um_per_V=15.0, play_r_V=(0.1, 0.4, 1.0), play_w_um_per_V=(1.5, 1.0, 1.5), deadzone_d_V=(2.0, 5.0),
        deadzone_s_um_per_V=(1.0, -1.5), u_range_V=(-2.0, 10.0), rate_Hz=5000.0, delay_s=delay_s,
    )  # fmt: skip
    return TimeView(**(shape | changes))


def axis(*effects, delay_s=0.0, **changes):
    return AxisModel(
        time=view(delay_s, **changes),
        effects=tuple(AdoptedEffect(name=name, params=params) for name, params in effects),
    )


def stage(*effects, delay_s=0.0, **changes):
    return Stage(name="s", axes={"x": axis(*effects, delay_s=delay_s, **changes), "y": axis(SENSOR, delay_s=delay_s)})


def error_um(path, wave, model, mode):
    waveforms = parse_waves(wave)
    seconds = 8.0 if "goto" in wave else None
    gains = dict.fromkeys(waveforms, GENTLE) if mode == "inverse+pid" else None
    with Device.open(f"sim://{path}") as device:
        waveforms = followed(waveforms, model, "measured", mode)
        run = track(device, waveforms, mode, stage=model, gains=gains, duration_s=seconds)
    return run.figures.get("axes", {"x": run.figures})["x"]["rms_um"]


def both(tmp_path, name, params, wave, mode):
    """Error without and with the effect in the model."""
    others = [] if name == SENSOR[0] else [SENSOR]
    path = tmp_path / "truth.toml"
    save_stage(path, stage(*others, (name, params)))
    models = [stage(*others, delay_s=STAIRCASE_s), stage(*others, (name, params), delay_s=STAIRCASE_s)]
    return [error_um(path, wave, model, mode) for model in models]


@pytest.mark.parametrize(("name", "params", "wave", "factor"), CASES, ids=[case[0] for case in CASES])
def test_knowing_the_effect_makes_tracking_better(tmp_path, name, params, wave, factor):
    without, known = both(tmp_path, name, params, wave, "inverse")
    assert known < without / factor


def test_knowing_the_bend_of_the_field_makes_tracking_better(tmp_path):
    path = tmp_path / "truth.toml"
    save_stage(path, stage(SENSOR, field_bend=0.08))
    without, known = (
        error_um(path, "sine:60um@5Hz", stage(SENSOR, delay_s=STAIRCASE_s, field_bend=bend), "inverse")
        for bend in (0.0, 0.08)
    )
    assert known < without / 7


@pytest.mark.parametrize("name", ["delay", "resonance", "hysteresis", "cross_coupling"])
def test_with_feedback_too(tmp_path, name):
    _, params, wave, _ = next(case for case in CASES if case[0] == name)
    without, known = both(tmp_path, name, params, wave, "inverse+pid")
    assert known < without / 3


def test_the_catalogue_says_compensated_of_what_is_built():
    compensated = {name for name, entry in catalogue().items() if entry.compensated}
    assert {case[0] for case in CASES} == compensated - {"load_change", "fading_hysteresis"}


def test_loops_that_fade_are_compensated_beside_feedback(tmp_path):
    """By plays of the same loops: in open loop the level drifts by what these remember and those forget."""
    without, known = both(tmp_path, "fading_hysteresis", {"width": 0.12}, "sine:60um@5Hz", "inverse+pid")
    assert known < without / 3


@settings(max_examples=30, deadline=None)
@given(st.integers(PLAYS + 1, 80), st.floats(-1, 1), st.integers(0, 10**6))
@example(PLAYS + 1, 0.5, 1)
def test_more_plays_than_the_device_holds_become_fewer(count, rest_fraction, seed):
    rng = np.random.default_rng(seed)
    r, w = np.cumsum(rng.uniform(0.01, 0.1, count)), rng.uniform(0.01, 0.2, count)
    many = axis(play_r_V=tuple(r), play_w_um_per_V=tuple(w), rest_fraction=rest_fraction)
    few = compensation(many).view
    assert len(few.play_r_V) == PLAYS
    assert rest_position_um(few) == pytest.approx(rest_position_um(many.time))
    turns_V = np.concatenate([[0.0, -20.0, 20.0], rng.uniform(-10, 10, 6), [-20.0, 20.0]])
    u = np.interp(np.arange(1001) / 100, np.arange(11), turns_V)
    apart_um = respond(many.time, u, rest_plays(many.time))[0] - respond(few, u, rest_plays(few))[0]
    assert np.abs(apart_um[[100, 200, 900, 1000]]).max() < 1e-9  # at the ends of a large loop
    if count == PLAYS + 1:  # after a turn the heavier of two waits that much longer or shorter: so for the best pair
        lag_um = 2 * w[:-1] * w[1:] / (w[:-1] + w[1:]) * np.diff(r)
        assert np.abs(apart_um).max() <= lag_um.min() + 1e-9


def test_a_load_moves_the_notch():
    mode = {"f_Hz": 200.0, "zeta": 0.02}
    loaded = compensation(axis(("resonance", mode), ("load_change", {"mass": 0.44})))
    lower = compensation(axis(("resonance", {"f_Hz": 200.0 / 1.2, "zeta": 0.02 / 1.2})))
    assert loaded.shape[0].b == pytest.approx(lower.shape[0].b)


@pytest.mark.parametrize(
    ("model", "told"),
    [
        (AxisModel(), "it has no time view"),
        (axis(gain_um_per_V=0.0, deadzone_d_V=(), deadzone_s_um_per_V=()), "falls or stands still at -2 V"),
        (axis(deadzone_s_um_per_V=(1.0, -17.0)), "falls or stands still at 5 V"),
        (axis(("resonance", {"c": 2.5, "f_Hz": 300.0, "zeta": 0.02})), "zero in the right half-plane"),
        (
            axis(("resonance", {"c": [0.5, 0.2], "f_Hz": [300.0, 400.0], "zeta": [0.02] * 2, "velocity": [0.1, 0.0]})),
            "its modes are shared with other axes",
        ),
        (axis(("creep", {"k": [0.3, 0.3], "tau_s": [1.0, 10.0]})), "its creep adds 0.6"),
        (axis(delay_s=0.5), "a preview of 0.5 s does not fit the device: it looks ahead at most 0.205 s"),
        (
            axis(deadzone_d_V=[0.1 * i for i in range(1, 26)], deadzone_s_um_per_V=[0.1] * 25),
            "it has 25 dead zones, the device holds 24",
        ),
        (
            axis(("resonance", {"c": [0.1] * 7, "f_Hz": [100.0 * i for i in range(1, 8)], "zeta": [0.02] * 7})),
            "it has 7 sections for low-passes and modes, the device holds 6",
        ),
    ],
)
def test_what_has_no_inverse_says_why(model, told):
    assert told in str(inverse_refusal(model))
    with pytest.raises(BadInput, match="needs an inverse of the model") as refusal:
        check_paths(parse_waves("sine:20um@5Hz", "x"), "inverse", Stage(name="s", axes={"x": model}))
    assert told in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_shared_modes_couple_by_what_they_pass_on_at_rest():
    modal = {
        "f_Hz": [300.0, 400.0],
        "zeta": [0.02] * 2,
        "from_y": [0.25, 0.5],
        "velocity_y": [0.1, 0.2],
        "direct_y": -0.5,
    }
    plain = stage(("cross_coupling", {"from_y": 0.25}))
    assert coupling(stage(("cross_coupling", modal)))[0] == coupling(plain)[0] == [1.0, 0.25, 0.0]


def test_a_stage_that_falls_only_beyond_its_limits_has_an_inverse():
    model = axis(deadzone_s_um_per_V=(1.0, -17.0)).model_copy(update={"limits": Limits(u_max_V=5.0)})
    assert inverse_refusal(model) is None


@pytest.mark.parametrize("mode", ["inverse", "pid"])
def test_a_path_beyond_what_the_model_reaches_is_refused_before_anything_moves(mode):
    """Under feedback alone it stood at the output's limit, and ended in a fault while it was driven."""
    with pytest.raises(BadInput, match="outside what the model can reach"):
        check_paths(parse_waves("sine:260um@5Hz", "x"), mode, stage())


def test_an_effect_that_is_there_twice_is_undone_twice():
    """A search finds more of what a stage file has already: both act, so both are undone."""
    once, twice = compensation(axis(SENSOR)), compensation(axis(SENSOR, SENSOR))
    assert twice.shape[:-1] == 2 * once.shape[:-1]  # the last one levels what they leave
    assert twice.preview_s > once.preview_s
    lags = compensation(axis(("amplifier_lowpass", {"tau_s": 5e-4}), ("amplifier_lowpass", {"tau_s": 3e-4})))
    assert lags.drive != compensation(axis()).drive
    assert len(lags.shape) == 2
    creeps = compensation(axis(("creep", {"gamma": 0.02}), ("creep", {"gamma": 0.01})))
    assert len(creeps.creep_k) == 8
    assert sum(creeps.creep_k) == pytest.approx(sum(compensation(axis(("creep", {"gamma": 0.03}))).creep_k), rel=1e-3)
    modes = [("resonance", {"f_Hz": f_Hz, "zeta": 0.03}) for f_Hz in (150.0, 400.0)]
    assert len(compensation(axis(*modes)).shape) == 3
