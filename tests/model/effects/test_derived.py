"""Sizes as a person means them, and their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, PIEZO, axis, run, sine
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.model import range_um
from phaselead.model.effects import catalogue, derived_sizes, effect
from phaselead.model.effects.derived import Derived, Scene, derived_estimates

laws = settings(max_examples=40, deadline=None)
SCENE = Scene(axis(LINEAR), ((0.0, 60.0),))


def value_of(name, params, scene=SCENE):
    return {d.name: d.value(effect(name).complete(params), scene) for d in effect(name).derived}


@laws
@given(bend=st.floats(-0.2, 0.2))
def test_the_bow_is_the_sag_from_the_line_between_the_ends(bend):
    u = sine(10.0, 5.0, 1)
    bent = run(axis(LINEAR), u, "asymmetric_hysteresis", bend=bend)
    line = np.interp(u, [0, 10], [bent[0], bent[np.argmax(u)]])
    off = line - bent
    assert value_of("asymmetric_hysteresis", {"bend": bend})["bow_um"] == pytest.approx(
        off[np.argmax(np.abs(off))], abs=1e-6
    )


@laws
@given(amplitude_um=st.floats(1e-4, 1.0), phase=st.floats(0, 6.3))
def test_the_hums_amplitude_is_that_of_its_first_line_whatever_its_phase(amplitude_um, phase):
    params = {"sin1_um": amplitude_um * np.cos(phase), "cos1_um": amplitude_um * np.sin(phase), "sin2_um": 0.7}
    assert value_of("mains_hum", params)["amplitude_um"] == pytest.approx(amplitude_um)


@laws
@given(quadratic=st.floats(-0.02, 0.02), cubic=st.floats(-0.02, 0.02), quartic=st.floats(-0.02, 0.02))
def test_the_sensors_peak_is_its_largest_departure(quadratic, cubic, quartic):
    params = {"quadratic": quadratic, "cubic": cubic, "quartic": quartic}
    u = np.linspace(0, 10, 2001)
    off = run(axis(LINEAR), u, "sensor_nonlinearity", **params) - run(axis(LINEAR), u)
    found = value_of("sensor_nonlinearity", params)
    assert found["peak_um"] == pytest.approx(np.abs(off).max(), abs=2e-4)
    assert found["nonlinearity"] * range_um(axis(LINEAR)) == pytest.approx(found["peak_um"])


@laws
@given(
    ramp=st.floats(-0.01, 0.01),
    rise=st.floats(-1, 1),
    tau_s=st.floats(5, 1000),
    t0=st.floats(0, 1000),
    t=st.floats(1, 500),
)
def test_the_drifts_mean_rate_is_the_way_over_the_time(ramp, rise, tau_s, t0, t):
    params = {"ramp_um_per_s": ramp, "rise_um": rise, "tau_s": tau_s}
    x = run(axis(PIEZO), np.zeros(101), "thermal_drift", rate_Hz=100 / t, t0=t0, **params)
    found = value_of("thermal_drift", params, Scene(axis(PIEZO), ((t0, t0 + t),)))
    assert found["mean_rate"] == pytest.approx((x[-1] - x[0]) / t * 60e3, abs=1e-6 + 1e-6 * abs(found["mean_rate"]))


def test_the_mean_rate_of_two_records_weighs_them_by_their_length():
    params = {"rise_um": 1.0, "tau_s": 10.0}
    first, later, both = (
        value_of("thermal_drift", params, Scene(axis(LINEAR), spans))["mean_rate"]
        for spans in (((0.0, 10.0),), ((40.0, 70.0),), ((0.0, 10.0), (40.0, 70.0)))
    )
    assert both == pytest.approx((10 * first + 30 * later) / 40)


SUM = (Derived("sum", "um", lambda p, scene: p["a"] - 2 * p["b"]),)


def test_intervals_are_passed_on_as_independent_or_with_their_correlation():
    params, ci95 = {"a": 1.0, "b": 2.0}, {"a": (0.7, 1.3), "b": (1.8, 2.2)}
    alone = derived_estimates(SUM, params, ci95, SCENE)["sum"]
    assert alone[:2] == (-3.0, "um")
    assert alone[2] == pytest.approx((-3.5, -2.5))
    tied = derived_estimates(SUM, params, ci95, SCENE, np.array([[1.0, 1.0], [1.0, 1.0]]))["sum"]
    assert tied[2] == pytest.approx((-3.1, -2.9))


def test_a_lopsided_interval_stays_so():
    params, ci95 = {"a": 1.0, "b": 2.0}, {"a": (0.9, 1.0), "b": (2.0, 2.2)}
    low, high = derived_estimates(SUM, params, ci95, SCENE)["sum"][2]
    assert (low, high) == pytest.approx((-3 - np.hypot(0.1, 0.4), -3.0))


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if e.derived])
def test_derived_sizes_are_nothing_without_the_effect_and_have_a_unit(name):
    for size in effect(name).derived:
        assert size.unit
        assert size.doc
        assert size.value(effect(name).complete({}), SCENE) == pytest.approx(0.0)
    assert set(derived_sizes(name, {}, SCENE)) == {size.name for size in effect(name).derived}
