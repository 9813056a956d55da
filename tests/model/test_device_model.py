# ruff: noqa: E501 - a table of refusals reads best with one on a line
"""The model blob: exact to its formats, refused beyond them."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.encode_model import (
    device_model,
    from_device_model,
    inverse_refusal,
    quantisation,
    refused_key,
)
from phaselead.errors import BadInput
from phaselead.model.axis import Actuator, AdoptedEffect, AxisModel, Limits, Sensor, TimeView
from phaselead.model.stage_file import Stage
from phaselead.model.table import XU_LI_2010, TableView

from stages import example_stage, table_views  # isort: skip


def stage_of(**parts: Any) -> Stage:
    return Stage(name="s", axes={"y": AxisModel(**parts)})


def table(**changes: Any) -> TableView:
    return TableView(**(XU_LI_2010.model_dump() | changes))


def test_the_integers_of_table_i() -> None:
    model = wire.Model.unpack(device_model(stage_of(table=XU_LI_2010)))
    x, y, _ = model.axes
    assert model.stage_hash.hex() == stage_of(table=XU_LI_2010).sha256
    assert (x.flags & 0xFFFFFF, y.flags & 0xFFFFFF) == (0, 1)
    assert (y.u_min_q24, y.u_max_q24, y.u_park_q24) == (-(2 << 24), 10 << 24, 0)
    assert (y.slew_q24, y.ramp_q24) == (3355443, 167772)
    assert (y.dac_zero_code, y.dac_codes_per_V_q16) == (32768, 3200 << 16)
    assert (y.adc_zero_code, y.flags >> 24, y.adc_um_per_code_q32) == (2340, 146, 280 << 16)  # 2340.57
    assert (y.swing_min_q24, y.swing_max_q24, y.f_min_q16, y.f_max_q16) == (1 << 23, 10 << 24, 1 << 16, 20 << 16)
    assert y.a_q32[0] == round(15.2536 * 2**32)
    assert y.b_q40[0] == round(1.9238 / 360 * 2**40)
    assert y.c_q32[0] == round(-1.7893 * 2**32)
    assert x == wire.Model.unpack(device_model(stage_of())).axes[0]


def test_an_axis_without_a_table_gets_the_defaults() -> None:
    """The same a device without a model works with (firmware/app/device.c)."""
    x = wire.Model.unpack(device_model(stage_of())).axes[0]
    assert (x.flags, x.slew_q24, x.ramp_q24, x.dac_zero_code) == (146 << 24, 3355443, 167772, 32768)
    assert 256 * x.adc_zero_code + 146 == 599186
    assert x.a_q32 == (0, 0, 0)


STEPS = {
    "limits": 2.0**-24 * 5000,
    "actuator": 1e-6,
    "table.swing_V": 2.0**-24,
    "table.f_Hz": 2.0**-16,
    "table.a_um_per_V": 2.0**-32,
    "table.b_deg": 360 * 2.0**-40,
    "table.c_um": 2.0**-32,
}


@settings(max_examples=60, deadline=None)
@given(view=table_views(device=True), u_max=st.floats(1, 10), slew=st.floats(1, 1e4))
def test_everything_comes_back_within_half_a_step(view: TableView, u_max: float, slew: float) -> None:
    stage = stage_of(table=view, limits=Limits(u_max_V=u_max, slew_V_per_s=slew, ramp_V_per_s=slew / 2))
    shown = {item.key for item in quantisation(stage)}
    assert len(shown) == 6 + 2 + 2 + 2 + 2 + 3 + 6 + 6 + 1
    for item in quantisation(stage):
        key = item.key.removeprefix("axes.y.")
        step = next((step for part, step in STEPS.items() if key.startswith(part)), None)
        if step is not None:
            assert abs(item.held - item.value) <= step / 2 * (1 + 1e-9), item
        else:  # the zero code of the sensor is held in 256ths
            assert abs(item.held - item.value) <= 280 / 65536 / 256 / 2 + 1e-9, item


@settings(max_examples=30, deadline=None)
@given(view=table_views(device=True))
def test_what_the_device_holds_it_holds_exactly(view: TableView) -> None:
    """Encoding what came back changes nothing."""
    blob = device_model(stage_of(table=view))
    held = from_device_model(blob)
    again = device_model(Stage(name="s", axes=held.axes))
    assert wire.Model.unpack(again).axes == wire.Model.unpack(blob).axes
    assert held.stage_sha256 == stage_of(table=view).sha256


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ({"limits": Limits(u_min_V=-150, u_max_V=150)}, "axes.y.limits.u_min_V = -150 is 140 V beyond the converter"),
        ({"limits": Limits(u_max_V=10.24)}, "axes.y.limits.u_max_V = 10.24 is 0.000312 V beyond"),
        ({"limits": Limits(slew_V_per_s=1e7)}, "slew_V_per_s = 1e+07 does not fit the device: it holds at most 640000, this is 15.6 times"),
        ({"limits": Limits(ramp_V_per_s=1e-9)}, "ramp_V_per_s = 1e-09 does not fit the device: the smallest step"),
        ({"actuator": Actuator(u_min_V=-200, u_max_V=200), "limits": Limits(u_min_V=-150, u_max_V=150)}, "axes.y.limits.u_min_V = -150 does not fit the device: it holds at most 128"),
        ({"limits": Limits(u_min_V=1, u_max_V=2, u_park_V=1)}, "axes.y.limits: u_min_V..u_max_V = 1..2 leaves out 0 V, where the device powers on"),
        ({"actuator": Actuator(bits=18)}, "axes.y.actuator.bits = 18: the device's converters have 16 bits"),
        ({"sensor": Sensor(bits=12)}, "axes.y.sensor.bits = 12"),
        ({"sensor": Sensor(x_max_um=40000)}, "axes.y.sensor.x_max_um = 40000 does not fit the device: it holds at most 32768"),
        ({"sensor": Sensor(x_min_um=1000, x_max_um=1010)}, "axes.y.sensor: its span 1000..1010 um is too far from 0 um"),
        ({"table": table(a_um_per_V=(0.0625, 0, 0))}, "divide the recorded ones by the amplifier's gain and fit again"),
        ({"table": table(a_um_per_V=(9000.0, 0, 0))}, "axes.y.table.a_um_per_V: the gain reaches 9000 um/V, the device holds 0.126..4096"),
        ({"table": table(a_um_per_V=(0.1, 0, 0))}, "the gain reaches 0.1 um/V"),
        ({"table": table(a_um_per_V=(4000.0, 0, 0))}, "the range reaches 4e+04 um"),
        ({"table": table(c_um=(0, 1e5, 0, 0, 0, 0))}, "axes.y.table.c_um[1] = 100000 does not fit the device: it holds at most 65536, this is 1.53 times"),
        ({"table": table(b_deg=(170.0, 1, 1, 0, 0, 0))}, "axes.y.table.b_deg: the phase reaches 200 degrees at 10 V, 20 Hz"),
        ({"table": table(b_deg=(0.0, 0, 0, 0, 0, 1e9))}, "the phase reaches 4e+11 degrees"),
        ({"table": table(f_Hz=(1, 3000), b_deg=(1.0, 0, 0, 0, 0, 0))}, "axes.y.table.f_Hz[1] = 3000 Hz is above half the tick rate"),
        ({"table": table(f_Hz=(1e-9, 20))}, "axes.y.table.f_Hz[0] = 1e-09 does not fit the device: the smallest step"),
        ({"table": table(swing_V=(1e-12, 5))}, "axes.y.table.swing_V[0] = 1e-12"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_and_measured(parts: dict[str, Any], told: str) -> None:
    with pytest.raises(BadInput) as refusal:
        device_model(stage_of(**parts))
    assert told in str(refusal.value)
    assert str(refusal.value).isprintable()


@pytest.mark.parametrize("blob", [b"", b"x" * 10, b"\0" * wire.Model.SIZE])
def test_other_blobs_are_refused(blob: bytes) -> None:
    with pytest.raises(BadInput, match=r"^model: "):
        from_device_model(blob)


@settings(max_examples=100, deadline=None)
@given(at=st.integers(0, wire.Model.SIZE - 1), data=st.binary(min_size=1, max_size=8))
def test_any_blob_is_read_or_refused(at: int, data: bytes) -> None:
    blob = device_model(example_stage())
    spoilt = (blob[:at] + data + blob[at + len(data) :])[: wire.Model.SIZE]
    try:
        from_device_model(spoilt)
    except BadInput as refusal:
        told = str(refusal)
        assert told.startswith("model: ")


def test_a_refused_field_has_a_key() -> None:
    assert refused_key(2) == "axes.x.limits.u_min_V"
    assert refused_key(115) == "axes.y.table.a_um_per_V"
    assert refused_key(217) == "axes.z.table.c_um"
    assert refused_key(118) == "axes.y.time.delay_s"
    assert refused_key(26) == "axes.x.time.play_r_V"
    assert refused_key(230) == "axes.z.effects"
    assert refused_key(0) == refused_key(999) == "model"


# ---------------------------------------------------------------- what the inverse modes need
VIEW = TimeView(
    gain_um_per_V=14.25, play_r_V=(0.1, 0.5), play_w_um_per_V=(2.0, 0.75), deadzone_d_V=(1.0, 3.0),
    deadzone_s_um_per_V=(1.5, -2.0), offset_um=-3.5, delay_s=0.0004, rest_fraction=0.5, u_range_V=(-2.0, 10.0),
    rate_Hz=5000.0,
)  # fmt: skip
CREEP = AdoptedEffect(name="creep", params={"k": [0.004, 0.006], "tau_s": [0.1, 10.0]})


def inverted(**parts: Any) -> wire.AxisModel:
    return wire.Model.unpack(device_model(stage_of(**({"time": VIEW} | parts)))).axes[1]


def test_the_integers_of_a_time_view() -> None:
    y = inverted(effects=(CREEP,))
    assert y.flags & 0xFFFFFF == 2
    assert y.preview_ticks_q16 == 2 << 16
    assert (y.gain_q20, y.offset_q16, y.rest_fraction_q30) == (57 << 18, -7 << 15, 1 << 29)
    assert y.play_r_q24[:3] == (round(0.1 * 2**24), 1 << 23, 2**31 - 1)
    assert y.play_w_q20[:3] == (2 << 20, 3 << 18, 0)
    assert y.knot_d_q24[:3] == (1 << 24, 3 << 24, 2**31 - 1)
    assert y.knot_s_q20[:3] == (3 << 19, -2 << 20, 0)
    assert y.creep_k_q30[:3] == (round(0.004 * 2**30), round(0.006 * 2**30), 0)
    assert y.creep_alpha_q48[1] == round((1 - 0.99998000019999867) * 2**48)
    assert y.shape == (wire.Biquad(1 << 26, 0, 0, 0, 0),) * 6
    assert y.coupling_q28 == (0, 1 << 28, 0)


@settings(max_examples=40, deadline=None)
@given(tau_s=st.floats(1e-5, 0.01), f_Hz=st.floats(30, 2000), zeta=st.floats(0.005, 0.5))
def test_every_section_is_stable_and_has_a_static_gain_of_one(tau_s: float, f_Hz: float, zeta: float) -> None:
    effects = (
        AdoptedEffect(name="sensor_lowpass", params={"tau_s": tau_s}),
        AdoptedEffect(name="amplifier_lowpass", params={"tau_s": tau_s}),
        AdoptedEffect(name="resonance", params={"f_Hz": f_Hz, "zeta": zeta}),
    )
    y = inverted(effects=effects)
    for section in (*y.shape, *y.drive):
        one = 1 << 26
        assert one + section.a1_q26 + section.a2_q26 == section.b0_q26 + section.b1_q26 + section.b2_q26
        assert section.a2_q26 < one
        assert abs(section.a1_q26) < one + section.a2_q26


def test_its_rounding_is_shown() -> None:
    shown = {item.key: item for item in quantisation(stage_of(time=VIEW, effects=(CREEP,)))}
    assert shown["axes.y.inverse.play_r_V[0]"].held == pytest.approx(0.1, abs=2**-25)
    assert shown["axes.y.inverse.creep_k[1]"].value == 0.006
    assert shown["axes.y.inverse.preview_s[0]"].held == pytest.approx(0.0004, abs=1e-9)


def test_a_time_view_without_an_inverse_leaves_the_other_modes() -> None:
    y = inverted(time=VIEW.model_copy(update={"gain_um_per_V": 0.25}), table=XU_LI_2010)
    assert y.flags & 0xFFFFFF == 1
    assert "it falls" not in str(inverse_refusal(AxisModel(time=VIEW)))
    assert "falls or stands still at 3 V" in str(
        inverse_refusal(AxisModel(time=VIEW.model_copy(update={"gain_um_per_V": 0.25})))
    )


@pytest.mark.parametrize(
    ("matrix", "told"),
    [
        (((1, 2.5, 0), (0, 1, 0), (0, 0, 1)), "x sees 2.5 of the motion of y; the device decouples less than 2"),
        (((1, 1, 0), (0.99, 1, 0), (0, 0, 1)), "x and y are coupled so strongly that the device cannot decouple them"),
    ],
)
def test_coupling_that_cannot_be_undone_is_refused(matrix: Any, told: str) -> None:
    stage = Stage(name="s", cross_coupling=matrix, axes={"y": AxisModel(time=VIEW)})
    with pytest.raises(BadInput) as refusal:
        device_model(stage)
    assert told in str(refusal.value)


def test_the_matrix_and_the_adopted_effects_add_up() -> None:
    own = AdoptedEffect(name="cross_coupling", params={"from_x": 0.25})
    stage = Stage(
        name="s",
        cross_coupling=((1, 0, 0), (0.125, 1, 0.5), (0, 0, 1)),
        axes={"y": AxisModel(time=VIEW, effects=(own,))},
    )
    axes = wire.Model.unpack(device_model(stage)).axes
    assert axes[1].coupling_q28 == (3 << 25, 1 << 28, 1 << 27)
    assert axes[0].coupling_q28 == (1 << 28, 0, 0)
