"""The chain: physical order, memory of what was computed, starts, and predictions through it."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, PIEZO, RATE_HZ, axis, rich, run, times
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel
from phaselead.model.chain import Chain, simulate
from phaselead.model.effects import catalogue, effect
from phaselead.model.effects.interface import Place
from phaselead.model.operator import ends_um, plays, predict_time_view, range_um, rest_plays
from phaselead.model.prediction import predict
from phaselead.model.stage_file import Stage
from phaselead.record.recording import AxisRecord, Recording
from phaselead.sim.device import Plant
from phaselead.sim.plant import LATCH_S, built_in, plant_parameters

NAMES = [name for name in catalogue() if name != "load_change"]
several = st.lists(st.sampled_from(NAMES), min_size=2, max_size=4, unique=True)


def chosen(names: list[str]) -> list:
    return [(effect(name), effect(name).typical) for name in names]


def test_without_effects_it_is_the_time_view_to_the_last_bit():
    u, t = rich(), times(1.5)
    assert np.array_equal(simulate(axis(PIEZO), t, u), predict_time_view(PIEZO, t, u))
    start = [0.2, -0.5, 1.0]
    continued = predict_time_view(PIEZO, t, u, initial_plays_V=start)
    assert np.array_equal(simulate(axis(PIEZO), t, u, start=start), continued)


def test_physical_order():
    """Each stage sees what comes before it and nothing of what comes after."""
    order = (
        *("dac_nonlinearity", "delay", "crossover_distortion", "slew_limit", "amplifier_lowpass", "saturation"),
        *("charge_leakage", "dead_band"),
        *("hysteresis", "fading_hysteresis", "asymmetric_hysteresis", "rate_dependence", "softening", "creep"),
        *("backlash", "resonance"),
        *(
            "stiffness_nonlinearity",
            "cross_coupling",
            "gain_change",
            "offset",
            "sensor_lowpass",
            "sensor_nonlinearity",
            "sampling_jitter",
        ),
        *("quantisation", "thermal_drift", "mains_hum", "vibration"),
    )
    by_hand = sorted(NAMES, key=lambda name: (effect(name).place, effect(name).order))
    assert tuple(by_hand) == order


def test_saturation_comes_after_the_slew_limit_and_the_sensor_after_the_mechanics():
    u = np.concatenate([np.zeros(10), np.full(200, 10.0)])
    x = simulate(axis(), np.arange(210) / RATE_HZ, u, extra=chosen(["saturation", "slew_limit"]))
    assert x.max() == pytest.approx(95.0)
    assert np.diff(x).max() * RATE_HZ == pytest.approx(10_000, rel=1e-3)  # rows give the corners between them too
    chain = Chain(axis(LINEAR, MODE), times(1.5), rich())
    mechanics = chain.signal_at(Place.MECHANICS).value
    through = effect("sensor_lowpass").apply(chain.signal_at(Place.SENSOR), {"tau_s": 0.01})
    assert np.array_equal(chain.signal_at(Place.SENSOR).value, mechanics)
    assert np.array_equal(chain.run([(effect("sensor_lowpass"), {"tau_s": 0.01})]), through[1:])


@settings(max_examples=15, deadline=None)
@given(several, st.randoms(use_true_random=False))
def test_the_order_of_mention_does_not_matter(names, random):
    mixed = random.sample(names, len(names))
    u, t = rich(600), times(0.3)
    assert np.array_equal(
        simulate(axis(PIEZO), t, u, extra=chosen(names)), simulate(axis(PIEZO), t, u, extra=chosen(mixed))
    )


@settings(max_examples=15, deadline=None)
@given(several)
def test_adopted_is_as_good_as_extra(names):
    adopted = axis(PIEZO, *(AdoptedEffect(name=name, params=effect(name).typical) for name in names))
    u, t = rich(600), times(0.3)
    assert np.array_equal(simulate(adopted, t, u), simulate(axis(PIEZO), t, u, extra=chosen(names)))


@settings(max_examples=15, deadline=None)
@given(st.lists(several, min_size=3, max_size=6))
def test_what_it_remembers_changes_nothing(runs):
    u, t = rich(600), times(0.3)
    chain = Chain(axis(PIEZO, MODE), t, u, remember=6)
    for names in runs:
        found = chain.run(chosen(names))
        assert np.array_equal(found, simulate(axis(PIEZO, MODE), t, u, extra=chosen(names)))
        found[:] = np.nan  # a caller's own copy


def test_other_sizes_are_not_taken_for_known_ones():
    chain = Chain(axis(PIEZO), times(1.5), rich())
    for gamma in (0.01, 0.02, 0.01):
        extra = [(effect("creep"), {"gamma": gamma})]
        assert np.array_equal(chain.run(extra), simulate(axis(PIEZO), times(1.5), rich(), extra=extra))


def test_it_remembers(monkeypatch):
    chain = Chain(axis(PIEZO), times(1.5), rich())
    chain.run()
    monkeypatch.setattr("phaselead.model.operator.PreparedOperator.respond", None)
    chain.run([(effect("creep"), {"gamma": 0.01})])
    with pytest.raises(TypeError):
        chain.run([(effect("delay"), {"delay_s": 0.01})])


def test_a_continuation_starts_where_things_stood():
    """Split anywhere, the second half continues the first: plays handed over, lags settled at the split."""
    u = rich()
    u[1400:1600] = 3.0
    v = np.concatenate([[0.0], u])
    model = axis(
        PIEZO.model_copy(update={"delay_s": 0.0}), AdoptedEffect(name="sensor_lowpass", params={"tau_s": 0.001})
    )
    _, end = plays(v[:1501], PIEZO.play_r_V, rest_plays(PIEZO))
    whole = simulate(model, times(1.5), u)
    assert np.allclose(simulate(model, times(0.75), u[1500:], start=end), whole[1500:], atol=1e-9)


def test_other_axes_can_come_later():
    t, u, moved = times(1.5), rich(), {"y": 10 * np.sin(np.arange(3000) / 50)}
    extra = chosen(["cross_coupling", "creep"])
    chain = Chain(axis(PIEZO), t, u)
    alone = chain.run(extra)
    assert np.array_equal(
        chain.with_others(moved).run(extra), simulate(axis(PIEZO), t, u, others_um=moved, extra=extra)
    )
    assert np.array_equal(chain.run(extra), alone)


@pytest.mark.parametrize(("bend", "tilt", "taper"), [(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (-0.1, 0.4, 0.3)])
@pytest.mark.parametrize("widest", [1.0, 4.9, 8.0])
def test_the_range_is_that_of_a_full_slow_loop(widest, bend, tilt, taper):
    uneven = {"field_bend": bend, "play_tilt": tilt, "play_taper": taper}
    view = PIEZO.model_copy(update={"play_r_V": (0.3, 0.9, widest), **uneven})
    low, high = view.u_range_V
    middle_V = (view.field.at(low) + view.field.at(high)) / 2
    loop = np.concatenate([np.linspace(0, high, 50), *[np.linspace(high, low, 50), np.linspace(low, high, 50)] * 2])
    x = simulate(axis(view), np.arange(len(loop)) * 10.0, loop, start=[0.0, 0.0, middle_V])[50:]
    assert range_um(axis(view)) == pytest.approx(np.ptp(x))
    assert ends_um(axis(view)) == pytest.approx((x.min(), x.max()))


def test_a_single_row():
    assert run(axis(LINEAR, MODE), np.array([0.0])) == pytest.approx([0.0])


def test_an_axis_without_a_time_view_is_refused():
    with pytest.raises(BadInput, match="has no time view"):
        simulate(AxisModel(), times(0.1), np.zeros(200))


@pytest.mark.parametrize(
    ("name", "params", "words"),
    [
        ("creep", {"k": [0.1, 0.2], "tau_s": [1.0]}, "as many elements"),
        ("creep", {"k": 0.1}, "go together"),
        ("resonance", {"f_Hz": [100.0, 200.0], "zeta": [0.1, 0.1]}, "one of each per mode"),
        ("resonance", {"f_Hz": 0.0, "zeta": 0.1}, "above 0"),
        ("sensor_lowpass", {"corner_Hz": 0.0}, "above 0"),
        ("sensor_lowpass", {"corner_Hz": 10.0, "tau_s": 0.1}, "not both"),
        ("delay", {"delay_s": [0.1, 0.2]}, "give one number"),
    ],
)
def test_parameters_that_make_no_sense_are_refused_in_one_line(name, params, words):
    with pytest.raises(BadInput, match=words):
        simulate(axis(LINEAR, AdoptedEffect(name=name, params=params)), times(0.1), rich(200))


def test_predictions_honour_effects_and_coupling():
    stage = Stage(
        name="s",
        cross_coupling=((1, 0.03, 0), (0.05, 1, 0), (0, 0, 1)),
        axes={
            "x": axis(PIEZO, MODE, AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 100.0})),
            "y": axis(LINEAR),
        },
    )
    t, u = times(1.5), rich()
    recording = Recording(t, {"x": AxisRecord(u, None), "y": AxisRecord(0 * u, None)})
    found = predict(stage, recording)
    lowpass = stage.axes["x"].effects[1]
    unsensed = simulate(axis(PIEZO, MODE), t, u)
    assert np.allclose(found.axes["x"].x_um, simulate(axis(PIEZO, MODE, lowpass), t, u))
    assert np.allclose(found.axes["y"].x_um, 0.05 * (unsensed - simulate(axis(PIEZO), t[:1], u[:1] * 0)[0]))


def test_the_simulators_own_plant_agrees():
    """Code of its own. It holds the voltage for a tick, from 30 us after it: half a tick and 30 us more delay."""
    stage = built_in("xyz250").model_copy(update={"cross_coupling": None})
    model = stage.axes["x"]
    n, tick_s = 20_000, 1 / 5000
    t = np.arange(n) * tick_s
    u = 4 + 2 * np.sin(2 * np.pi * 5 * t) + np.sin(2 * np.pi * 37 * t) + 0.2 * np.sin(2 * np.pi * 110 * t)
    u[12_000:], u[16_000:] = 6.0, 5.0
    codes = np.full((n, 3), 32768, np.uint16)
    codes[:, 0] = np.round((u + 10.24) / 20.48 * 65536)
    measured = Plant(plant_parameters(stage)).run(codes)[:, 0] / 65536 * 280 - 10
    late = model.time.model_copy(update={"delay_s": model.time.delay_s + tick_s / 2 + LATCH_S})
    error = measured - simulate(model.model_copy(update={"time": late}), t, codes[:, 0] / 65536 * 20.48 - 10.24)
    assert np.std(error[500:12_000]) < 0.1  # 0.05 % of 200 um
    assert np.std(error[12_000:]) < 0.5  # a step is a ramp over one tick here: the ring-down differs by 1 %
    assert np.std(error[15_000:16_000]) < 0.015  # noise: creep agrees
