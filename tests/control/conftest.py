import pytest
from hypothesis import settings
from one_mode_model import VIEW

from phaselead.model import AdoptedEffect, AxisModel, Stage

settings.register_profile("control", deadline=None)
settings.load_profile("control")


@pytest.fixture(scope="module")
def unlike_model():
    """A stage of 10 % less gain than the model has, whose mode is 5 % lower."""
    view = VIEW.model_copy(update={"gain_um_per_V": 13.5, "play_w_um_per_V": (2.7, 2.7), "delay_s": 0.0001})
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 190.0, "zeta": 0.02})
    lag = AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 2000.0})
    return Stage(name="stage", axes={"x": AxisModel(time=view, effects=(mode, lag))})
