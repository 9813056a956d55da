"""Virtual stages with any effect of the catalogue: the kernel's own equations against the model's, and its laws."""

import ctypes

import numpy as np
import pytest

from phaselead.errors import BadInput
from phaselead.model import TICK_S
from phaselead.model.axis import AdoptedEffect, AxisModel, Sensor, TimeView
from phaselead.model.chain import simulate
from phaselead.model.effects import Place, catalogue
from phaselead.model.stage_file import Stage
from phaselead.sim.device import Plant
from phaselead.sim.linked import linked_parameters
from phaselead.sim.plant import LATCH_S, built_in, plant_parameters

ROWS = 20_000
VIEW = TimeView(
    gain_um_per_V=12,
    play_r_V=(0.1, 0.4, 1.0, 2.0),
    play_w_um_per_V=(1.5, 1.0, 1.5, 1.0),
    deadzone_d_V=(3.0, 6.0),
    deadzone_s_um_per_V=(0.5, 0.4),
    rest_fraction=0.3,
    u_range_V=(0, 10),
    rate_Hz=5000,
)
STAIRS_S = LATCH_S + TICK_S / 2
"""How late a held voltage acts, beside one that runs straight from row to row."""
SMOOTH = AdoptedEffect(name="sensor_lowpass", params={"tau_s": 4e-4})
MODE = AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.05})
TWO_MODES = AdoptedEffect(name="resonance", params={"c": (0.2, 0.8), "f_Hz": (350.0, 200.0), "zeta": (0.03, 0.05)})
NOISES = [name for name, effect in catalogue().items() if effect.variance is not None]


def sizes(name):
    """Large enough to stand out of the converter's steps."""
    larger = {
        "slew_limit": {"traverse_s": 0.15, "loop_s": 5e-3},
        "offset": {"offset_um": 1.0},
        "dac_nonlinearity": {"bow_LSB": 100.0, "bit1_LSB": 30.0, "bit2_LSB": -80.0, "bit4_LSB": 60.0, "bit5_LSB": 50.0},
        "thermal_drift": {"ramp_um_per_s": 0.2, "rise_um": 3.0, "tau_s": 6.0},
        "mains_hum": {"sin1_um": 0.3, "cos1_um": 0.2, "sin2_um": 0.1, "cos3_um": 0.2},
        "sensor_nonlinearity": {"quadratic": 0.01, "cubic": -0.02, "quartic": 0.01, "linear": 0.01},
        "load_change": {"mass": 1.0, "damping": 0.5, "others": 0.3},
        "rate_dependence": {"growth": 0.03, "stribeck": 0.02, "coulomb": 0.03},
        "dead_band": {"width_V": 0.1},
        "crossover_distortion": {"width_V": 0.3, "tau_s": 5e-3},
        "stiffness_nonlinearity": {"square": 0.02, "cube": -0.03},
        "sensor_lowpass": {"tau_s": 1e-3},
        "amplifier_lowpass": {"tau_s": 1e-3},
        "delay": {"delay_s": 2.345e-3},
        "hysteresis": {"width": 0.15, "slope": 1.0, "rest_fraction": -0.4, "lost": 0.07},
        "asymmetric_hysteresis": {"bend": 0.03, "skew": 0.05, "reach": 0.3},
        "softening": {"kappa": 0.2, "about_mean": 0.5, "tau_s": 0.2, "exponent": 1.6},
        "charge_leakage": {"rate_per_s": 0.2},
    }
    return {**catalogue()[name].typical, **larger.get(name, {})}


def drive():
    """Voltages (n,) that the converter can say."""
    t = np.arange(ROWS) * TICK_S
    u = 5 - 4 * np.cos(2 * np.pi * 3 * t) * np.exp(-t / 6) - 0.9 * np.cos(2 * np.pi * 11 * t)
    return t, np.round((u - u[0]) * 3200) / 3200


def measure(stage, u, *, linked=False, axis=0, seed=0):
    """Sensed positions (n, 3) and true ones."""
    codes = np.full((len(u), 3), 32768, np.uint16)
    codes[:, axis] = np.round(32768 + 3200 * u)
    parameters = plant_parameters(stage, seed)
    if linked:
        parameters.linked = ctypes.pointer(linked_parameters(stage, TICK_S, LATCH_S, seed))
    plant = Plant(parameters)
    plant.trace(len(u))
    adc = plant.run(codes)
    return adc * (280 / 65536) - 10, plant.take_trace()[1]


