"""The simulated stage: its equations against an independent solution, and the laws a piezo stage obeys."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.special import erfc

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Sensor, TimeView
from phaselead.model.stage_file import Stage
from phaselead.sim.device import Plant
from phaselead.sim.plant import built_in, plant_parameters

TS = 1 / 5000
ZERO = 32768
CODES_PER_V = 3200
UM_PER_CODE = 280 / 65536
LATCH_S = 30e-6
VIEW = TimeView(gain_um_per_V=10, u_range_V=(0, 10), rate_Hz=5000)


def dac(*volts):
    """DAC codes, shape (n, 3), from one array per axis (or a constant)."""
    n = max(np.size(u) for u in volts)
    full = [np.broadcast_to(u, n) for u in (*volts, *[0.0] * (3 - len(volts)))]
    return np.round(ZERO + CODES_PER_V * np.stack(full, 1)).astype(np.uint16)


def volts(codes):
    return (codes.astype(float) - ZERO) / CODES_PER_V


def position_um(adc):
    return adc.astype(float) * UM_PER_CODE - 10


def true_positions(stage, codes, seed=0):
    plant = Plant(plant_parameters(stage, seed))
    plant.trace(len(codes))
    adc = plant.run(codes)
    return plant.take_trace()[1], adc


def stage_of(view, effects=(), noise=0.0, **axis):
    model = AxisModel(time=view, effects=tuple(effects), sensor=Sensor(noise_um_rms=noise), **axis)
    return Stage(name="test", axes={"x": model})


def creep(k, tau_s):
    return AdoptedEffect(name="creep", params={"k": k, "tau_s": tau_s})


def sine(swing_V, f_Hz, periods):
    t = np.arange(round(periods / f_Hz / TS)) * TS
    return swing_V / 2 * (1 - np.cos(2 * np.pi * f_Hz * t))


# ------------------------------------------------------------------ against an independent solution


def operator_um(view, u):
    """The time view, written out: plays one after another, then dead zones."""
    p = [view.rest_fraction * r for r in view.play_r_V]
    x = np.empty(len(u))
    for k, now in enumerate(u):
        p = [max(now - r, min(now + r, old)) for r, old in zip(view.play_r_V, p, strict=True)]
        x[k] = view.gain_um_per_V * now + np.dot(view.play_w_um_per_V, p)
        x[k] += sum(s * max(now - d, 0) for s, d in zip(view.deadzone_s_um_per_V, view.deadzone_d_V, strict=True))
    return x


def chain(k, tau_s, f_Hz, zeta, corner_Hz):
    """A, b of creep -> mode -> sensor as one dense state space, and the rows of true and sensed position."""
    n, w = len(k), 2 * np.pi * f_Hz
    a, b = np.zeros((n + 3, n + 3)), np.zeros(n + 3)
    for i in range(n):
        a[i, i], b[i] = -1 / tau_s[i], k[i] / tau_s[i]
    a[n, n + 1] = 1
    a[n + 1, :n], a[n + 1, n], a[n + 1, n + 1], b[n + 1] = w**2, -(w**2), -2 * zeta * w, w**2
    a[n + 2, n], a[n + 2, n + 2] = 2 * np.pi * corner_Hz, -2 * np.pi * corner_Hz
    return a, b, n, n + 2


def held(a, b, seconds):
    """exp(A t) and the response to a constant input over t."""
    n = len(b)
    full = expm(np.block([[a, b[:, None]], [np.zeros((1, n + 1))]]) * seconds)
    return full[:n, :n], full[:n, n]


def solve(a, b, h, delay_s):
    """States at the samples; the input changes to h[i] at i Ts + delay."""
    whole, split = divmod(delay_s, TS)
    first, second = held(a, b, split), held(a, b, TS - split)
    z, out, old = np.zeros(len(b)), [], 0.0
    for i in range(len(h)):
        out.append(z)
        new = h[i - int(whole)] if i >= whole else 0.0
        z = first[0] @ z + first[1] * old
        z = second[0] @ z + second[1] * new
        old = new
    return np.array(out)


APART = st.lists(st.integers(0, 80), min_size=1, max_size=4, unique=True)
TAUS_s = APART.map(lambda places: [1e-3 * 10 ** (i / 20) for i in places])


@settings(max_examples=12, deadline=None)
@given(
    delay_s=st.floats(0, 1.5e-3),
    f_Hz=st.floats(40, 900),
    zeta=st.floats(0.005, 0.6),
    corner_Hz=st.floats(300, 5000),
    tau_s=TAUS_s,
    seed=st.integers(0, 1000),
)
def test_the_kernel_solves_its_equations(delay_s, f_Hz, zeta, corner_Hz, tau_s, seed):
    """But where poles nearly coincide, which are then told apart by a little: the next test."""
    rng = np.random.default_rng(seed)
    codes = dac(np.repeat(rng.uniform(-1.5, 9, 60), 5))
    k = rng.uniform(-0.02, 0.02, len(tau_s)).tolist()
    built = built_in("xyz250").axes["x"].time
    view = built.model_copy(update={"delay_s": delay_s})
    effects = [
        creep(k, tau_s),
        AdoptedEffect(name="resonance", params={"f_Hz": f_Hz, "zeta": zeta}),
        AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": corner_Hz}),
    ]
    found, adc = true_positions(stage_of(view, effects), codes)
    a, b, at_true, at_sensed = chain(k, tau_s, f_Hz, zeta, corner_Hz)
    rest = operator_um(view, [0.0])[0]
    z = solve(a, b, operator_um(view, volts(codes[:, 0])) - rest, delay_s + LATCH_S)
    offset = rest + view.offset_um
    assert abs(found[:, 0] - offset - z[:, at_true]).max() < 1e-7
    sensed = np.clip(z[:, at_sensed] + offset, -10, 270 - UM_PER_CODE)
    assert abs(position_um(adc[:, 0]) - sensed).max() <= UM_PER_CODE / 2 + 1e-7


def test_poles_that_coincide_are_told_apart():
    view = TimeView(gain_um_per_V=10, u_range_V=(0, 10), rate_Hz=5000)
    effects = [
        creep([0.01, 0.02], [0.1, 0.1]),
        AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 1 / (0.2 * np.pi)}),
    ]
    found, adc = true_positions(stage_of(view, effects), dac(np.full(20_000, 5.0)))
    assert found[-1, 0] == pytest.approx(50 * 1.03, abs=0.01)
    assert position_um(adc[-1, 0]) == pytest.approx(50 * 1.03, abs=0.01)


def test_without_dynamics_the_stage_is_its_operator():
    view = TimeView(gain_um_per_V=20, u_range_V=(0, 10), rate_Hz=5000)
    found, _ = true_positions(stage_of(view), dac(sine(5, 20, 3)))
    assert abs(found[1:, 0] - 20 * volts(dac(sine(5, 20, 3)))[:-1, 0]).max() < 1e-9


# ------------------------------------------------------------------ laws of a piezo stage


@pytest.fixture(scope="module")
def stage():
    return built_in("xyz250")


def test_it_rests_at_zero_until_it_is_driven(stage):
    found, adc = true_positions(stage, dac(np.zeros(50_000)))
    assert abs(found).max() < 1e-8
    assert abs(position_um(adc).mean(0)).max() < 1e-3


def test_the_noise_is_ten_nanometres_on_every_axis(stage):
    _, adc = true_positions(stage, dac(np.zeros(100_000)))
    x_um = position_um(adc)
    assert x_um.std(0) == pytest.approx(np.hypot(0.010, UM_PER_CODE / np.sqrt(12)), rel=0.01)
    assert abs(np.corrcoef(x_um.T) - np.eye(3)).max() < 0.02


def test_the_noise_is_white_and_gaussian_to_its_tails():
    plant = Plant(plant_parameters(stage_of(VIEW, noise=2.0)))  # so large that the codes do not show
    rest = dac(np.zeros(1_000_000))
    z = np.concatenate([position_um(plant.run(rest)[:, 0]) / 2 for _ in range(8)])
    assert z.mean() == pytest.approx(0, abs=0.002)
    assert z.std() == pytest.approx(1, abs=0.002)
    assert (z**4).mean() == pytest.approx(3, abs=0.015)
    for limit in (1, 2, 3, 3.6541, 4, 4.3):  # the fourth is where the generator's tail begins
        share = erfc(limit / np.sqrt(2))
        assert (abs(z) > limit).mean() == pytest.approx(share, abs=4 * np.sqrt(share / len(z)))
    assert abs(np.mean(z[1:] * z[:-1])) < 0.002


def test_the_same_seed_gives_the_same_bits_and_another_another(stage):
    codes = dac(sine(5, 10, 5))
    one, again, other = (true_positions(stage, codes, seed)[1] for seed in (7, 7, 8))
    assert np.array_equal(one, again)
    assert not np.array_equal(one[:, 0], other[:, 0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_creep_goes_on_in_the_direction_of_the_step(stage, axis):
    u = [0.0, 0.0, 0.0]
    u[axis] = 5.0
    up = np.full((100_000, 3), u)
    codes = dac(*np.concatenate([up, 0 * up]).T)
    x = true_positions(stage, codes)[0][:, axis]
    after = slice(5000, 100_000)  # a second later the mode has died away
    steps = np.diff(x[after])
    assert steps.min() > 0
    back = np.diff(x[105_000:])
    assert back.max() < 0
    drift = np.interp([1, 10], np.arange(100_000) * TS, x[:100_000])
    assert 0.004 < (drift[1] - drift[0]) / x[5000] < 0.015  # per cent of a decade, as PZT does


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_static_voltage_ends_at_the_operator_and_all_its_creep(stage, axis):
    name = "xyz"[axis]
    u = [0.0, 0.0, 0.0]
    u[axis] = 6.0
    codes = np.repeat(dac(*u), 400_000, 0)
    x = true_positions(stage, codes)[0][-1, axis]
    model = stage.axes[name]
    h = operator_um(model.time, [0.0, 6.0])
    total = 1 + sum(model.effects[0].params["k"])
    assert x == pytest.approx((h[1] - h[0]) * total, rel=1e-3)


def test_loops_close_when_nothing_creeps(stage):
    view = stage.axes["x"].time
    codes = dac(sine(8, 5, 4))
    x = true_positions(stage_of(view), codes)[0][:, 0]
    assert abs(x[1000:2000] - x[2000:3000]).max() < 1e-9


def test_the_loop_is_as_wide_as_a_piezos_and_not_symmetric(stage):
    codes = dac(sine(8, 1, 2))
    x, u = true_positions(stage, codes)[0][5000:, 0], volts(codes)[5000:, 0]
    up, down = np.argsort(u[:2500]), np.argsort(u[2500:])
    grid = np.linspace(0.1, 7.9, 200)
    width = np.interp(grid, u[2500:][down], x[2500:][down]) - np.interp(grid, u[:2500][up], x[:2500][up])
    assert 0.08 < width.max() / np.ptp(x) < 0.2
    even = second_harmonic(x)
    symmetric = stage.axes["x"].time.model_copy(update={"deadzone_d_V": (), "deadzone_s_um_per_V": ()})
    assert even > 0.003
    assert even > 10 * second_harmonic(true_positions(stage_of(symmetric), codes)[0][5000:, 0])


def second_harmonic(x):
    """Of one period, as a share of the first."""
    lines = abs(np.fft.rfft(x))
    return lines[2] / lines[1]


def test_a_minor_loop_stays_inside_the_major_one(stage):
    view = stage.axes["x"].time
    major, minor = sine(8, 5, 2), 4 + 1.5 * np.sin(np.linspace(0, 6 * np.pi, 3000))
    u = np.concatenate([major, np.linspace(0, 4, 500), minor])
    x = true_positions(stage_of(view), dac(u))[0][:, 0]
    outer = slice(1000, 2000)
    top, low = u[outer][:500], u[outer][500:]
    rising = np.interp(u[3000:], top, x[outer][:500])
    falling = np.interp(u[3000:], low[::-1], x[outer][500:][::-1])
    assert (x[3001:] >= rising[:-1] - 0.05).all()
    assert (x[3001:] <= falling[:-1] + 0.05).all()


def test_full_voltage_is_about_250_um_and_fits_the_sensor(stage):
    for axis in range(3):
        u = [0.0, 0.0, 0.0]
        u[axis] = 10.0
        _, adc = true_positions(stage, np.repeat(dac(*u), 200_000, 0))
        assert 235 < position_um(adc[-1, axis]) < 262


def test_minus_two_volts_reach_the_sensors_rail(stage):
    _, adc = true_positions(stage, np.repeat(dac(-2.0), 1000, 0))
    assert (adc[-100:, 0] == 0).all()


@pytest.mark.parametrize(("axis", "mode_Hz"), [(0, 200), (1, 185), (2, 170)])
def test_a_step_rings_at_the_first_mode(stage, axis, mode_Hz):
    u = [0.0, 0.0, 0.0]
    u[axis] = 1.0
    x = true_positions(stage, np.repeat(dac(*u), 5000, 0))[0][:, axis]
    spectrum = abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)), 65536))
    f = np.fft.rfftfreq(65536, TS)
    band = (f > 100) & (f < 400)
    assert f[band][spectrum[band].argmax()] == pytest.approx(mode_Hz, abs=1)
    envelope = [abs(x[a : a + 100] - x[-1]).max() for a in (100, 600)]
    assert np.log(envelope[0] / envelope[1]) / (500 * TS) == pytest.approx(0.02 * 2 * np.pi * mode_Hz, rel=0.15)


def test_cross_talk_reaches_four_per_cent_and_no_more(stage):
    shares = []
    for driven in range(3):
        u = [0.0, 0.0, 0.0]
        u[driven] = sine(8, 5, 3)
        x = true_positions(stage, dac(*u))[0]
        spans = np.ptp(x, axis=0)
        shares += [spans[i] / spans[driven] for i in range(3) if i != driven]
    assert max(shares) == pytest.approx(0.04, abs=1e-4)
    assert min(shares) > 0.005


def test_the_axes_differ_by_a_few_per_cent(stage):
    spans = []
    for axis in range(3):
        u = [0.0, 0.0, 0.0]
        u[axis] = sine(6, 2, 2)
        spans.append(np.ptp(true_positions(stage, dac(*u))[0][:, axis]))
    assert len({round(span) for span in spans}) == 3
    assert max(spans) / min(spans) < 1.1


def test_the_sensor_has_a_kilohertz_at_least(stage):
    for model in stage.axes.values():
        (lowpass,) = (effect for effect in model.effects if effect.name == "sensor_lowpass")
        assert lowpass.params["corner_Hz"] >= 1000
        assert model.sensor.bandwidth_Hz == lowpass.params["corner_Hz"]


# ------------------------------------------------------------------ what cannot be simulated


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (AdoptedEffect(name="creep", params={"k": 0.1}), "no parameter tau_s"),
        (creep([0.1, 0.2], [1]), "its partner has 2"),
        (creep([0.1], [0]), "tau_s must be above 0"),
        (creep([0.1] * 9, [1.0] * 9), "takes 8"),
        (
            AdoptedEffect(name="resonance", params={"f_Hz": [100, 200], "zeta": [0.1, 0.1]}),
            "c has 1 terms, its partner has 2",
        ),
        (AdoptedEffect(name="resonance", params={"f_Hz": 100, "zeta": 1.5}), "zeta"),
        (AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 100, "order": 2}), "unknown parameter order"),
        (AdoptedEffect(name="delay", params={"delay_s": -1.0}), "delay_s must be at least 0"),
    ],
)
def test_what_the_simulator_does_not_know_is_refused(effect, words):
    with pytest.raises(BadInput, match=words) as refusal:
        plant_parameters(stage_of(VIEW, [effect]))
    assert "\n" not in str(refusal.value)


def test_a_table_alone_cannot_be_simulated():
    with pytest.raises(BadInput, match="time view"):
        plant_parameters(Stage(name="t", axes={"y": AxisModel()}))


def test_axes_that_are_not_in_the_file_stand_still():
    found, adc = true_positions(stage_of(VIEW, noise=0.01), dac(5.0, 5.0, np.full(100, 5.0)))
    assert found[-1, 0] == pytest.approx(50)
    assert not found[:, 1:].any()
    assert abs(position_um(adc)[:, 1:]).max() < 0.1


def pushed(stage, um, codes):
    """True position of x, pushed from tick 100 on."""
    plant = Plant(plant_parameters(stage))
    plant.trace(len(codes))
    plant.push(0, um, 100)
    plant.run(codes)
    return plant.take_trace()[1][:, 0]


@settings(max_examples=20)
@pytest.mark.parametrize("linked", [False, True])
@given(um=st.floats(0.1, 5), level_V=st.floats(0, 5))
def test_a_force_displaces_by_its_size_and_rings_the_mode(linked, um, level_V):
    """Both kernels: nothing before it, its size in the end whatever the voltage, nearly twice as much in between."""
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02})
    bow = AdoptedEffect(name="dac_nonlinearity", params={"bow_LSB": 1.0})
    stage, codes = stage_of(VIEW, (mode, bow) if linked else (mode,)), dac(np.full(3000, level_V))
    moved = pushed(stage, um, codes) - pushed(stage, 0.0, codes)
    assert not moved[:101].any()
    assert moved[-200:].mean() == pytest.approx(um, rel=0.01)
    assert 1.85 * um < moved.max() < 2 * um


def test_a_force_that_has_passed_or_is_one_too_many_is_refused(stage):
    plant = Plant(plant_parameters(stage))
    plant.run(np.zeros((10, 3), dtype=np.uint16))
    with pytest.raises(BadInput, match="has passed already"):
        plant.push(0, 1.0, 5)
    for _ in range(64):
        plant.push(1, 0.1, 20)
    with pytest.raises(BadInput, match="more than 64"):
        plant.push(1, 0.1, 20)
