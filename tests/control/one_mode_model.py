"""A model with two plays, one mode and a sensor whose lag is known."""

from phaselead.model.axis import AdoptedEffect, AxisModel, Sensor, TimeView
from phaselead.model.stage_file import Stage

VIEW = TimeView(
    gain_um_per_V=15.0, play_r_V=(0.2, 1.0), play_w_um_per_V=(3.0, 3.0), delay_s=0.0003, u_range_V=(-2.0, 10.0),
    rate_Hz=5000.0,
)  # fmt: skip
AXIS = AxisModel(
    time=VIEW,
    sensor=Sensor(bandwidth_Hz=2000.0),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02}),),
)
STAGE = Stage(name="model", axes={"x": AXIS})
