"""Each hidden truth is what its name says, and is in the records at the size claimed."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

from truth import sessions
from truth.cases import EFFECTS, KINDS, LAGS, SIZES, case, cases
from truth.coupling import CrossCoupling
from truth.habits import EXCITATIONS, Habit
from truth.stage import Character, Stage, draw

from phaselead.validation.truth import load_truth

Samples = NDArray[np.float64]
RATE_HZ = 2000.0


def quiet(rate_Hz: float = RATE_HZ, bits: int = 16) -> Character:
    """A stage without noise or creep, whose mode is out of the way."""
    c = draw(np.random.default_rng(5), rate_Hz, bits)
    return replace(c, white_um=0.0, coloured_um=0.0, base_creep=0.0, f_Hz=0.4 * rate_Hz, zeta=0.05, second_share=0.0)


def pair(name: str, u: Samples, size: float = 1.0, c: Character | None = None) -> tuple[Samples, Samples, Character]:
    """Positions (n,) of the same stage with the effect and without it."""
    c = c or quiet(bits=12 if name == "dac_nonlinearity" else 16)
    t = np.arange(len(u)) / c.rate_Hz
    found = []
    for effects in ([EFFECTS[name](size, c, np.random.default_rng(8))], []):
        stage = Stage(c, np.random.default_rng(7))
        stage.switch(effects)
        found.append(stage.measure(stage.motion(u), t))
    return found[0], found[1], c


def sine(f_Hz: float, level: float, seconds: float, rate_Hz: float = RATE_HZ, span_V: float | None = None) -> Samples:
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    span_V = span_V or quiet().span_V
    return span_V * level / 2 * (1 - np.cos(2 * np.pi * f_Hz * t))


def line(y: Samples, f_Hz: float, rate_Hz: float = RATE_HZ) -> complex:
    """Amplitude and phase of one frequency over whole periods."""
    return complex(2 * np.mean(y * np.exp(-2j * np.pi * f_Hz * np.arange(len(y)) / rate_Hz)))


def opening(y: Samples, u: Samples) -> float:
    """Of the last loop at its middle."""
    u, y = u[len(u) // 2 :], y[len(y) // 2 :]
    at = np.flatnonzero(np.diff(np.sign(u - u.max() / 2)))[-2:]
    return float(abs(y[at[1]] - y[at[0]]))


def test_hysteresis_opens_a_loop_of_the_size_claimed_at_any_rate():
    for f_Hz in (0.5, 2.0):
        u = sine(f_Hz, 1.0, 2 / f_Hz)
        with_it, without, c = pair("hysteresis", u)
        assert opening(with_it - without, u) == pytest.approx(0.12 * c.range_um, rel=0.1)


def test_asymmetry_shows_even_harmonics_that_grow_as_the_square():
    second = []
    for level in (0.5, 1.0):
        with_it, without, c = pair("asymmetric_hysteresis", sine(1.0, level, 3.0))
        d = (with_it - without)[-round(2 * RATE_HZ) :]
        # About the middle of the range the curve is even; a smaller sine from 0 V sits at its lower end.
        second.append(abs(line(d, 2.0)))
    assert second[1] > 2.5 * second[0]
    assert second[1] > 2 * abs(line(d, 3.0))
    assert np.ptp(d) > 0.5 * 0.02 * c.range_um


def test_rate_dependence_widens_the_loop_with_the_logarithm_of_the_rate():
    wider = []
    for f_Hz in (0.2, 2.0, 20.0):
        u = sine(f_Hz, 1.0, 3 / f_Hz, 2000.0)
        with_it, without, c = pair("rate_dependence", u)
        wider.append((opening(with_it, u) - opening(without, u)) / (c.loop * c.range_um))
    assert wider[0] < 0.1 < wider[1] < wider[2]
    assert wider[2] - wider[1] == pytest.approx(0.2, abs=0.1)


def test_softening_raises_the_gain_with_the_level():
    gains = []
    for level in (0.2, 0.8):
        with_it, without, _ = pair("softening", sine(5.0, level, 4.0))
        last = slice(-round(1.0 * RATE_HZ), None)
        gains.append(abs(line(with_it[last], 5.0)) / abs(line(without[last], 5.0)) - 1)
    assert gains[1] == pytest.approx(4 * gains[0], rel=0.3)
    assert gains[1] == pytest.approx(0.15 * 0.8 / 2 / np.sqrt(2), rel=0.3)  # kappa times the rms level


def test_creep_is_straight_in_the_logarithm_of_time():
    c = quiet(500.0)
    u = np.concatenate([np.zeros(50), np.full(60 * 500, 0.5 * c.span_V)])
    with_it, without, _ = pair("creep", u, c=c)
    d, after = with_it - without, 50 + np.array([0.1, 1.0, 10.0]) * 500
    at = d[np.round(after).astype(int)]
    way = without[-1] - without[0]
    assert np.diff(at) / way == pytest.approx([0.015, 0.015], rel=0.25)


def test_a_hidden_resonance_stands_out_at_its_own_frequency():
    c = quiet(5000.0)
    effect = EFFECTS["resonance"](1.0, c, np.random.default_rng(8))
    rng = np.random.default_rng(1)
    u = 4 + 0.02 * rng.standard_normal(20000)
    with_it, without, _ = pair("resonance", u, c=c)
    ratio = np.abs(np.fft.rfft(with_it[5000:]) / np.fft.rfft(without[5000:]))
    f_Hz = np.fft.rfftfreq(15000, 1 / 5000.0)
    band = (f_Hz > 50) & (f_Hz < 1300)
    smooth = np.convolve(ratio, np.ones(9) / 9, mode="same")
    assert f_Hz[band][np.argmax(smooth[band])] == pytest.approx(effect.f_Hz, rel=0.03)


def test_a_load_moves_the_ringing_and_leaves_the_way():
    c = replace(quiet(5000.0), f_Hz=300.0, zeta=0.02)
    u = np.concatenate([np.zeros(500), np.full(4500, 3.0)])
    with_it, without, _ = pair("load_change", u, c=c)
    f_Hz = np.fft.rfftfreq(32768, 1 / 5000.0)
    rings = [f_Hz[np.argmax(np.abs(np.fft.rfft(y[500:2500] - y[-1], 32768)))] for y in (with_it, without)]
    assert rings[0] / rings[1] == pytest.approx(1.1**-0.5, abs=0.004)
    assert with_it[-1] == pytest.approx(without[-1], abs=1e-3)


@pytest.mark.parametrize("name", ["amplifier_lowpass", "sensor_lowpass"])
def test_low_passes_turn_and_weaken(name):
    c = quiet(5000.0)
    tau_s = EFFECTS[name].typical
    f_Hz = 500.0
    u = 4 + sine(f_Hz, 0.02, 1.0, 5000.0, 1.0)
    with_it, without, _ = pair(name, u, c=c)
    ratio = line(with_it[-2500:], f_Hz, 5000.0) / line(without[-2500:], f_Hz, 5000.0)
    expected = 1 / (1 + 2j * np.pi * f_Hz * tau_s)
    assert abs(ratio) == pytest.approx(abs(expected), rel=0.05)
    assert np.angle(ratio) == pytest.approx(np.angle(expected), rel=0.1)


def test_a_delay_turns_the_phase_in_proportion_and_keeps_the_gain():
    c = quiet(5000.0)
    for f_Hz in (100.0, 400.0):
        u = 4 + sine(f_Hz, 0.02, 1.0, 5000.0, 1.0)
        with_it, without, _ = pair("delay", u, c=c)
        ratio = line(with_it[-2500:], f_Hz, 5000.0) / line(without[-2500:], f_Hz, 5000.0)
        assert np.angle(ratio) == pytest.approx(-2 * np.pi * f_Hz * 2e-4, rel=0.03)
        assert abs(ratio) == pytest.approx(1.0, abs=0.02)


def test_a_slew_limit_spares_the_slow_and_bounds_the_fast():
    c = quiet(5000.0)
    most = c.gain_um_per_V * c.span_V / EFFECTS["slew_limit"].typical
    slow, fast = sine(5.0, 0.5, 0.6, 5000.0), sine(60.0, 1.0, 0.2, 5000.0)
    with_it, without, _ = pair("slew_limit", slow, c=c)
    assert np.abs(with_it - without)[500:].max() < 0.02 * np.ptp(without)
    with_it, without, _ = pair("slew_limit", fast, c=c)
    rates = [np.quantile(np.abs(np.diff(y)) * 5000.0, 0.99) for y in (with_it, without)]
    assert rates[0] < 1.3 * most < rates[1]


def test_saturation_flattens_both_ends_and_nothing_between():
    c, u = quiet(), sine(0.5, 1.0, 4.0)
    v = EFFECTS["saturation"](1.0, c, np.random.default_rng(8)).electrical(u)
    assert [v.min(), v.max()] == pytest.approx([0.05 * c.span_V, 0.95 * c.span_V], abs=0.005 * c.span_V)
    middle = (u > 0.1 * c.span_V) & (u < 0.9 * c.span_V)
    assert v[middle] == pytest.approx(u[middle], abs=1e-4)
    with_it, without, _ = pair("saturation", u)
    assert np.ptp(without) - np.ptp(with_it) > 0.05 * c.range_um


def test_leakage_pulls_a_hold_towards_rest():
    c = quiet(200.0)
    u = np.concatenate([np.zeros(20), np.full(20 * 200, 0.8 * c.span_V)])
    with_it, without, _ = pair("charge_leakage", u, c=c)
    d = with_it - without
    lost = (d[-1] - d[30]) / (without[-1] - without[0])
    assert lost == pytest.approx(-(1 - np.exp(-0.01 * 20 * 1.2)), rel=0.25)


def test_the_sensor_s_curve_hangs_on_position_alone():
    u = sine(0.5, 1.0, 4.0)
    with_it, without, c = pair("sensor_nonlinearity", u)
    d = with_it - without
    assert np.abs(d).max() == pytest.approx(0.002 * c.range_um, rel=0.05)
    order = np.argsort(without)
    assert np.abs(np.diff(d[order])).max() < 1e-3 * np.abs(d).max() * 20


def test_gain_and_offset_are_what_they_say():
    u = sine(1.0, 1.0, 2.0)
    with_it, without, c = pair("gain_change", u)
    assert with_it - without == pytest.approx(0.03 * (without - c.offset_um), abs=1e-9)
    with_it, without, _ = pair("offset", u)
    assert with_it - without == pytest.approx(np.ones(len(u)))


def test_quantised_positions_lie_on_a_grid():
    with_it, without, _ = pair("quantisation", sine(1.0, 0.3, 1.0))
    assert np.abs(with_it / 0.008 - np.round(with_it / 0.008)).max() < 1e-6
    assert np.std(with_it - without) == pytest.approx(0.008 / np.sqrt(12), rel=0.1)


def test_jitter_grows_with_the_rate_of_motion():
    c = quiet(5000.0)
    with_it, without, _ = pair("sampling_jitter", sine(20.0, 1.0, 2.0, 5000.0), c=c)
    rate = np.gradient(without) * 5000.0
    d = with_it - without
    assert abs(d @ rate) / (rate @ rate) < 1e-7  # no lateness on the whole
    fast, slow = np.abs(rate) > 0.8 * np.abs(rate).max(), np.abs(rate) < 0.1 * np.abs(rate).max()
    assert np.std(d[fast]) == pytest.approx(2e-6 * np.sqrt(np.mean(rate[fast] ** 2)), rel=0.3)
    assert np.std(d[slow]) < 0.3 * np.std(d[fast])


def test_drift_comes_with_time_and_not_with_the_voltage():
    c = quiet(50.0)
    found = []
    for u in (np.zeros(6000), sine(0.1, 1.0, 120.0, 50.0)):
        with_it, without, _ = pair("thermal_drift", u, c=c)
        found.append(with_it - without)
    assert found[0] == pytest.approx(found[1], abs=1e-9)
    assert abs(found[0][-1]) == pytest.approx(0.002 * 120, rel=0.35)


def test_hum_is_a_line_at_the_mains():
    with_it, without, _ = pair("mains_hum", np.zeros(8000))
    amplitude = np.abs(np.fft.rfft((with_it - without) * np.hanning(8000))) / 8000 * 4
    f_Hz = np.fft.rfftfreq(8000, 1 / RATE_HZ)
    assert f_Hz[np.argmax(amplitude)] == pytest.approx(50.0, abs=0.3)
    assert amplitude.max() == pytest.approx(0.01, rel=0.15)
    assert amplitude[np.abs(f_Hz - 150) < 1].max() == pytest.approx(0.003, rel=0.2)


def test_vibration_has_its_size_and_no_line():
    d = []
    for seed in range(6):
        effect = EFFECTS["vibration"](1.0, quiet(), np.random.default_rng(seed))
        y = effect.measured(np.zeros(40_000), np.arange(40_000) / RATE_HZ)
        d.append(np.mean(y**2))
        power = np.abs(np.fft.rfft(y)) ** 2
        assert power.max() < 0.5 * power.sum()
    assert np.sqrt(np.mean(d)) == pytest.approx(0.01, rel=0.2)


def test_the_converter_s_error_hangs_on_the_code_alone():
    c = quiet(bits=12)
    effect = EFFECTS["dac_nonlinearity"](1.0, c, np.random.default_rng(8))
    u = np.linspace(0, 9.9, 4000)
    up, down = effect.converter(u) - u, (effect.converter(u[::-1]) - u[::-1])[::-1]
    assert np.array_equal(up, down)
    assert 1.0 < np.ptp(up) / c.lsb_V < 4.0
    assert up[0] == 0


def test_backlash_is_one_width_at_every_reversal_whatever_the_amplitude():
    for level in (0.2, 0.9):
        with_it, without, c = pair("backlash", sine(1.0, level, 4.0))
        d = (with_it - without)[-4000:]
        assert np.ptp(d) == pytest.approx(0.002 * c.range_um, rel=0.05)


def test_coupling_moves_an_axis_that_is_not_driven():
    c = quiet()
    stages = dict.fromkeys("xyz", c)
    coupling = CrossCoupling(1.0, stages, np.random.default_rng(2))
    still = np.zeros(4000)
    moved = coupling.mixed({"x": still, "y": 10 * np.ones(4000), "z": still})
    assert moved["x"][-1] == pytest.approx(0.3, rel=0.01)
    assert moved["y"][-1] == pytest.approx(10.0)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_records_hold_the_effect_in_proportion_and_the_reference_none_of_it(name, monkeypatch):
    """Of one case, at two sizes, against the same stage with nothing hidden."""
    monkeypatch.setattr(sessions, "UNIT_ROWS", 800)
    found = next(c for c in cases("tuning", ["single"], [1.0], 0.5) if c.effects == (name,))
    strength = []
    # A slow enough voltage lets the mode ring out of step with itself: no more difference than that can come.
    for size in (0.02, 0.1) if name == "slew_limit" else (0.2, 1.0):
        case = replace(found, size=size)
        with_it, without = case.records(), case.records(hidden=False)
        for a, b in zip(with_it[0], without[0], strict=True):
            assert np.array_equal(a.axes["x"].x_um, b.axes["x"].x_um)
        held = zip(with_it[2], without[2], strict=True)
        strength.append(np.sqrt(np.mean([np.mean((a.axes["x"].x_um - b.axes["x"].x_um) ** 2) for a, b in held])))
        (hidden,) = case.hidden
        assert (hidden.name, hidden.value) == (name, pytest.approx(size * EFFECTS[name].typical))
    assert strength[1] > 2 * strength[0] > 0


def test_a_name_is_a_case_and_the_sets_share_no_seed(monkeypatch):
    monkeypatch.setattr(sessions, "UNIT_ROWS", 800)
    tuning, sealed = cases("tuning", KINDS, SIZES, 0.1), cases("sealed", KINDS, SIZES, 0.1)
    assert not {c.seed for c in tuning} & {c.seed for c in sealed}
    assert len({c.name for c in tuning}) == len(tuning)
    first = tuning[0]
    again = type(first)(first.set_name, first.kind, first.effects, first.size, first.rate, first.number)
    a, b = first.records()[2][0], again.records()[2][0]
    assert a.sha256 == b.sha256


def test_time_runs_on_from_record_to_record(monkeypatch):
    monkeypatch.setattr(sessions, "UNIT_ROWS", 800)
    case = next(c for c in cases("tuning", ["none"], SIZES, 0.02))
    reference, train, holdout = case.records()
    ends = [(r.t_s[0], r.t_s[-1]) for r in [*reference, *train, *holdout]]
    assert all(a[1] + 1 < b[0] for a, b in pairwise(ends))
    assert len({r.sha256 for r in [*reference, *train, *holdout]}) == len(ends)


def test_a_noisy_sensor_adds_white_noise_and_nothing_else():
    folder, name = Path(__file__).parent, "tuning/single/delay/1/fast/0"
    still = load_truth(folder / "truth").case(name).records()
    noisy = load_truth(folder / "truth_noisy").case(name)
    added = [
        seen.axes["x"].x_um - record.axes["x"].x_um
        for part, quiet_part in zip(noisy.records(), still, strict=True)
        for seen, record in zip(part, quiet_part, strict=True)
    ]
    assert (noisy.name, noisy.hidden[0].name) == (name, "delay")
    for one in added:
        assert one.std() == pytest.approx(0.5, rel=0.05)
        assert abs(np.mean(one[1:] * one[:-1])) < 0.02
    assert abs(np.mean(added[1][:1000] * added[2][:1000])) < 0.03
    again = noisy.records()[1][1].axes["x"].x_um
    np.testing.assert_array_equal(again, noisy.records()[1][1].axes["x"].x_um)


def of_each_habit():
    """A narrow case of every excitation, at both rates."""
    found = {(c.habit.excitation, c.rate): c for c in cases("tuning", ["narrow"], SIZES, 1.0)}
    assert set(found) == set(product(EXCITATIONS, ("fast", "slow")))
    return [found[key] for key in sorted(found)]


def test_a_campaign_that_names_no_kinds_has_none_on_request():
    assert len(cases("tuning")) == 608
    assert not {"narrow", "slow_sines", "unreferenced", "straight"} & ({c.kind for c in cases("tuning")} | set(KINDS))


def test_cases_without_references_hide_each_effect_and_as_often_nothing():
    for kind in ("unreferenced", "straight"):
        found = cases("tuning", [kind], (0.2, 1.0), 1.0)
        assert [c.effects for c in found].count(()) == len(EFFECTS)
        assert sorted(c.effects[0] for c in found if c.size == 1.0) == sorted(EFFECTS)
        assert not any(c.referenced for c in found)
    assert next(iter(cases("tuning", ["single"]))).referenced


def test_a_straight_line_lacks_the_stage_and_knows_no_floor():
    straight = cases("tuning", ["straight"], (0.2,), 1.0)
    assert {"operator", "linear"} == {c.base for c in [*straight, *cases("tuning", ["unreferenced"], (0.2,), 0.1)]}
    assert straight[0].bare_holdout() is None
    for one in straight:
        assert ("creep" in one.allowed) == bool(one.characters["x"].base_creep)
        assert {"hysteresis", "resonance"} <= set(one.allowed)
    assert {"creep" in one.allowed for one in straight} == {True, False}
    assert not cases("tuning", ["unreferenced"], (0.2,), 0.1)[0].allowed


def test_narrow_cases_hide_each_effect_at_each_size_as_single_ones_do():
    found, single = (cases("tuning", [kind], (0.3, 2.0), 1.0) for kind in ("narrow", "single"))
    assert {c.kind for c in found} == {"narrow"}
    assert sorted((c.effects, c.size, c.rate, c.number) for c in found) == sorted(
        (c.effects, c.size, c.rate, c.number) for c in single
    )


def test_behind_slow_sines_hide_lags_alone():
    found = cases("tuning", ["slow_sines"], (1.0, 3.0), 1.0)
    assert sorted((c.effects[0], c.size, c.number) for c in found) == sorted(product(LAGS, (1.0, 3.0), range(6)))
    reference, train, holdout = found[0].records()
    assert len(reference) > 4  # a session of its own, as rich as any
    for record in (*train, *holdout):
        swing_V = np.ptp(record.axes["x"].u_V)
        steepest_V_per_s = np.abs(np.diff(record.axes["x"].u_V)).max() / np.diff(record.t_s).min()
        assert steepest_V_per_s < np.pi * 20 * swing_V  # that of a sine of 20 Hz


def test_habits_are_drawn_alike_whatever_is_hidden():
    drawn = [(c.habit.excitation, c.effects[0]) for c in cases("tuning", ["narrow"], [1.0], 40.0)]
    assert len(drawn) == 120 * len(EFFECTS)
    for excitation in EXCITATIONS:
        share = [sum(one == (excitation, name) for one in drawn) / 120 for name in EFFECTS]
        assert np.mean(share) == pytest.approx(1 / len(EXCITATIONS), abs=0.03)
        assert np.ptp(share) < 0.25  # of 23 draws of 120, seven deviations


@pytest.mark.parametrize("narrow", of_each_habit(), ids=lambda c: f"{c.habit.excitation}-{c.rate}")
def test_a_narrow_lab_records_one_excitation_and_never_the_same_wave(narrow, monkeypatch):
    monkeypatch.setattr(sessions, "UNIT_ROWS", 800)
    reference, train, holdout = narrow.records()
    mixed = replace(narrow, kind="single").records()
    assert [r.source for r in reference] == [r.source for r in mixed[0]]
    for part, rich, shortest in zip((train, holdout), mixed[1:], (0.85, 0.7), strict=True):
        assert shortest < sum(len(r.t_s) for r in part) / sum(len(r.t_s) for r in rich) < 1.4
    for part, session, driven in ((train, "train", (2,)), (holdout, "holdout", (1, 2))):
        kinds = [record.source.removesuffix(".csv").rstrip("01") for record in part]
        assert kinds == [f"{session}-idle", *[f"{session}-{narrow.habit.excitation}"] * (len(part) - 1)]
        assert len(part) - 1 in driven
    waves = [record.axes["x"].u_V for record in [*train[1:], *holdout[1:]]]
    c = narrow.characters["x"]
    for wave in waves:
        assert wave.min() >= 0
        assert wave.max() <= c.span_V + c.lsb_V
        assert max(wave[0], wave[-1]) < 0.01 * c.span_V
    for i, wave in enumerate(waves):
        assert all(np.ptp(wave - other) > 0.005 * c.span_V for other in waves[:i])


@pytest.mark.parametrize("narrow", of_each_habit()[::3], ids=lambda c: f"{c.habit.excitation}-{c.rate}")
def test_a_narrow_case_is_the_same_each_time_and_is_followed_up(narrow, monkeypatch):
    monkeypatch.setattr(sessions, "UNIT_ROWS", 800)
    again = case(narrow.name)
    assert again.habit == narrow.habit
    parts, same = narrow.records(), again.records()
    assert [[r.sha256 for r in part] for part in parts] == [[r.sha256 for r in part] for part in same]
    for bare, held in zip(again.bare_holdout(), parts[2], strict=True):
        np.testing.assert_array_equal(bare.axes["x"].u_V, held.axes["x"].u_V)
    more = narrow.follow_up(lambda t: 2.0 + np.sin(40 * t), 0.5, None)
    assert len(more.t_s) == round(0.5 * narrow.characters["x"].rate_Hz)
    assert more.t_s[0] > parts[2][-1].t_s[-1]
    assert np.ptp(more.axes["x"].x_um[100:]) > 1.0


def full(excitation: str) -> tuple[Samples, Character]:
    """The highest wave of a lab with that habit between its edges, 2 s in all."""
    c, rng = replace(quiet(5000.0), f_Hz=400.0), np.random.default_rng(4)
    return Habit(excitation, 0.3, 0.4).wave(rng, c, 2.0, 1.0)[1200:-1200], c


def test_slow_triangles_run_at_one_rate_from_nothing_to_the_full_range():
    wave, c = full("triangles")
    assert np.ptp(wave) == pytest.approx(c.span_V, rel=0.01)
    assert np.quantile(np.abs(np.diff(wave)), 0.05) == pytest.approx(np.abs(np.diff(wave)).max())


def test_a_slow_multisine_ends_far_below_the_mode():
    wave, c = full("multisine")
    power = np.abs(np.fft.rfft((wave - wave.mean()) * np.hanning(len(wave)))) ** 2
    f_Hz = np.fft.rfftfreq(len(wave), 1 / c.rate_Hz)
    assert power[f_Hz < 0.022 * c.rate_Hz].sum() > 0.999 * power.sum()
    assert np.sum(power > 0.01 * power.max()) > 10
    assert 0.5 * c.span_V < np.ptp(wave) < c.span_V


def test_steps_jump_within_a_row_and_hold():
    wave, c = full("steps")
    moves = np.abs(np.diff(wave)) > 0.01 * c.span_V
    assert 4 <= moves.sum() <= 9
    assert np.abs(np.diff(wave))[~moves].max() < 1e-9


def test_a_sine_of_nearly_the_full_level_has_the_frequency_of_its_lab():
    wave, c = full("sine")
    assert np.ptp(wave) == pytest.approx(c.span_V, rel=0.02)
    f_Hz = np.mean(np.diff(np.sign(wave - c.span_V / 2)) > 0) * c.rate_Hz
    other = Habit("sine", 0.3, 0.6).wave(np.random.default_rng(9), c, 2.0, 0.0)[1200:-1200]
    assert f_Hz == pytest.approx(2.5 * (100 / 2.5) ** 0.3, rel=0.1)
    assert np.mean(np.diff(np.sign(other - c.span_V / 2)) > 0) * c.rate_Hz == pytest.approx(f_Hz)


def test_small_loops_stay_about_the_bias_of_their_lab():
    wave, c = full("loops")
    assert wave.max() == pytest.approx(0.5 * c.span_V, rel=0.02)
    assert wave.min() == pytest.approx(0.3 * c.span_V, rel=0.02)


def test_a_small_sweep_runs_up_or_down_and_stops_below_the_mode():
    wave, c = full("sweep")
    assert np.ptp(wave) == pytest.approx(0.2 * c.span_V, rel=0.02)
    crossings = np.flatnonzero(np.diff(np.sign(wave - c.span_V / 2)))
    f_Hz = c.rate_Hz / 2 / np.diff(crossings)
    steady = f_Hz if f_Hz[-1] > f_Hz[0] else f_Hz[::-1]
    assert steady[-1] > 10 * steady[0]
    assert steady[-1] < 0.5 * c.f_Hz
    assert np.all(np.diff(steady) > -0.2 * steady[1:])
