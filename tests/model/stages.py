"""Stages to try things on."""

from __future__ import annotations

from typing import Any, get_args

from hypothesis import strategies as st

from phaselead.model.axis import Actuator, AdoptedEffect, AdoptedStatus, AxisModel, Gains, Limits, Sensor, TimeView
from phaselead.model.effects import effect
from phaselead.model.stage_file import DataSource, Provenance, Stage
from phaselead.model.table import XU_LI_2010, TablePoint, TableView

number = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
words = st.text(max_size=20)
SHA = "0123456789abcdef" * 4


def example_stage() -> Stage:
    """One axis with everything in it."""
    points = tuple(
        TablePoint(swing_V=swing, f_Hz=f, gain_um_per_V=20.1, phase_deg=4.5, x0_um=-0.3, gain_std=0.01)
        for swing in (1.0, 5.0)
        for f in (1.0, 20.0)
    )
    time = TimeView(
        gain_um_per_V=14.284,
        play_r_V=(0.05, 0.15, 0.3, 0.5),
        play_w_um_per_V=(1.982, 0.453, 0.0, 2.305),
        deadzone_d_V=(1.0, 2.0),
        deadzone_s_um_per_V=(1.65, -0.249),
        u_range_V=(0.0, 10.0),
        rate_Hz=5000.0,
        delay_s=1.2e-4,
        rest_fraction=0.55,
    )
    covariance = tuple(tuple(1e-9 if i == j else -1e-12 for j in range(3)) for i in range(3))
    effect = AdoptedEffect(
        name="creep",
        params={"k": (0.004, 0.006), "tau_s": 0.1},
        ci95={"k": ((0.003, 0.005), (0.005, 0.007)), "tau_s": (0.09, 0.11)},
        share=0.3,
    )
    axis = AxisModel(
        table=TableView(**(XU_LI_2010.model_dump() | {"points": points, "a_cov": covariance})),
        time=time,
        gains=Gains(kp_V_per_um=0.017, ki_V_per_um_s=8.62, kd_V_s_per_um=2.33e-5),
        effects=(effect,),
    )
    return Stage(
        name="example",
        provenance=Provenance(parent_sha256=SHA, data=(DataSource(file="a.csv", sha256=SHA),), tool="test"),
        cross_coupling=((1.0, 0.02, 0.0), (0.04, 1.0, 0.01), (0.0, -0.03, 1.0)),
        axes={"x": axis},
    )


def _rising(values: list[float]) -> tuple[float, ...]:
    return tuple(sorted(set(values)))


@st.composite
def time_views(draw: st.DrawFn) -> TimeView:
    plays = _rising(draw(st.lists(st.floats(0, 1e3), max_size=5)))
    zones = _rising(draw(st.lists(number, max_size=4)))
    low, high = sorted(draw(st.lists(number, min_size=2, max_size=2, unique=True)))
    return TimeView(
        gain_um_per_V=draw(number),
        play_r_V=plays,
        play_w_um_per_V=draw(st.lists(st.floats(0, 1e3), min_size=len(plays), max_size=len(plays))),
        deadzone_d_V=zones,
        deadzone_s_um_per_V=draw(st.lists(number, min_size=len(zones), max_size=len(zones))),
        offset_um=draw(number),
        delay_s=draw(st.floats(0, 10)),
        rest_fraction=draw(st.floats(-1, 1)),
        u_range_V=(low, high),
        rate_Hz=draw(positive),
        residual_um_rms=draw(st.floats(0, 1e3)),
    )


@st.composite
def table_views(draw: st.DrawFn, device: bool = False) -> TableView:
    """Monotone tables. ``device``: such as the device can hold."""
    swing_low = draw(st.floats(0.1, 5))
    swing_high = swing_low + draw(st.floats(0.5, 5))
    f_low = draw(st.floats(0.1, 5))
    a0 = draw(st.floats(5, 100))
    small = st.floats(-1.0, 1.0)
    c = st.floats(-1e3, 1e3) if device else number
    return TableView(
        swing_V=(swing_low, swing_high),
        f_Hz=(f_low, f_low + draw(st.floats(0.5, 100))),
        a_um_per_V=(a0, a0 * draw(st.floats(-0.02, 0.1)), a0 * draw(st.floats(-0.001, 0.01))),
        b_deg=tuple(scale * draw(small) for scale in (20.0, 1.0, 0.1, 0.01, 0.1, 0.001)),
        c_um=draw(st.tuples(c, c, c, c, c, c)),
        points=tuple(
            TablePoint(swing_V=draw(positive), f_Hz=1.0, gain_um_per_V=draw(number), phase_deg=0.1, x0_um=-1e-300)
            for _ in range(draw(st.integers(0, 2)))
        ),
    )


@st.composite
def effects(draw: st.DrawFn) -> AdoptedEffect:
    name = draw(st.sampled_from(["creep", "resonance", "mains_hum"]))
    of_name = {p.name: st.floats(p.low, p.high) for p in effect(name).parameters}
    params: dict[str, Any] = {
        key: draw(value | st.lists(value, min_size=1, max_size=3).map(tuple))
        for key, value in of_name.items()
        if draw(st.booleans())
    }
    ci95 = {
        name: tuple((v - 1, v + 1) for v in value) if isinstance(value, tuple) else (value - 1, value)
        for name, value in params.items()
        if draw(st.booleans())
    }
    status = draw(st.sampled_from(get_args(AdoptedStatus)))
    return AdoptedEffect(name=name, status=status, params=params, ci95=ci95, share=draw(st.none() | st.floats(0, 1)))


@st.composite
def stages(draw: st.DrawFn) -> Stage:
    """Any stage the models allow, near enough."""
    axes = {}
    for name in draw(st.sampled_from(["x", "z", "xyz"])):
        u_min, park, u_max = sorted(draw(st.lists(number, min_size=3, max_size=3, unique=True)))
        axes[name] = AxisModel(
            limits=Limits(u_min_V=u_min, u_max_V=u_max, u_park_V=park, slew_V_per_s=1e6, ramp_V_per_s=draw(positive)),
            sensor=Sensor(x_min_um=u_min, x_max_um=u_max, bits=draw(st.integers(1, 32))),
            actuator=Actuator(u_min_V=u_min, u_max_V=u_max),
            gains=draw(st.none() | st.just(Gains(kp_V_per_um=draw(number), ki_V_per_um_s=0.0, kd_V_s_per_um=0.1))),
            table=draw(st.none() | table_views()),
            time=draw(st.none() | time_views()),
            effects=tuple(draw(st.lists(effects(), max_size=2))),
        )
    return Stage(
        name=draw(words),
        provenance=Provenance(
            tool=draw(words),
            data=tuple(DataSource(file=draw(words), sha256=SHA) for _ in range(draw(st.integers(0, 2)))),
        ),
        axes=axes,
    )


def assert_one_line(refusal: Exception) -> None:
    """What a user gets to see: one line of bearable length."""
    assert str(refusal).isprintable()
    assert 10 < len(str(refusal)) < 700
