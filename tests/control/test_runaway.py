"""A loop that runs away on the real thing: the compiled firmware against a stage with a second mode."""

import pytest

import phaselead as pl
from phaselead.control import run_away
from phaselead.device import device_model
from phaselead.model import AxisModel, Sensor, Stage
from phaselead.sim.plant import built_in

SECOND_MODE = {450: (0.017, 8.62, 4e-5), 700: (0.005, 10, 0), 900: (0.01, 8, 1e-4)}
"""Its frequency in Hz, and gains whose loop is unstable there."""


SENSOR = Sensor(x_min_um=-60.0, x_max_um=270.0)
"""With room below: at 10 um from the rail, where the built-in stage rests, one seed in twenty rings into it."""


def run(url, wave, gains, stage=None, duration=None):
    with pl.connect(url) as device:
        if stage is not None:
            device.device.upload(device_model(stage))
        return device.track(wave, mode="pid", gains=gains, force=True, duration=duration)


def two_modes(tmp_path, f_Hz):
    stage = built_in("xyz250")
    x = stage.axes["x"]
    mode = next(effect for effect in x.effects if effect.name == "resonance")
    second = mode.model_copy(update={"params": {"f_Hz": float(f_Hz), "zeta": 0.02}})
    axes = stage.axes | {"x": x.model_copy(update={"effects": (*x.effects, second), "sensor": SENSOR})}
    stage.model_copy(update={"axes": axes}).save(tmp_path / "two.toml", overwrite=True)
    return f"sim://{tmp_path / 'two.toml'}"


@pytest.mark.parametrize("f_Hz", SECOND_MODE)
@pytest.mark.parametrize("wave", ["sine:60um@5Hz", "sine:20um@5Hz"])
def test_a_second_mode_that_runs_away_is_found_before_the_sensor_is_at_its_rail(tmp_path, f_Hz, wave):
    """It once ended in adc_rail, with the stage thrown through its whole range."""
    with pytest.raises(pl.DeviceFault, match="fault oscillation on axis x") as caught:
        run(two_modes(tmp_path, f_Hz), wave, SECOND_MODE[f_Hz], Stage(name="x", axes={"x": AxisModel(sensor=SENSOR)}))
    capture = caught.value.capture
    assert (capture.axes["x"].adc[capture.ticks <= capture.status.fault_tick] > 64).all()


def test_an_oscillation_that_the_recording_does_not_show_is_told_of_too(tmp_path, monkeypatch):
    """It came while the path was entered: what was recorded of the path was quiet, and nothing was said."""
    monkeypatch.setattr(run_away, "run_away", lambda *_, **__: None)
    with pytest.raises(pl.DeviceFault, match="the loop of x is unstable; lower the gains"):
        run(
            two_modes(tmp_path, 450),
            "sine:60um@5Hz",
            SECOND_MODE[450],
            Stage(name="x", axes={"x": AxisModel(sensor=SENSOR)}),
        )


def test_a_limit_cycle_is_found_although_it_grew_slowly(tmp_path):
    """The slew limit held it at 30 um from one end to the other, for as long as the path went on."""
    gains = tuple(0.34 * gain for gain in SECOND_MODE[450])
    stage = Stage(name="x", axes={"x": AxisModel(sensor=SENSOR)})
    url = two_modes(tmp_path, 450)
    with pytest.raises(pl.DeviceFault, match="fault oscillation on axis x"):
        run(url, "sine:20um@5Hz", gains, stage, duration=2)


@pytest.mark.parametrize(
    "wave", ["goto:100um", "triangle:100um@20Hz", "triangle:60um@5Hz", "sine:20um@80Hz", "sine:60um@20Hz"]
)
@pytest.mark.parametrize("gains", ["paper", (0, 28.67, 2.342e-5)])
def test_a_stable_loop_is_left_alone(wave, gains):
    assert len(run("sim://xyz250", wave, gains).recording.t_s) > 0
