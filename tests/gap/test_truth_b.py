"""Generator B: each effect is what its name says, of the size claimed, and all history is carried on."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

sys.path.insert(0, str(Path(__file__).parent))

from truth_b.bench import Bench
from truth_b.cases import COUNTS, KINDS, SETS, SIZES, Case, case, cases
from truth_b.ceramic import Kohlrausch
from truth_b.effects import EFFECTS
from truth_b.memory import draw_loop
from truth_b.stage import draw
from truth_b.strangers import STRANGERS, Switch, prepared

from phaselead.validation.trial import base_model

OWN_NOISE = {"vibration", "sampling_jitter"}
"""Two benches share these only row by row."""


def quiet(rate_Hz=1000.0, bits=16, **more):
    """A stage of 100 um over -5..5 V with next to no memory, and nothing else."""
    bare = {"loop": 1e-5, "bend": 0.0, "creep": 0.0, "modes": (), "noise_um": 0.0, "held": False, "sign": 1}
    span = {"output_V": (-5.0, 5.0), "low_V": -5.0, "high_V": 5.0, "park_V": 0.0, "travel_um": 100.0, "zero_um": 0.0}
    return replace(draw(np.random.default_rng(3), rate_Hz, bits), **(bare | span | more))


def benches(name, value, traits, seed=8, left_s=60.0):
    """The same stage with the effect and without it."""
    found = [Bench(traits, [5]), Bench(traits, [5])]
    found[0].left_s = left_s
    found[0].mount([EFFECTS[name].make(value, found[0], np.random.default_rng(seed))])
    return found


def positions(name, value, s, traits, left_s=60.0):
    """(n,) with the effect and without it, in um, driven by s in -1..1."""
    return [bench.record("", traits.volts(s)).axes["x"].x_um for bench in benches(name, value, traits, left_s=left_s)]


def loops(f_Hz, number, rate_Hz=1000.0, level=1.0):
    """Sines about 0, from 0."""
    return level * np.sin(2 * np.pi * f_Hz * np.arange(round(number / f_Hz * rate_Hz)) / rate_Hz)


def held(to, seconds, rate_Hz=1000.0):
    edge = 0.5 * (1 - np.cos(np.linspace(0, np.pi, 5)))
    return to * np.concatenate([np.zeros(100), edge, np.ones(round(seconds * rate_Hz))])


def line(y, f_Hz, rate_Hz):
    return complex(2 * np.mean(y * np.exp(-2j * np.pi * f_Hz * np.arange(len(y)) / rate_Hz)))


def opening(d, s):
    """At the middle, way down less way up, of the last period."""
    at = np.flatnonzero(np.diff(np.sign(s[:-1]) >= 0))[-3:]
    values = [np.interp(0, sorted([s[i], s[i + 1]]), d[[i, i + 1]] if s[i] < s[i + 1] else d[[i + 1, i]]) for i in at]
    down = [v for v, i in zip(values, at, strict=True) if s[i] > s[i + 1]]
    up = [v for v, i in zip(values, at, strict=True) if s[i] <= s[i + 1]]
    return np.mean(down) - np.mean(up)


def width(name, value):
    s = loops(0.5, 3)
    with_it, without = positions(name, value, s, quiet())
    return opening(with_it - without, s) / 100


def bend(value):
    s = loops(0.5, 3)
    with_it, without = positions("asymmetric_hysteresis", value, s, quiet())
    d = (with_it - without)[-2000:]
    s = s[-2000:]
    return (np.mean(d[np.abs(s) > 0.999]) - np.mean(d[np.abs(s) < 0.005])) / 100


def widening(value):
    traits, found = quiet(5000.0, loop=0.1), []
    for f_Hz in (5.0, 50.0):
        s = loops(f_Hz, 4, 5000.0)
        with_it, without = positions("rate_dependence", value, s, traits)
        found.append(opening(with_it - without, s) / 100 / traits.loop)
    return found[1] - found[0]


def growth(value):
    s = loops(20.0, 300)
    with_it, without = (line(x[-2000:], 20.0, 1000.0) for x in positions("softening", value, s, quiet()))
    return abs(with_it / without) - 1


def creep(value):
    with_it, without = positions("creep", value, held(0.8, 11.0), quiet())
    d, start = (with_it - without) / without[-1], 102
    return (d[start + 10_000] - d[start + 100]) / 2


def share(value):
    """A tenth of the way down to where the mode does not follow any more."""
    traits = quiet(5000.0, modes=((0.0, 100.0, 0.05),))
    f_Hz = benches("resonance", value, traits)[0].parts["mechanics"][-1].modes[0][1]
    s = loops(1000.0, 2000, 5000.0, 0.2)
    with_it, without = (line(x[-5000:], 1000.0, 5000.0) for x in positions("resonance", value, s, traits))
    return (1 - (with_it / without).real) / (1 - 1 / (1 - (1000.0 / f_Hz) ** 2))


def mass(value):
    traits = quiet(5000.0, modes=((1.0, 150.0, 0.02),))
    rings = []
    for x in positions("load_change", value, held(0.5, 1.0, 5000.0), traits):
        spectrum = np.abs(np.fft.rfft(x[110:] - x[-1], 1 << 18))
        rings.append(np.argmax(spectrum) * 5000.0 / (1 << 18))
    return (rings[1] / rings[0]) ** 2 - 1


def turned(name, value, f_Hz=200.0):
    s = loops(f_Hz, 400, 5000.0, 0.3)
    with_it, without = (line(x[-5000:], f_Hz, 5000.0) for x in positions(name, value, s, quiet(5000.0)))
    return with_it / without, 2 * np.pi * f_Hz


def lag(name, value):
    ratio, w = turned(name, value)
    return np.tan(-np.angle(ratio)) / w


def late(value):
    ratio, w = turned("delay", value)
    return -np.angle(ratio) / w


def traverse(value):
    s = held(0.95, 0.3, 5000.0)
    with_it, _ = positions("slew_limit", value, s, quiet(5000.0))
    return 100 / (np.diff(with_it).max() * 5000.0)


def lost(value):
    s = loops(0.5, 2)
    with_it, without = positions("saturation", value, s, quiet())
    return (without.max() - with_it.max()) / 100


def leaking(value):
    with_it, without = positions("charge_leakage", value, held(0.8, 10.0), quiet())
    kept = (with_it / np.where(without == 0, 1.0, without))[110:]
    return -np.log(kept[-1] / kept[0]) / (len(kept) - 1) * 1000


def bow(value):
    s = loops(0.5, 1)
    with_it, without = positions("sensor_nonlinearity", value, s, quiet())
    return np.mean((with_it - without)[np.abs(s) < 0.01]) / 100


def scale(value):
    with_it, without = positions("gain_change", value, loops(1.0, 1), quiet())
    return np.polyfit(without, with_it, 1)[0] - 1


def shift(value):
    with_it, without = positions("offset", value, loops(1.0, 1), quiet())
    return np.mean(with_it - without)


def step(value):
    with_it, _ = positions("quantisation", value, loops(1.0, 1, level=0.01), quiet(bits=18))
    return np.diff(np.unique(with_it)).min()


def drift(value):
    with_it, without = positions("thermal_drift", value, np.zeros(20_000), quiet(), left_s=20.0)
    return (with_it - without)[-1] / 20


def hum(value):
    with_it, without = positions("mains_hum", value, np.zeros(4000), quiet())
    return max(abs(line(with_it - without, f_Hz, 1000.0)) for f_Hz in (50.0, 60.0))


def rumble(value):
    return np.sqrt(np.mean(np.square(np.subtract(*positions("vibration", value, np.zeros(50_000), quiet())))))


def jitter(value):
    with_it, without = positions("sampling_jitter", value, loops(20.0, 40, 5000.0), quiet(5000.0))
    return np.std(with_it - without) / np.sqrt(np.mean((np.gradient(without) * 5000.0) ** 2))


def departure(value):
    with_it, without = positions("dac_nonlinearity", value, np.linspace(-1, 1, 20_000), quiet(bits=12))
    d = (with_it - without)[20:] / 100 * 4096
    return d[np.argmax(np.abs(d))]


MEASURED = {
    "hysteresis": (lambda value: width("hysteresis", value), 0.03),
    "asymmetric_hysteresis": (bend, 0.05),
    "rate_dependence": (widening, 0.1),
    "softening": (lambda value: growth(value) / 0.354, 0.05),
    "creep": (creep, 0.05),
    "resonance": (share, 0.05),
    "load_change": (mass, 0.05),
    "amplifier_lowpass": (lambda value: lag("amplifier_lowpass", value), 0.02),
    "slew_limit": (traverse, 0.03),
    "saturation": (lost, 0.03),
    "delay": (late, 0.02),
    "charge_leakage": (leaking, 0.03),
    "sensor_lowpass": (lambda value: lag("sensor_lowpass", value), 0.02),
    "sensor_nonlinearity": (bow, 0.03),
    "gain_change": (scale, 0.001),
    "offset": (shift, 1e-6),
    "quantisation": (step, 1e-6),
    "thermal_drift": (drift, 0.01),
    "mains_hum": (hum, 0.05),
    "vibration": (rumble, 0.2),
    "backlash": (lambda value: width("backlash", value), 0.03),
    "sampling_jitter": (jitter, 0.05),
    "dac_nonlinearity": (departure, 0.05),
}
"""How a person would measure each size from records, and how well that agrees with what was asked."""


@pytest.mark.parametrize("size", [0.3, 0.9])
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_size_measured_is_the_size_asked(name, size):
    measure, within = MEASURED[name]
    value = size * EFFECTS[name].typical
    assert measure(value) == pytest.approx(value, rel=within)


@pytest.mark.parametrize("name", sorted(name for name, effect in EFFECTS.items() if effect.signed))
def test_what_may_have_either_sign_has_it(name):
    value = -0.5 * EFFECTS[name].typical
    assert MEASURED[name][0](value) == pytest.approx(value, rel=0.05)


@given(st.integers(0, 2**32), st.floats(0.0036, 0.36))
@settings(max_examples=25, deadline=None)
def test_a_loop_has_its_width_whatever_its_kind_and_never_turns_the_motion_round(seed, asked):
    loop, branch = draw_loop(np.random.default_rng(seed), asked), np.linspace(-1, 1, 801)
    path = np.concatenate([branch[400:], *[branch[::-1], branch] * 3])
    x = 0.5 * path + loop.run(path)
    down, up = x[-1602:-801], x[-801:]
    assert down[400] - up[400] == pytest.approx(asked, rel=0.02)
    assert up[-1] - up[0] == pytest.approx(1 - asked, abs=0.003)
    assert np.diff(up).min() > 0 > np.diff(down).max()


def test_a_loop_does_not_hang_on_the_rate_and_friction_does():
    for name, least in (("hysteresis", 0.98), ("rate_dependence", 0.0)):
        found = []
        for f_Hz in (0.5, 10.0):
            s = loops(f_Hz, 4, 5000.0)
            value = EFFECTS[name].typical
            with_it, without = positions(name, value, s, quiet(5000.0, loop=0.1))
            found.append(opening(with_it - without, s))
        assert least <= found[0] / found[1] < (1.02 if least else 0.6)


def test_friction_weakens_before_it_grows():
    bench = Bench(quiet(loop=0.1), [5])
    friction = EFFECTS["rate_dependence"].make(0.2, bench, np.random.default_rng(8))
    level = friction.level(np.geomspace(1e-3, 1e3, 200))
    assert np.argmin(level) > 0
    assert level.min() < 0 < level[-1]


def test_creep_is_a_stretched_exponential():
    t_s = np.geomspace(0.01, 400, 60)
    part = Kohlrausch(0.015, 30.0, 0.35, 0.001, 0.0)
    lags = np.array([x.tau_s for x in part.lags])
    assert (1 - np.exp(-t_s[:, None] / lags)) @ part.shares == pytest.approx(part.shape(t_s, 30.0, 0.35), abs=0.01)


def test_a_delay_keeps_the_gain_and_a_lag_does_not():
    assert abs(turned("delay", 2e-4)[0]) == pytest.approx(1.0, abs=2e-3)
    assert abs(turned("amplifier_lowpass", 2e-4)[0]) == pytest.approx(abs(1 / (1 + 2j * np.pi * 200 * 2e-4)), rel=0.01)


def test_a_current_limit_spares_what_is_slow():
    with_it, without = positions("slew_limit", 0.01, loops(2.0, 2, 5000.0), quiet(5000.0))
    assert np.abs(with_it - without).max() < 1e-2


def test_the_converter_s_error_hangs_on_the_code_alone_and_jumps_where_segments_meet():
    converter = EFFECTS["dac_nonlinearity"].make(2.0, Bench(quiet(bits=12), [5]), np.random.default_rng(8))
    codes = -5 + 10 / 4096 * np.arange(4096)
    error = converter.run(codes) - codes
    assert np.array_equal(error, (converter.run(codes[::-1]) - codes[::-1])[::-1])
    assert set(np.argsort(np.abs(np.diff(error)))[-10:] % 64) == {63}
    assert error.mean() > 0.4 * np.abs(error).max()


def test_quantised_positions_lie_on_a_grid_and_drift_hangs_on_no_voltage():
    with_it, _ = positions("quantisation", 0.008, loops(1.0, 1), quiet())
    assert with_it / 0.008 == pytest.approx(np.round(with_it / 0.008), abs=1e-6)
    still, moved = (
        np.subtract(*positions("thermal_drift", 0.002, s, quiet())) for s in (np.zeros(2000), loops(1.0, 2))
    )
    assert still == pytest.approx(moved, abs=1e-9)


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - OWN_NOISE))
def test_a_pause_is_as_good_as_the_same_time_spent_idle(name):
    """History: memory, creep, leak, level and temperature go on while nothing is recorded."""
    traits = quiet(creep=0.01, loop=0.1, modes=((1.0, 80.0, 0.05),))
    ends = []
    for paused in (False, True):
        bench = benches(name, EFFECTS[name].typical, traits)[0]
        bench.record("", traits.volts(np.concatenate([loops(1.0, 1), np.linspace(0, 0.6, 50), np.full(2000, 0.6)])))
        if paused:
            bench.pause(8.0)
        else:
            bench.record("", traits.volts(np.full(8000, 0.6)))
        ends.append(bench.record("", traits.volts(np.concatenate([np.full(100, 0.6), 0.6 + loops(2.0, 1, level=0.3)]))))
    a, b = (r.axes["x"].x_um for r in ends)
    assert ends[0].t_s == pytest.approx(ends[1].t_s)
    assert np.abs(a - b).max() < 0.005 + (0.008 if name == "quantisation" else 0)


def test_a_stage_that_crept_before_creeps_on():
    traits, found = quiet(creep=0.012), []
    for pause_s in (0.5, 300.0):
        bench = Bench(traits, [5])
        bench.record("", traits.volts(held(0.8, 1.0)))
        bench.pause(pause_s)
        x = bench.record("", traits.volts(np.full(5000, 0.8))).axes["x"].x_um
        found.append(x[-1] - x[0])
    assert found[0] > 5 * abs(found[1]) > 0


@pytest.mark.parametrize("name", sorted(STRANGERS))
def test_a_stranger_is_linear_until_it_is_switched(name):
    traits = prepared(quiet(5000.0, modes=((1.0, 150.0, 0.05),)))
    strange, uneven = STRANGERS[name], []
    for on in (False, True):
        ratios = []
        for level in (0.02, 0.4):
            bench = Bench(replace(traits, loop=1e-5), [5])
            part = strange.place(bench)
            bench.mount([part])
            bench.mount([Switch(part, strange.strength(bench, np.random.default_rng(2)))] if on else [])
            x = bench.record("", traits.volts(loops(150.0, 150, 5000.0, level))).axes["x"].x_um
            ratios.append(abs(line(x[-2500:], 150.0, 5000.0)) / level)
        uneven.append(abs(ratios[1] / ratios[0] - 1))
    assert uneven[0] < 1e-3 < 0.02 < uneven[1]


def short(**more):
    return [replace(c, shorter=12.0) for c in cases("tuning", **more)]


@pytest.mark.parametrize("name", [*sorted(EFFECTS), *sorted(STRANGERS)])
def test_the_reference_holds_nothing_of_what_is_hidden_and_the_others_do(name):
    kind = "outside" if name in STRANGERS else "removed"
    found = next(c for c in short(kinds=[kind], scale=2) if c.effects == (name,))
    assert found.without == (() if kind == "outside" else (name,))
    with_it, without = found.records(), found.records(hidden=False)
    same = [[a.sha256 == b.sha256 for a, b in zip(*part, strict=True)] for part in zip(with_it, without, strict=True)]
    assert all(same[0])
    assert not any([*same[1], *same[2]])
    rows = [r.axes["x"].u_V for part in with_it for r in part]
    assert all(np.array_equal(u, v) for u, v in zip(rows, [r.axes["x"].u_V for p in without for r in p], strict=True))


def test_with_nothing_hidden_nothing_is_hidden():
    for found in short(kinds=["none"], scale=0.03):
        assert found.hidden == found.without == found.allowed == ()
        assert [r.sha256 for r in found.records()[2]] == [r.sha256 for r in found.bare_holdout()]


def test_time_and_voltage_run_on_and_each_record_begins_with_a_full_loop():
    for found in short(kinds=["none", "pair"], scale=0.03):
        records = [r for part in found.records() for r in part]
        traits = found.traits
        assert all(b.t_s[0] - a.t_s[-1] > 4 for a, b in pairwise(records))
        assert records[-1].t_s[-1] > 240
        for r in records:
            u = r.axes["x"].u_V
            assert [u[0], u[-1]] == pytest.approx([traits.park_V] * 2, abs=traits.step_V)
            front = u[: round(0.4 * len(u))]
            assert np.ptp(front) > 0.98 * traits.swing_V
            assert np.mean(np.diff(u) == 0) > 0.1
            codes = (u - found.output_V[0]) / traits.step_V
            assert codes == pytest.approx(np.round(codes), abs=1e-4)


def test_a_name_is_a_case_and_the_sets_share_no_seed():
    every = {name: cases(name) for name in SETS}
    seeds = [{c.seed for c in found} for found in every.values()]
    assert not seeds[0] & seeds[1]
    for found in every.values():
        assert len({c.name for c in found}) == len(found) == sum(COUNTS.values())
        assert sum(c.kind in ("none", "single", "pair", "triple") for c in found) == 300
        assert all(case(c.name) == c for c in found)
        singles = [c.effects[0] for c in found if c.kind == "single"]
        assert min(singles.count(name) for name in EFFECTS) >= 6
    first = replace(every["sealed"][0], shorter=12.0)
    again = Case(first.set_name, first.kind, first.effects, first.number, 12.0)
    assert [r.sha256 for r in first.records()[1]] == [r.sha256 for r in again.records()[1]]


@pytest.mark.parametrize("name", ["", "sealed/single/creep/x", "other/none/nothing/0", "tuning/single/wear/0"])
def test_what_is_no_case_is_refused(name):
    with pytest.raises(ValueError, match="no case"):
        case(name)
    with pytest.raises(ValueError, match="no kind sines"):
        cases("tuning", ["sines"])
    with pytest.raises(ValueError, match="no set"):
        cases("other")


def test_sizes_are_even_in_their_logarithm_and_values_follow():
    free = {name for name, effect in EFFECTS.items() if effect.largest == SIZES[1]}
    hidden = [h for name in SETS for c in cases(name, ["single", "pair", "triple"]) for h in c.hidden]
    logs = np.log([h.size for h in hidden if h.name in free])
    low, high = np.log(SIZES)
    assert stats.kstest((logs - low) / (high - low), "uniform").pvalue > 0.01
    assert all(abs(h.value) == pytest.approx(h.size * EFFECTS[h.name].typical) for h in hidden)
    assert all(h.unit == EFFECTS[h.name].unit for h in hidden)


def test_stages_differ_and_records_stay_moderate():
    every = [c.traits for c in cases("tuning", KINDS)]
    assert {t.rate_Hz for t in every} == {1000.0, 5000.0, 20000.0}
    assert len({t.output_V for t in every}) == 6
    assert 0.2 < np.mean([t.sign < 0 for t in every]) < 0.4
    assert min(t.travel_um for t in every) < 3
    assert max(t.travel_um for t in every) > 600
    for found in cases("tuning", ["single"], scale=0.014):
        assert sum(len(r.t_s) for part in found.records() for r in part) < 150_000


def test_a_follow_up_comes_after_all_else_and_stays_within_the_voltages():
    found = short(kinds=["single"], scale=0.01)[0]
    more = found.follow_up(lambda t_s: 1000 * np.sin(2 * np.pi * t_s), 1.0, None)
    u = more.axes["x"].u_V
    assert more.t_s[0] > found.records()[2][-1].t_s[-1]
    assert u.max() <= found.traits.high_V + found.traits.step_V
    assert u.min() >= found.traits.low_V - found.traits.step_V


def test_a_trial_tells_the_model_what_the_lab_knows_of_its_converter():
    found = next(c for c in short(kinds=["none"], scale=0.2) if c.output_V == (-200.0, 200.0))
    actuator = base_model(found, found.records()[0]).axes["x"].actuator
    assert (actuator.bits, actuator.u_min_V, actuator.u_max_V) == (found.bits, *found.output_V)