def stage_of(*effects, view=VIEW, noise=0.0):
    return Stage(name="t", axes={"x": AxisModel(time=view, effects=effects, sensor=Sensor(noise_um_rms=noise))})


def test_it_is_the_exact_kernel_where_both_can_be_the_stage():
    stage = built_in("xyz250")
    _, u = drive()
    assert not plant_parameters(stage).linked
    for axis in range(3):
        exact, linked = (measure(stage, u, linked=on, axis=axis)[1] for on in (False, True))
        assert abs(exact - linked).max() < 2e-3  # of 200 um


@pytest.mark.parametrize("name", [n for n in catalogue() if n not in NOISES and catalogue()[n].place != Place.COUPLING])
def test_an_effect_shows_as_its_equation_says(name):
    """Written twice: C here, the catalogue's own there. The base is subtracted from both."""
    t, u = drive()
    base = (TWO_MODES, SMOOTH) if name == "load_change" else (SMOOTH,)
    effect = AdoptedEffect(name=name, params=sizes(name))
    shown = [measure(stage_of(*base, *more), u, linked=True)[0][:, 0] for more in ((effect,), ())]
    late = VIEW.model_copy(update={"delay_s": STAIRS_S})
    told = [simulate(AxisModel(time=late, effects=(*base, *more)), t, u) for more in ((effect,), ())]
    made, meant = shown[0] - shown[1], told[0] - told[1]
    assert np.sqrt(np.mean(meant**2)) > 0.05
    assert np.std(made - meant) < 0.006 + 0.02 * np.std(meant)
    assert abs(np.mean(made - meant)) < 0.003 + 0.01 * abs(np.mean(meant))


@pytest.mark.parametrize(("bend", "u_range_V"), [(0.2, (0, 10)), (-0.2, (3, 8)), (0.1, (-9, 2))])
def test_the_field_bends_as_its_equation_says(bend, u_range_V):
    """Also where the voltage leaves the fitted range, and with friction that fades."""
    t, u = drive()
    bent = VIEW.model_copy(update={"field_bend": bend, "u_range_V": u_range_V})
    effects = (AdoptedEffect(name="fading_hysteresis", params=sizes("fading_hysteresis")), SMOOTH)
    shown = measure(stage_of(*effects, view=bent), u)[0][:, 0]
    late = bent.model_copy(update={"delay_s": STAIRS_S})
    told, even = (
        simulate(AxisModel(time=view, effects=effects), t, u)
        for view in (late, late.model_copy(update={"field_bend": 0.0}))
    )
    assert np.std(told - even) > 1
    assert np.std(shown - told) < 0.01


@pytest.mark.parametrize(
    ("tilt", "taper", "u_range_V"), [(0.5, 0.0, (0, 10)), (-0.3, 0.4, (3, 8)), (0.2, -0.5, (-9, 2))]
)
def test_plays_weigh_as_their_equation_says(tilt, taper, u_range_V):
    """Also where plays leave the fitted range, in a bent field, and beside plays of an effect, which weigh evenly."""
    t, u = drive()
    uneven = VIEW.model_copy(
        update={"play_tilt": tilt, "play_taper": taper, "field_bend": 0.05, "u_range_V": u_range_V}
    )
    effects = (AdoptedEffect(name="hysteresis", params=sizes("hysteresis")), SMOOTH)
    shown = measure(stage_of(*effects, view=uneven), u)[0][:, 0]
    late = uneven.model_copy(update={"delay_s": STAIRS_S})
    told, even = (
        simulate(AxisModel(time=view, effects=effects), t, u)
        for view in (late, late.model_copy(update={"play_tilt": 0.0, "play_taper": 0.0}))
    )
    assert np.std(told - even) > 0.5
    assert np.std(shown - told) < 0.01


@pytest.mark.parametrize("name", ["creep", "resonance", "sensor_lowpass", "delay", "amplifier_lowpass", "hysteresis"])
def test_what_stands_twice_acts_twice(name):
    t, u = drive()
    effects = (SMOOTH, *[AdoptedEffect(name=name, params=sizes(name))] * 2)
    shown = measure(stage_of(*effects), u)[0][:, 0]
    told = simulate(AxisModel(time=VIEW.model_copy(update={"delay_s": STAIRS_S}), effects=effects), t, u)
    assert np.std(shown - told) < 0.06  # of 110 um


