"""The loop of a learned path: it takes out drift, has the margin of a designed loop, and passes on less noise."""

import numpy as np
import pytest
from one_mode_model import AXIS, STAGE

from phaselead.control.feedback_loop import frequencies, local_gains, open_loop, peak_sensitivity, plant_response
from phaselead.control.gains import MODE_SHIFT, PEAK_SENSITIVITY, design_gains
from phaselead.control.learning.drift_loop import CORNERS, drift_loop
from phaselead.control.learning.learned import Learned
from phaselead.control.learning.look import Look
from phaselead.control.learning.quieter import LEFT_OF_DRIFT, quieter
from phaselead.control.learning.trials import learn
from phaselead.device.device import Device
from phaselead.model import LoopFilter, small_signal
from phaselead.model.axis import AdoptedEffect, Gains, Sensor
from phaselead.model.stage_file import Stage
from phaselead.waveforms.catalogue import parse_wave

GAINS = {"x": design_gains("x", AXIS)}
PLANT = small_signal(AXIS)


def shaken_um(gains: Gains) -> float:
    """By the sensor's noise and the output's steps, um rms, at the middle local gain."""
    f_Hz = frequencies(PLANT)
    loop = open_loop(PLANT, gains, f_Hz)[1]
    step_um = 20.48 / 65536 / np.sqrt(12) * local_gains(PLANT)[1] * np.abs(plant_response(PLANT, f_Hz))
    density = (step_um**2 + np.abs(0.01 * loop) ** 2) / np.abs(1 + loop) ** 2
    return float(np.sqrt(np.trapezoid(density, f_Hz) / f_Hz[-1]))


@pytest.mark.parametrize("seen_s", [0.5, 1.0, 5.0])
def test_it_leaves_as_much_of_drift_as_trials_cannot_tell(seen_s):
    own = drift_loop(AXIS, GAINS["x"], seen_s)
    slow = np.abs(1 / (1 + open_loop(PLANT, own, np.array([1 / seen_s]))))
    assert slow.max() == pytest.approx(LEFT_OF_DRIFT, rel=0.1)
    assert (own.kp_V_per_um, own.kd_V_s_per_um) == (0.0, 0.0)


@pytest.mark.parametrize("seen_s", [0.35, 1.0])
@pytest.mark.parametrize("factor", [1 - MODE_SHIFT, 1.0, 1 + MODE_SHIFT])
def test_it_has_the_margin_that_gains_are_designed_for(factor, seen_s):
    moved = PLANT.with_modes_at(factor)
    own = drift_loop(AXIS, GAINS["x"], seen_s)
    assert peak_sensitivity(open_loop(moved, own, frequencies(moved))) <= PEAK_SENSITIVITY


def test_it_shakes_less_than_the_same_gains_scaled_down():
    """And less than the output's steps do without any feedback: behind its low-pass the integrator damps the mode."""
    own = drift_loop(AXIS, GAINS["x"], 1.0)
    assert shaken_um(own) < shaken_um(quieter(AXIS, GAINS["x"], 1.0, None))
    none = own.model_copy(update={"ki_V_per_um_s": 1e-9})
    assert shaken_um(own) < shaken_um(none)


def test_another_low_pass_would_shake_more():
    own = drift_loop(AXIS, GAINS["x"], 1.0)
    (best,) = own.filters
    others = [share * 200.0 for share in CORNERS if abs(np.log(share * 200.0 / best.poles_Hz)) > 0.3]
    for corner_Hz in others:
        other = own.model_copy(update={"filters": (best.model_copy(update={"poles_Hz": corner_Hz}),)})
        if peak_sensitivity(open_loop(PLANT, other, frequencies(PLANT))) <= PEAK_SENSITIVITY:
            assert shaken_um(other) > shaken_um(own)


@pytest.mark.parametrize(
    ("model", "gains"),
    [
        (AXIS, Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)),  # no more of it than drift takes
        (AXIS.model_copy(update={"effects": ()}), GAINS["x"]),  # no mode to stay below
        (
            AXIS.model_copy(
                update={"effects": (AdoptedEffect(name="resonance", params={"f_Hz": 20.0, "zeta": 0.001}),)}
            ),
            GAINS["x"],
        ),  # one too near to drift
    ],
)
def test_there_is_none_where_it_would_not_help(model, gains):
    assert drift_loop(model, gains, 1.0) is None


def test_there_is_none_without_a_margin():
    """Of shorter trials, which leave it more of drift: its integrator would be as quick as the mode bears."""
    assert drift_loop(AXIS, GAINS["x"], 0.25) is None


@pytest.fixture(scope="module")
def stage():
    """Of the model, its sensor twice as noisy as usual, so that what is left is clearly noise."""
    noisy = AXIS.model_copy(
        update={
            "sensor": Sensor(noise_um_rms=0.02, bandwidth_Hz=2000.0),
            "time": AXIS.time.model_copy(update={"gain_um_per_V": 13.5, "delay_s": 0.0001}),
            "effects": (*AXIS.effects, AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 2000.0})),
        }
    )
    return Stage(name="stage", axes={"x": noisy})


def learned(stage, folder, **options) -> Learned:
    stage.save(folder / "stage.toml", overwrite=True)
    with Device.open(f"sim://{folder / 'stage.toml'}?seed=31") as device:
        wave = {"x": parse_wave("sine:30um@50Hz")}
        return learn(device, wave, stage=STAGE, gains=GAINS, trials=10, turn_down=True, **options)


def test_a_path_is_held_by_it_once_noise_is_most_of_what_is_left(stage, tmp_path):
    found = learned(stage, tmp_path)
    own = found.gains()["x"]
    assert own == drift_loop(AXIS, GAINS["x"], 1.0)
    assert isinstance(own.filters[0], LoopFilter)
    assert "% of its integral gain alone: what repeats is learned" in found.reason
    assert found.best.judged_pct < found.trials[0].judged_pct / 5


def test_it_is_given_up_where_it_leaves_more_noise(monkeypatch, stage, tmp_path):
    monkeypatch.setattr(Look, "rests_less_than", lambda self, other: False)
    found = learned(stage, tmp_path)
    assert found.gains()["x"].ki_V_per_um_s == 0.25 * GAINS["x"].ki_V_per_um_s
    assert "; x keeps 25 % of its gains" in found.reason


def test_gains_that_are_only_halved_are_kept_where_they_leave_less(monkeypatch, stage, tmp_path):
    """Slow feedback does not dither the output's steps, and a path that repeats exactly makes a pattern of them."""
    monkeypatch.setattr(Look, "rests_less_than", lambda self, other: self.gains["x"].filters is None)
    own = learned(stage, tmp_path).gains()["x"]
    assert own.filters is None
    assert own.ki_V_per_um_s == quieter(AXIS, GAINS["x"], 1.0, None).ki_V_per_um_s
