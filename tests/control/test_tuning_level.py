"""The level of the multisine that a response is measured with."""

import re

import pytest

from phaselead.control.tuning.course import FAST, tune
from phaselead.control.tuning.excitation import multisine
from phaselead.device import Device
from phaselead.errors import BadInput
from phaselead.sim import built_in


def test_a_level_that_the_slew_limit_forbids_is_refused_with_one_that_works():
    """It told to stay below a frequency or to lower the swing, of which tune has neither."""
    stage = built_in("xyz250")
    with Device.open("sim://xyz250") as device:
        with pytest.raises(BadInput, match=r"x: a level of 0.6 V needs .* V/s") as caught:
            tune(device, "x", stage=stage, level_V=0.6)
        assert device.status().state == "parked"
    named_V = float(re.search(r"a --level of up to (\d+) mV", str(caught.value))[1]) / 1e3
    slew_V_per_s = stage.axes["x"].limits.slew_V_per_s
    assert 0.95 < max(multisine(FAST.grid, named_V, 0, "V", n).steepest() for n in (0, 1)) / slew_V_per_s <= 1
