"""Each effect shows as its page says: the laws of the field, measured on the simulated answer."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, PIEZO, RATE_HZ, axis, harmonics, response, rich, run, signal, sine, times
from hypothesis import given
from hypothesis import strategies as st

from phaselead.model.axis import AdoptedEffect
from phaselead.model.chain import Chain, simulate
from phaselead.model.effects import effect
from phaselead.model.effects.interface import Place

PLAIN = axis(LINEAR)
RANGE_UM, SPAN_V = 100.0, 10.0


def frequency_response(name: str, frequencies: list[float], model=PLAIN, **params) -> np.ndarray:
    """Complex gain relative to the model without the effect, at each frequency; 1 s of steady state."""
    found = []
    for f in frequencies:
        u = sine(1.0, f, 2 * f, low=2.0)
        last = slice(len(u) // 2, None)
        x, bare = run(model, u, name, **params)[last], run(model, u)[last]
        found.append(response(bare, x, f))
    return np.array(found)


def loop_width(x: np.ndarray, u: np.ndarray, at: float) -> float:
    """Vertical opening at voltage ``at`` of the last period."""
    turn = np.argmax(u)
    return float(np.interp(-at, -u[turn:], x[turn:]) - np.interp(at, u[: turn + 1], x[: turn + 1]))


def last_period(x: np.ndarray, f_Hz: float) -> np.ndarray:
    return x[-round(RATE_HZ / f_Hz) :]


def test_delay_falls_in_phase_and_keeps_the_gain():
    f = [5.0, 50.0, 100.0, 200.0]  # up to a tenth of the sampling rate
    h = frequency_response("delay", f, delay_s=0.0015)  # 3 rows
    assert np.abs(h) == pytest.approx(np.ones(4), abs=7e-3)
    assert -np.angle(h) / (2 * np.pi * np.array(f)) == pytest.approx(0.0015, rel=5e-3)
    # Half-way between rows a voltage that runs straight between them is the mean of two.
    halfway = frequency_response("delay", f, delay_s=0.00175)
    assert np.abs(halfway) == pytest.approx(np.cos(np.pi * np.array(f) / RATE_HZ), abs=7e-3)


def test_delay_lets_nothing_move_before_and_overshoots_nowhere():
    u = np.concatenate([np.full(20, 1.0), np.full(20, 7.0)])
    x = run(PLAIN, u, "delay", delay_s=2.4 / RATE_HZ)
    assert np.allclose(x[3:22], 10.0)  # the record itself begins with a step from rest
    assert np.allclose(x[23:], 70.0)
    assert 10.0 < x[22] < 70.0


@pytest.mark.parametrize("name", ["amplifier_lowpass", "sensor_lowpass"])
def test_lowpass_has_its_corner(name):
    tau_s = 1 / (2 * np.pi * 50)
    f = np.array([2.0, 20.0, 50.0, 100.0])
    assert np.allclose(frequency_response(name, f.tolist(), tau_s=tau_s), 1 / (1 + 2j * np.pi * f * tau_s), atol=0.01)
    assert np.array_equal(run(PLAIN, rich(), name, corner_Hz=50.0), run(PLAIN, rich(), name, tau_s=tau_s))


def test_the_amplifier_shrinks_the_loop_inside_and_the_sensor_does_not():
    model, f, tau_s = axis(PIEZO), 20.0, 0.01
    u = sine(6.0, f, 8)
    plain = last_period(run(model, u), f)
    amplifier, sensor = (
        last_period(run(model, u, f"{which}_lowpass", tau_s=tau_s), f) for which in ("amplifier", "sensor")
    )
    third = [harmonics(x, f, 3)[2] / harmonics(x, f, 3)[0] for x in (plain, amplifier, sensor)]
    filtered = abs((1 + 2j * np.pi * f * tau_s) / (1 + 6j * np.pi * f * tau_s))
    assert third[2] == pytest.approx(third[0] * filtered, rel=0.02)
    assert third[1] > 1.5 * third[2]


def test_resonance_has_its_peak_and_its_static_gain():
    f = np.array([1.0, 50.0, 100.0, 140.0])
    s, w, zeta = 2j * np.pi * f, 2 * np.pi * 100.0, 0.05
    for c in (1.0, 0.3):
        expected = 1 - c + c * w**2 / (s**2 + 2 * zeta * w * s + w**2)
        found = frequency_response("resonance", f.tolist(), c=c, f_Hz=100.0, zeta=zeta)
        assert np.allclose(found, expected, rtol=0.02, atol=0.01)


def test_resonance_rings_after_a_step_at_its_frequency():
    u = np.concatenate([np.full(50, 1.0), np.full(2000, 5.0)])
    ring = run(PLAIN, u, "resonance", c=1.0, f_Hz=80.0, zeta=0.02)[60:] - 50
    crossings = np.flatnonzero(np.diff(np.signbit(ring)))[:40]
    f = RATE_HZ / (2 * np.mean(np.diff(crossings)))
    assert f == pytest.approx(80.0 * np.sqrt(1 - 0.02**2), rel=0.01)


def test_several_modes_add():
    given = signal(PLAIN, rich(), "resonance")
    both = effect("resonance").apply(given, {"c": [0.5, 0.2], "f_Hz": [90.0, 160.0], "zeta": [0.02, 0.05]})
    one = effect("resonance").apply(given, {"c": 0.5, "f_Hz": 90.0, "zeta": 0.02})
    two = effect("resonance").apply(given, {"c": 0.2, "f_Hz": 160.0, "zeta": 0.05})
    assert np.allclose(both, one + two - given.value)


def test_load_moves_the_modes_and_not_the_static_gain():
    moved = AdoptedEffect(name="resonance", params={"f_Hz": 150.0 / 1.2, "zeta": 0.05 / 1.2, "c": 1.0})
    x = run(axis(LINEAR, MODE), rich(), "load_change", mass=0.44)
    assert np.allclose(x, run(axis(LINEAR, moved), rich()), atol=1e-9)
    settled = run(axis(LINEAR, MODE), np.full(4000, 5.0), "load_change", mass=0.44)
    assert settled[-1] == pytest.approx(50.0, abs=1e-3)
    assert effect("load_change").untestable(signal(PLAIN, rich(), "load_change"))
    assert effect("load_change").untestable(signal(axis(LINEAR, MODE), rich(), "load_change")) is None


def test_hysteresis_opens_the_loop_by_its_width_at_every_frequency():
    for f in (0.5, 20.0):
        u = sine(SPAN_V, f, 2)
        for reach, slope in ((0.5, 0.0), (0.2, 3.0), (0.95, -4.0), (1.0, 2.0)):
            x = last_period(run(PLAIN, u, "hysteresis", width=0.12, reach=reach, slope=slope), f)
            assert loop_width(x, last_period(u, f), 5.0) == pytest.approx(0.12 * RANGE_UM, rel=0.02)


def test_hysteresis_has_odd_harmonics_only():
    u = sine(6.0, 5.0, 3, low=2.0)
    a = harmonics(last_period(run(PLAIN, u, "hysteresis", width=0.15), 5.0), 5.0, 5)
    assert a[2] > 1e-3 * a[0]
    assert max(a[1], a[3]) < 1e-9 * a[0]


def test_hysteresis_remembers_turning_points_and_forgets_inner_ones():
    def visit(*corners: float) -> float:
        u = np.concatenate([np.linspace(a, b, 200) for a, b in zip((0.0, *corners), corners, strict=False)])
        return run(PLAIN, u, "hysteresis", width=0.15)[-1]

    assert visit(8.0, 4.0) - visit(2.0, 4.0) > 1.0  # the way there matters
    assert visit(8.0, 2.0, 6.0, 3.0, 8.0) == pytest.approx(visit(8.0), abs=1e-9)  # an inner loop is wiped out


def test_hysteresis_rests_where_it_is_told():
    u = sine(6.0, 5.0, 1)
    virgin, remanent = (run(PLAIN, u, "hysteresis", width=0.15, rest_fraction=r) for r in (0.0, 0.9))
    assert remanent[0] == pytest.approx(0.0, abs=1e-9)
    assert remanent[200] < virgin[200] - 1  # back from above: twice the slack before the first way up


@pytest.mark.parametrize("size", ["bend", "skew"])
def test_asymmetry_has_even_harmonics_that_grow_faster_than_the_amplitude(size):
    second = []
    for swing in (4.0, 8.0):
        u = sine(swing, 5.0, 3, low=5.0 - swing / 2)
        a = harmonics(last_period(run(PLAIN, u, "asymmetric_hysteresis", **{size: 0.03}), 5.0), 5.0, 5)
        second.append(a[1])
        odd_only = harmonics(last_period(run(PLAIN, u, "hysteresis", width=0.15), 5.0), 5.0, 2)
        assert a[1] > 1e3 * odd_only[1]
    growth = second[1] / second[0]
    assert growth == pytest.approx(4.0) if size == "bend" else 2.5 < growth < 4.0


def test_skew_makes_a_loop_and_bend_does_not():
    u = last_period(sine(8.0, 5.0, 3, low=1.0), 5.0)
    bend, skew = (
        last_period(run(PLAIN, sine(8.0, 5.0, 3, low=1.0), "asymmetric_hysteresis", **{s: 0.05}), 5.0)
        for s in ("bend", "skew")
    )
    assert abs(loop_width(bend, u, 7.0)) < 0.02
    assert abs(loop_width(skew, u, 7.0)) > 1.0
    assert loop_width(skew, u, 7.0) == pytest.approx(-loop_width(skew, u, 3.0), rel=0.05)  # one end wider, one narrower


def test_softening_raises_the_gain_with_the_level_and_slowly():
    gains = []
    for swing in (1e-3, 2.0, 4.0, 8.0):
        u = sine(swing, 20.0, 200) - swing / 2  # about rest
        x = run(PLAIN, u, "softening", kappa=0.2, tau_s=0.5)
        gains.append(abs(response(last_period(u, 5.0), last_period(x, 5.0), 20.0)) / 10 - 1)
    level = np.array([1e-3, 2.0, 4.0, 8.0]) / SPAN_V / np.sqrt(8)
    assert gains == pytest.approx(0.2 * level, rel=0.05)


def test_softening_is_odd_and_follows_late():
    u = sine(6.0, 20.0, 100) - 3.0
    up, down = (run(PLAIN, sign * u, "softening", kappa=0.2, tau_s=0.5) for sign in (1, -1))
    assert np.allclose(up, -down)
    early, late = np.ptp(up[:100]), np.ptp(up[-100:])
    assert late - 60 > 3 * (early - 60) > 0


def test_creep_is_straight_in_the_logarithm_of_time():
    rate = 50.0
    u = np.concatenate([np.full(5, 1.0), np.full(50 * 60, 6.0)])
    x = run(PLAIN, u, "creep", rate_Hz=rate, gamma=0.015, tau_first_s=0.05, tau_last_s=500.0)
    x0 = run(PLAIN, np.full(len(u), 1.0), "creep", rate_Hz=rate, gamma=0.015, tau_first_s=0.05, tau_last_s=500.0)
    since = np.arange(len(u)) / rate - 0.1
    by_decade = np.interp([0.5, 1.6, 5.0, 16.0, 50.0], since, x - x0)
    slopes = np.diff(by_decade) * 2
    assert slopes == pytest.approx(0.015 * 50.0, rel=0.07)


def test_creep_is_the_same_both_ways_and_takes_lists():
    u = np.concatenate([np.zeros(10), np.full(2000, 5.0)])
    up, down = (run(PLAIN, s * u, "creep", k=[0.01, 0.02], tau_s=[0.1, 0.01]) for s in (1, -1))
    assert np.allclose(up, -down)
    t = times(2000 / RATE_HZ)
    expected = 50 * (1 + 0.01 * (1 - np.exp(-t / 0.1)) + 0.02 * (1 - np.exp(-t / 0.01)))
    assert up[10:] == pytest.approx(expected, abs=0.03)


def test_slew_shows_above_its_onset_only():
    traverse_s = 0.05  # 200 V/s: the onset of 8 V peak to peak is at 7.96 Hz
    below, above = sine(8.0, 7.9, 4), sine(8.0, 12.0, 4)
    sharp = run(PLAIN, below, "slew_limit", traverse_s=traverse_s, loop_s=0.0)
    assert sharp == pytest.approx(run(PLAIN, below), abs=1e-9)
    x = run(PLAIN, above, "slew_limit", traverse_s=traverse_s)
    rates = np.abs(np.diff(x)) * RATE_HZ  # the rows beside a corner of the way have its area, not its rate
    assert np.quantile(rates, 0.9) == pytest.approx(200 * 10, rel=1e-3)
    assert np.std(x - run(PLAIN, above)) > 1
    assert "200 V/s" in effect("slew_limit").reads({"traverse_s": traverse_s}, PLAIN)


def test_a_soft_slew_limit_lags_the_more_the_nearer_its_rate():
    """By loop_s (artanh(p) / p - 1) on a ramp of the part p of the largest rate."""
    traverse_s, loop_s = 0.05, 1e-3
    for part in (0.1, 0.5, 0.9):
        u = np.minimum(200 * part * np.arange(int(0.05 / part * RATE_HZ)) / RATE_HZ, 8.0)
        lagged = run(PLAIN, u, "slew_limit", traverse_s=traverse_s, loop_s=loop_s)
        lag_s = (u - lagged / 10)[int(0.02 / part * RATE_HZ)] / (200 * part)
        assert lag_s == pytest.approx(loop_s * (np.arctanh(part) / part - 1), rel=1e-2)


def test_saturation_has_flat_tops_at_one_voltage():
    for f in (1.0, 30.0):
        x = run(PLAIN, sine(9.0, f, 2, low=0.5), "saturation", top=0.1, bottom=0.2)
        assert x.max() == pytest.approx(90.0)
        assert x.min() == pytest.approx(20.0)
        assert np.mean(x == x.max()) > 0.1
    inside = sine(4.0, 5.0, 2, low=3.0)
    assert np.array_equal(run(PLAIN, inside, "saturation", top=0.1, bottom=0.2)[1:], run(PLAIN, inside)[1:])


@pytest.mark.parametrize("level", [5.0, -5.0])
def test_leakage_decays_towards_rest_from_both_sides(level):
    x = run(PLAIN, np.full(100, level), "charge_leakage", rate_Hz=10.0, rate_per_s=0.2)
    t = np.arange(100) / 10.0
    assert x[5:] == pytest.approx(10 * level * np.exp(-0.2 * t[5:]), rel=0.03)


def test_a_sensor_curve_depends_on_the_position_alone():
    model = axis(PIEZO)
    u = sine(8.0, 5.0, 2)
    plain, bent = run(model, u), run(model, u, "sensor_nonlinearity", quadratic=0.01, cubic=0.01)
    turn, error = 600, bent - plain  # the second period: 400 rows down after 600, then up again
    up, down = slice(400, turn), slice(turn, 800)
    assert np.allclose(np.interp(plain[down], plain[up], error[up])[5:-50], error[down][5:-50], atol=5e-3)
    assert np.abs(np.interp(u[down], u[up], error[up]) - error[down]).max() > 0.05


def test_a_sensor_curve_is_right_at_both_ends_and_peaks_at_its_size():
    x = run(PLAIN, np.linspace(0, 10, 2001), "sensor_nonlinearity", quadratic=0.01) - np.linspace(0, 100, 2001)
    assert x[[0, -1]] == pytest.approx([0, 0], abs=1e-9)
    assert x.max() == pytest.approx(1.0)
    for name in ("cubic", "quartic", "linear"):
        y = run(PLAIN, np.linspace(0, 10, 2001), "sensor_nonlinearity", **{name: 0.01}) - np.linspace(0, 100, 2001)
        assert np.abs(y).max() == pytest.approx(1.0, rel=1e-3)


def test_a_gain_change_scales_about_rest():
    model = axis(PIEZO)
    rest = run(model, np.zeros(1))[0]
    x, y = run(model, rich()), run(model, rich(), "gain_change", gain=0.04)
    assert np.allclose(y - rest, 1.04 * (x - rest))


def test_an_offset_shifts():
    assert np.allclose(run(PLAIN, rich(), "offset", offset_um=2.5) - run(PLAIN, rich()), 2.5)


def test_quantisation_puts_values_on_a_grid():
    u = rich()
    x = simulate(PLAIN, times(1.5), u, extra=[(effect("quantisation"), {"lsb_um": 0.5})], rng=np.random.default_rng(0))
    assert np.allclose(x / 0.5, np.round(x / 0.5))
    assert np.abs(x - run(PLAIN, u)).max() <= 0.25 + 1e-12


def test_drift_goes_on_whatever_the_voltage_does_and_from_record_to_record():
    drift = {"ramp_um_per_s": 0.01, "rise_um": 2.0, "tau_s": 40.0}
    added = [run(PLAIN, u, "thermal_drift", t0=100.0, **drift) - run(PLAIN, u) for u in (rich(), np.zeros(3000))]
    assert np.allclose(*added)
    t = 100.0 + times(1.5)
    assert np.allclose(added[0], 0.01 * t + 2 * (1 - np.exp(-t / 40.0)))


def test_hum_is_a_line_locked_to_the_clock():
    whole = run(PLAIN, np.zeros(4000), "mains_hum", sin1_um=0.03, cos2_um=0.01, f_Hz=50.0)
    a = harmonics(whole, 50.0, 4)
    assert a == pytest.approx([0.03, 0.01, 0.0, 0.0], abs=1e-9)
    later = run(PLAIN, np.zeros(1000), "mains_hum", t0=1.5, sin1_um=0.03, cos2_um=0.01, f_Hz=50.0)
    assert np.allclose(whole[3000:], later)
    words = effect("mains_hum").reads(effect("mains_hum").complete({"sin1_um": 0.03, "cos1_um": 0.04}), PLAIN)
    assert words.startswith("50 nm at 50 Hz")


def test_vibration_peaks_where_it_should():
    n = 40_000
    params = {"rms_um": 0.1, "f_Hz": 120.0, "bandwidth_Hz": 10.0}
    rng = np.random.default_rng(0)
    x = simulate(PLAIN, np.arange(n) / RATE_HZ, np.zeros(n), extra=[(effect("vibration"), params)], rng=rng)
    power = np.abs(np.fft.rfft(x)) ** 2
    f = np.fft.rfftfreq(n, 1 / RATE_HZ)
    near = (f > 100) & (f < 140)
    assert power[near].sum() > 0.7 * power.sum()
    assert np.std(x) == pytest.approx(0.1, rel=0.1)


def test_coupling_shows_only_when_the_other_axis_moves():
    u, t = np.zeros(3000), times(1.5)
    still, moving = np.zeros(3000), 20 * np.sin(2 * np.pi * 5 * t)
    extra = [(effect("cross_coupling"), {"from_y": 0.03, "from_z": 0.5})]
    assert np.ptp(simulate(PLAIN, t, u, others_um={"y": still}, extra=extra)) == 0
    x = simulate(PLAIN, t, u, others_um={"y": moving, "z": still}, extra=extra)
    assert np.allclose(x, 0.03 * moving)
    alone = Chain(PLAIN, t, u).signal_at(Place.COUPLING)
    assert effect("cross_coupling").untestable(alone)
    assert (
        effect("cross_coupling").untestable(Chain(PLAIN, t, u, others_um={"y": moving}).signal_at(Place.COUPLING))
        is None
    )


def test_backlash_holds_by_one_size_after_every_reversal():
    for swing in (2.0, 8.0):
        x = last_period(run(PLAIN, sine(swing, 5.0, 3), "backlash", width=0.05), 5.0)
        u = last_period(sine(swing, 5.0, 3), 5.0)
        assert np.ptp(x) == pytest.approx(10 * swing - 5.0)
        assert loop_width(x, u, swing / 2) == pytest.approx(5.0, rel=0.02)


def test_backlash_is_one_more_play():
    """Nobody can tell them apart from one axis: the gap engine has to call it a tie."""
    one_play = LINEAR.model_copy(update={"gain_um_per_V": 0.0, "play_r_V": (0.25,), "play_w_um_per_V": (10.0,)})
    assert np.allclose(run(PLAIN, rich(), "backlash", width=0.05), run(axis(one_play), rich()))


def test_jitter_is_silent_at_the_turning_points():
    u = sine(8.0, 5.0, 4)
    given = signal(PLAIN, u, "sampling_jitter")
    variance = effect("sampling_jitter").variance(given, {"rms_s": 1e-5})[1:]
    speed = np.abs(np.gradient(10 * u) * RATE_HZ)
    assert np.sqrt(variance)[1:] == pytest.approx(1e-5 * speed[1:], abs=1e-6)


@given(bottom=st.floats(0.11, 0.4), rest=st.floats(-1.0, 1.0))
def test_memory_starts_where_a_rail_has_held_the_voltage(bottom, rest):
    """Plays know differences of the voltage alone: what never falls below a rail moves as if the rail were 0 V."""
    alone = {"rest_fraction": rest, "deadzone_d_V": (), "deadzone_s_um_per_V": (), "delay_s": 0.0}
    model, low_V = axis(PIEZO.model_copy(update=alone)), -1.0 + 10.0 * bottom
    u = np.concatenate([np.zeros(5), rich(600)])
    railed, free = run(model, u, "saturation", bottom=bottom, top=0.0), run(model, np.maximum(u, low_V) - low_V)
    assert np.allclose(railed - railed[0], free - free[0], atol=1e-9)
