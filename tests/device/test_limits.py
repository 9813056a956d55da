"""Hard limits in units: rounded inwards, read back as set, refused where they make no sense."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.control import connect
from phaselead.device.limits import UNLIMITED, AxisLimits, in_codes, in_units
from phaselead.device.quantities import Converters
from phaselead.errors import BadInput, DeviceRefused
from phaselead.sim.plant import built_in

CONVERTER = Converters()
FIELDS = {
    "u_min_V": st.floats(-10, 0),
    "u_max_V": st.floats(0, 10),
    "slew_V_per_s": st.floats(0.001, 1e5),
    "x_min_um": st.floats(0, 100),
    "x_max_um": st.floats(101, 260),
}


@given(limits=st.builds(AxisLimits, **{name: st.none() | values for name, values in FIELDS.items()}))
def test_codes_are_within_the_limits_by_less_than_one(limits):
    kept = in_units(in_codes(limits, CONVERTER), CONVERTER)
    steps = {"u_min_V": 1 / 3200, "u_max_V": 1 / 3200, "slew_V_per_s": 5000 / 3200 / 2**16}
    for name, asked in asdict(limits).items():
        got = getattr(kept, name)
        if asked is None:
            assert got is None, name
            continue
        inwards = got - asked if "min" in name else asked - got
        assert -1e-5 <= inwards <= steps.get(name, 280 / 65536) + 1e-9, name


def test_nothing_asked_is_nothing_limited():
    assert in_codes(AxisLimits(), CONVERTER) == UNLIMITED
    assert in_units(UNLIMITED, CONVERTER) == AxisLimits()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (AxisLimits(u_max_V=12), "beyond the converter's range"),
        (AxisLimits(u_min_V=-11), "beyond the converter's range"),
        (AxisLimits(u_min_V=1), "leave out 0 V"),
        (AxisLimits(u_max_V=-1), "leave out 0 V"),
        (AxisLimits(slew_V_per_s=0), "must be above 0"),
        (AxisLimits(slew_V_per_s=-5), "must be above 0"),
        (AxisLimits(x_min_um=90, x_max_um=80), "not below x_max"),
        (AxisLimits(x_max_um=300), "beyond the converter's range"),
        (AxisLimits(u_max_V=float("nan")), "no number"),
        (AxisLimits(slew_V_per_s=float("inf")), "no number"),
    ],
)
def test_limits_that_make_no_sense(limits, words):
    with pytest.raises(BadInput, match=words):
        in_codes(limits, CONVERTER)


def test_what_is_left_out_stays_and_other_axes_too(tmp_path):
    url = f"sim://xyz250?state={tmp_path / 'flash.bin'}"
    with connect(url) as device:
        device.set_limits("x", u_max_V=8, slew_V_per_s=500)
        device.set_limits("y", x_max_um=100)
    with connect(url) as device:
        device.set_limits("x", u_max_V=9)
        limits = device.limits()
        assert (limits["x"].u_max_V, limits["x"].slew_V_per_s, limits["x"].u_min_V) == (9, 500, None)
        assert limits["y"].x_max_um == pytest.approx(100, abs=0.005)
        assert not device.set_limits("x", remove=True)["x"]
        assert device.limits()["y"].x_max_um is not None
    assert "none" in str(limits)
    assert list(limits.columns["axis"]) == ["x", "y", "z"]


def test_an_upload_says_what_is_held_back():
    with connect("sim://xyz250") as device:
        device.set_limits("x", u_max_V=8, slew_V_per_s=500)
        with pytest.warns(UserWarning, match="axis x: u_max_V 10 is held to 8 V, slew_V_per_s 1000 is held to 500 V/s"):
            device.upload(built_in("xyz250"))


def test_none_are_set_while_armed_or_without_a_limit():
    with connect("sim://xyz250") as device:
        with pytest.raises(BadInput, match="changes nothing"):
            device.set_limits("x")
        with pytest.raises(BadInput, match="name each of x, y, z"):
            device.set_limits("w", u_max_V=8)
        device.arm()
        with pytest.raises(DeviceRefused, match="wrong_state"):
            device.set_limits("x", u_max_V=8)


def test_a_fault_log_reads_as_a_table(tmp_path):
    url = f"sim://xyz250?state={tmp_path / 'flash.bin'}"
    with connect(url) as device, pytest.raises(DeviceRefused, match="oscillation"):
        device.track("sine:60um@5Hz", mode="pid", gains=(0.1, 8.62, 0), force=True)
    with connect(url) as device:
        log = device.fault_log()
    assert [(fault.fault, fault.axis, fault.state, fault.power_cycle) for fault in log] == [
        ("oscillation", "x", "running", 1)
    ]
    assert (len(log), log.power_cycle) == (1, 2)
    assert "oscillation" in str(log)
    assert log.columns["fault"] == ["oscillation"]
