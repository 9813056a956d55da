"""What holds for every effect of the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchtop import MODE, PIEZO, axis, rich, run, signal

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect
from phaselead.model.chain import Chain, simulate
from phaselead.model.effects import catalogue, effect
from phaselead.model.effects.interface import Place
from phaselead.model.stage_file import Stage, parse_stage, stage_text

NAMES = list(catalogue())
STOCHASTIC = [name for name, e in catalogue().items() if e.variance is not None]
CLOCK = [name for name, e in catalogue().items() if e.kind == "disturbance" and e.variance is None]
DYNAMIC = ("load_change", "resonance", "amplifier_lowpass", "sensor_lowpass", "slew_limit", "delay")
"""What leaves the settled position as it is."""
BENCH = axis(PIEZO, MODE)
every = pytest.mark.parametrize("name", NAMES)


def others(n: int) -> dict[str, np.ndarray]:
    return {"y": 20 * np.sin(2 * np.pi * np.arange(n) / 400), "z": np.linspace(0, 5, n)}


def respond(name: str, params: dict[str, float], u: np.ndarray, t0: float = 0.0, seed: int | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed) if seed is not None else None
    t = t0 + np.arange(len(u)) / 2000
    return simulate(BENCH, t, u, others_um=others(len(u)), extra=[(effect(name), params)], rng=rng)


def shapes(name: str, rng: np.random.Generator) -> dict[str, float]:
    return {p.name: _draw(p, rng) for p in effect(name).shapes}


def _draw(p, rng: np.random.Generator) -> float:
    if p.log and p.low > 0:
        return float(np.exp(rng.uniform(np.log(p.low), np.log(p.high))))
    return float(rng.uniform(p.low, p.high))


DESIGN_NAMES = {
    "hysteresis", "asymmetric_hysteresis", "rate_dependence", "softening", "creep", "resonance", "load_change",
    "amplifier_lowpass", "slew_limit", "saturation", "delay", "charge_leakage", "sensor_lowpass",
    "sensor_nonlinearity", "gain_change", "offset", "quantisation", "thermal_drift", "mains_hum", "vibration",
    "cross_coupling", "backlash", "sampling_jitter", "dac_nonlinearity",
}  # fmt: skip
"""Effect names that are checked from outside (DESIGN 7)."""


def test_the_catalogue_holds_what_the_design_names():
    assert set(NAMES) >= DESIGN_NAMES


def test_each_effect_has_a_place_of_its_own_in_the_chain():
    """Else their names would decide which acts first."""
    places = [(e.place, e.order) for e in catalogue().values()]
    assert len(set(places)) == len(places)


@every
def test_it_says_everything_about_itself(name):
    e = effect(name)
    words = (e.title, e.equation, e.source, e.shows, e.reveals, e.compensation)
    assert all(len(text) > 4 for text in words)
    assert e.confused_with
    assert all(other in NAMES and other != name for other in e.confused_with)
    assert e.sizes
    assert all(p.unit and p.doc for p in e.parameters)


@every
def test_bounds_hold_the_typical_value(name):
    for p in effect(name).parameters:
        assert p.low < p.high
        assert p.low <= p.typical <= p.high
        assert p.role == "shape" or p.low <= 0 < p.high
        assert not (p.log and p.role == "shape") or p.low > 0


@every
def test_nothing_at_size_zero(name):
    rng = np.random.default_rng(3)
    u = rich()
    bare = respond("offset", {}, u)
    zero = {p.name: 0.0 for p in effect(name).sizes}
    for given in (zero, *({**zero, **shapes(name, rng)} for _ in range(3))):
        assert np.allclose(respond(name, given, u, seed=1), bare, rtol=0, atol=1e-9)


@every
def test_finite_over_the_whole_box(name):
    rng = np.random.default_rng(5)
    e, u = effect(name), rich(600)
    corners = [{p.name: (p.low, p.high)[bit >> i & 1] for i, p in enumerate(e.parameters)} for bit in range(16)]
    for params in [*corners, *({p.name: _draw(p, rng) for p in e.parameters} for _ in range(10))]:
        x = respond(name, params, u, seed=2)
        assert x.shape == u.shape
        assert np.isfinite(x).all()
        assert np.abs(x).max() < 1e6


@every
def test_more_is_more(name):
    u = rich()
    bare = respond("offset", {}, u)
    by_size = []
    for factor in (0.25, 0.5, 1.0):
        scaled = {p.name: p.typical * (factor if p.role == "size" else 1) for p in effect(name).parameters}
        by_size.append(np.std(respond(name, scaled, u, seed=4) - bare) + abs(np.mean(respond(name, scaled, u) - bare)))
    assert 1e-5 < by_size[0] < by_size[1] < by_size[2]


@every
def test_rest_stays_rest(name):
    x = respond_at_rest(name)
    if name in CLOCK:
        assert np.ptp(x) > 1e-5
    else:
        assert np.ptp(x) < 1e-9
    if name not in ("offset", "sensor_nonlinearity", *CLOCK):
        assert x == pytest.approx(run(BENCH, np.zeros(500)), abs=1e-9)


def respond_at_rest(name: str) -> np.ndarray:
    u = np.zeros(500)
    return simulate(BENCH, np.arange(500) / 2000, u, extra=[(effect(name), effect(name).typical)])


@every
def test_only_clocks_know_the_time(name):
    u = rich(800)
    now, later = (respond(name, dict(effect(name).typical), u, t0) for t0 in (0.0, 1000.0 + 0.0077))
    assert np.allclose(now, later, atol=1e-7) != (name in CLOCK)


@pytest.mark.parametrize("name", [name for name in NAMES if effect(name).basis])
def test_basis_is_what_apply_adds(name):
    e = effect(name)
    assert e.basis
    rng = np.random.default_rng(7)
    given = signal(BENCH, rich(), name, others=others(3000))
    for _ in range(3):
        params = e.complete({p.name: rng.uniform(-0.3, 0.3) * p.high for p in e.sizes} | shapes(name, rng))
        columns = e.basis(given, params)
        assert columns.shape == (len(given.value), len(e.sizes))
        added = columns @ np.array([params[p.name] for p in e.sizes])
        assert np.allclose(given.value + added, e.apply(given, params), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", DYNAMIC)
def test_dynamics_leave_the_settled_position(name):
    u = np.concatenate([np.full(300, 2.0), np.full(5000, 6.0)])
    bare, with_it = (run(BENCH, u, n, **dict(effect(n).typical) if n == name else {}) for n in ("offset", name))
    assert with_it[-1] == pytest.approx(bare[-1], abs=2e-3 * 48)


@pytest.mark.parametrize("name", STOCHASTIC)
def test_what_no_voltage_predicts_is_expected_to_be_nothing(name):
    assert np.array_equal(respond(name, dict(effect(name).typical), rich()), respond("offset", {}, rich()))


@pytest.mark.parametrize("name", STOCHASTIC)
def test_variance_is_that_of_what_is_drawn(name):
    e = effect(name)
    n = 40_000
    u = 4 + 4 * np.sin(2 * np.pi * 5 * np.arange(n) / 2000)
    given = Chain(BENCH, np.arange(n) / 2000, u).signal_at(e.place)
    params = {**e.typical, **({"bandwidth_Hz": 60.0, "f_Hz": 100.0} if name == "vibration" else {})}
    drawn = [e.apply(_with_rng(given, seed), params) - given.value for seed in range(3)]
    assert np.mean(np.square(drawn)) == pytest.approx(np.mean(e.variance(given, params)), rel=0.1)


def _with_rng(given, seed):
    return replace(given, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("name", [name for name in NAMES if effect(name).spectrum])
def test_spectrum_integrates_to_the_variance(name):
    e = effect(name)
    f = np.linspace(0, 1000, 200_001)
    power = np.trapezoid(e.spectrum(f, e.typical, 2000.0), f)
    assert power == pytest.approx(float(e.variance(signal(BENCH, rich(50), name), e.typical)[0]), rel=0.01)


@every
def test_a_stage_file_keeps_it(name):
    e = effect(name)
    kept = AdoptedEffect(name=name, params=dict(e.typical))
    stage = Stage(name="s", axes={"x": axis(PIEZO, *([MODE] if name == "load_change" else []), kept)})
    again = parse_stage(stage_text(stage))
    assert again == stage
    u = rich(500)
    x = simulate(again.axes["x"], np.arange(500) / 2000, u, others_um=others(500))
    assert np.isfinite(x).all()


@every
def test_an_unknown_parameter_is_named(name):
    with pytest.raises(BadInput, match=rf"effect '{name}': unknown parameter wrong"):
        effect(name).complete({"wrong": 1.0})


def test_an_unknown_effect_is_named():
    with pytest.raises(BadInput, match="no effect is called 'gremlins'"):
        effect("gremlins")
    with pytest.raises(BadInput, match="no effect is called 'gremlins'"):
        catalogue(without=["gremlins"])


def test_an_effect_can_be_left_out():
    assert "creep" not in catalogue(without=["creep"])
    assert len(catalogue(without=["creep"])) == len(NAMES) - 1
    assert "creep" in catalogue()


@every
def test_volts_before_the_operator_micrometres_after(name):
    e = effect(name)
    given = signal(BENCH, np.full(50, 5.0), name)
    assert (np.abs(given.value).max() > 12) == (e.place >= Place.HYSTERESIS)