def test_a_delay_of_many_ticks_is_a_shift():
    _, u = drive()
    late = VIEW.model_copy(update={"delay_s": 0.017})
    assert abs(measure(stage_of(), u, linked=True)[1][:-85] - measure(stage_of(view=late), u)[1][85:]).max() < 1e-9


def test_rest_is_rest_even_beyond_a_rail():
    effects = [
        AdoptedEffect(name=name, params=sizes(name)) for name in ("saturation", "charge_leakage", "creep", "softening")
    ]
    still = measure(stage_of(*effects, MODE), np.zeros(2000))[1]
    assert np.ptp(still[:, 0]) == 0


def test_other_axes_move_this_one():
    model = AxisModel(time=VIEW, sensor=Sensor(noise_um_rms=0))
    coupled = model.model_copy(
        update={"effects": (AdoptedEffect(name="cross_coupling", params={"from_x": 0.03, "lag_s": 0.002}),)}
    )
    _, u = drive()
    x = measure(Stage(name="t", axes={"x": model, "y": coupled}), u)[1]
    moved = x[:, 0] - x[0, 0]
    state, lagged = 0.0, []
    for now in moved:
        lagged.append(state)
        state += (1 - np.exp(-TICK_S / 0.002)) * (now - state)
    assert np.std(x[:, 1] - x[0, 1] - 0.03 * np.array(lagged)) < 0.01 * 0.03 * np.std(moved) + 0.02
    assert not (x[:, 2] - x[0, 2]).any()


def test_vibration_has_its_size_and_its_peak():
    shaking = AdoptedEffect(name="vibration", params={"rms_um": 0.5, "f_Hz": 120.0, "bandwidth_Hz": 10.0})
    x = np.concatenate([measure(stage_of(shaking), np.zeros(ROWS), seed=s)[0][:, 0] for s in range(5)])
    assert x.std() == pytest.approx(0.5, rel=0.1)
    power = np.mean(abs(np.fft.rfft((x - x.mean()).reshape(20, -1) * np.hanning(5000))) ** 2, axis=0)
    assert power.argmax() == pytest.approx(120, abs=4)
    above_half = np.flatnonzero(power > power.max() / 2)
    assert 5 < np.ptp(above_half) < 20


def test_jitter_grows_with_the_speed():
    _, u = drive()
    jitter = AdoptedEffect(name="sampling_jitter", params={"rms_s": 2e-4})
    calm, shaky = (measure(stage_of(*effects), u, linked=True)[0][:, 0] for effects in ((), (jitter,)))
    speed = np.gradient(calm, TICK_S)
    fast = abs(speed) > np.quantile(abs(speed), 0.9)
    noise = shaky - calm
    assert noise[fast].std() == pytest.approx(2e-4 * np.sqrt(np.mean(speed[fast] ** 2)), rel=0.1)
    assert noise[abs(speed) < 5].std() < 0.05 * noise[fast].std() + 0.004


def test_a_coarse_converter_says_its_steps_only():
    coarse = AdoptedEffect(name="quantisation", params={"lsb_um": 0.5})
    x = measure(stage_of(coarse, noise=0.01), drive()[1])[0][:, 0]
    off = x - 0.5 * np.round(x / 0.5)
    assert abs(off).max() <= 280 / 65536
    assert len(np.unique(np.round(x / 0.5))) > 100


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ([AdoptedEffect(name="mains_hum")] * 2, "stands there 2 times"),
        ([AdoptedEffect(name="load_change", params={"mass": 0.1})], "there is none; add one"),
        ([AdoptedEffect(name="saturation", params={"top": 0.6})], "top must be .*below 0.5"),
        ([AdoptedEffect(name="slew_limit", params={"traverse_s": -1.0})], "at least 0"),
        ([AdoptedEffect(name="gain_change", params={"gain": [0.1, 0.2]})], "has 2 terms; the simulator takes one"),
        ([AdoptedEffect(name="hysteresis", params={"wide": 0.1})], "unknown parameter wide"),
        ([AdoptedEffect(name="hysteresis", params={"width": 0.1})] * 20, "more plays"),
        ([AdoptedEffect(name="delay", params={"delay_s": 20.0})], "up to 10 s"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(effects, words):
    with pytest.raises(BadInput, match=words) as refusal:
        plant_parameters(stage_of(*effects))
    assert "\n" not in str(refusal.value)


def test_every_effect_of_the_catalogue_can_be_simulated():
    assert [name for name, effect in catalogue().items() if effect.virtual is None] == []
