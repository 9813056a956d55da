"""What the recorder that is always on froze, as a recording."""

import numpy as np
import pytest

from phaselead.control import connect
from phaselead.device.capture import DeviceFault
from phaselead.errors import BadInput, DeviceRefused

URL = "sim://xyz250"


def test_a_fault_is_kept_without_a_stream_or_a_word():
    with connect(URL) as device:
        with pytest.raises(DeviceFault) as caught:
            device.track("sine:60um@5Hz", mode="pid", gains=(0.1, 8.62, 0), force=True)
        pulled, captured = device.pull(), caught.value.capture
    tick = captured.status.fault_tick
    assert (pulled.meta["trigger"], pulled.meta["trigger_tick"], pulled.meta["gaps"]) == ("fault", tick, [])
    assert (pulled.t_s[0], pulled.t_s[-1]) == (pytest.approx(-min(tick, 299) / 5000, abs=3e-3), 0.02)
    ticks = np.rint(pulled.t_s * 5000).astype(int) + tick
    _, there, here = np.intersect1d(captured.ticks, ticks, return_indices=True)
    assert len(there) > 150
    x_um = (captured.axes["x"].adc[there].astype(float) - 2341) * 280 / 65536
    assert np.allclose(pulled.axes["x"].x_um[here], x_um)
    assert np.allclose(pulled.axes["x"].r_um[here], captured.axes["x"].reference[there] / 2**16)
    assert pulled.axes["y"].r_um is None


def test_a_threshold_gives_what_was_before_and_after_it():
    with connect(URL) as device:
        facts = device.trigger("threshold", above_um=30, every=2, after=0.5)
        assert (facts["before_s"], facts["after_s"]) == (0.0796, 0.08)
        device.track("sine:60um@5Hz", mode="pid", duration=0.4)
        pulled = device.pull()
    at = int(np.searchsorted(pulled.t_s, -1e-9))
    assert (pulled.axes["x"].x_um[: at - 1] < 30.1).all()
    assert pulled.axes["x"].x_um[at] == pytest.approx(30, abs=0.5)
    assert np.allclose(np.diff(pulled.t_s), 0.0004)


def test_a_pull_empties_it_unless_it_is_kept():
    with connect(URL) as device:
        with pytest.raises(DeviceRefused, match="nothing is frozen: the recorder is waiting"):
            device.pull()
        device.trigger("set_point")
        device.track("sine:20um@5Hz", mode="pid", duration=0.4)
        kept, again = device.pull(keep=True), device.pull()
        assert np.array_equal(kept.t_s, again.t_s)
        with pytest.raises(DeviceRefused, match="nothing is frozen"):
            device.pull()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"on": "moon"}, "must be one of fault, set_point, threshold, input"),
        ({"on": "threshold"}, "either a level above or one below"),
        ({"on": "threshold", "above_um": 1, "below_um": 2}, "either a level above or one below"),
        ({"on": "fault", "above_um": 1}, "nothing else takes one"),
        ({"on": "threshold", "above_um": 500}, "beyond the sensor's range"),
        ({"every": 0}, "between 1 and 65535"),
        ({"after": 1.5}, "between 0 and 1"),
        ({"axis": "q"}, "must be x, y or z"),
    ],
)
def test_triggers_that_make_no_sense(how, words):
    with connect(URL) as device, pytest.raises(BadInput, match=words):
        device.trigger(**how)
