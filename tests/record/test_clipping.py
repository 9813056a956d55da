"""Clipped positions are found, and turning points of coarse sensors are not mistaken for them."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.record import AxisRecord, read_recording
from phaselead.record.checks import clipped_run, refuse_clipped, refuse_gapped

from recordings import sine_recording  # isort: skip


def play(u: np.ndarray, r: float) -> np.ndarray:
    state, out = 0.0, []
    for value in u.tolist():
        state = min(max(state, value - r), value + r)
        out.append(state)
    return np.array(out)


def stage(u: np.ndarray, backlash: float = 1.0, delay: int = 0) -> np.ndarray:
    """Gain and three plays: flat turning points after which x lags u."""
    x = 14 * u + 3 * play(u, 0.3) + 2 * play(u, 1.0) + 2 * play(u, backlash)
    return np.concatenate([np.full(delay, x[0]), x[: len(x) - delay]])


def drive(kind: str, f_Hz: float, n: int = 4000, rate_Hz: float = 5000.0) -> np.ndarray:
    turns = np.arange(n) / rate_Hz * f_Hz
    share = {
        "sine": (1 - np.cos(2 * np.pi * turns)) / 2,
        "triangle": 1 - np.abs(2 * (turns % 1) - 1),
        "trapezoid": np.clip(2 - np.abs(4 * (turns % 1) - 2), 0, 1),
        "square": (turns % 1 < 0.5).astype(float),
    }
    return 5 * share[kind]


kinds = st.sampled_from(["sine", "triangle", "trapezoid", "square"])


@settings(max_examples=80, deadline=None)
@given(
    kind=kinds,
    f_Hz=st.sampled_from([0.3, 1.0, 5.0, 20.0, 100.0]),
    lsb_um=st.sampled_from([1e-9, 0.00427, 0.00763, 0.1, 1.0, 5.0]),
    noise_um=st.sampled_from([0.0, 0.01, 0.05]),
    backlash=st.sampled_from([0.5, 2.0]),
    delay=st.integers(0, 3),
    sign=st.sampled_from([1, -1]),
)
def test_no_unclipped_record_is_called_clipped(
    kind: str, f_Hz: float, lsb_um: float, noise_um: float, backlash: float, delay: int, sign: int
) -> None:
    u = drive(kind, f_Hz)
    x = stage(u, backlash, delay) + noise_um * np.random.default_rng(1).standard_normal(len(u))
    quantised = np.round(x / lsb_um) * lsb_um
    assert clipped_run(AxisRecord(sign * u, quantised)) is None


def test_a_position_that_leads_is_not_clipped() -> None:
    """Charge leakage: at the top of x the voltage is still on its way up."""
    turns = np.arange(4000) / 5000 * 5
    u, x = 1 - np.cos(2 * np.pi * turns), 50 - 50 * np.cos(2 * np.pi * turns + 0.5)
    for lsb_um in (1e-9, 0.00763, 0.1, 1.0):
        assert clipped_run(AxisRecord(u, np.round(x / lsb_um) * lsb_um)) is None


def test_a_loop_that_holds_against_creep_is_not_clipped() -> None:
    """The voltage goes on rising so that the position can stand still."""
    r = np.concatenate([np.linspace(0, 100, 500), np.full(1500, 100.0)])
    u = r / 20 + np.concatenate([np.zeros(500), np.linspace(0, 0.2, 1500)])
    assert clipped_run(AxisRecord(u, r, r_um=r)) is None
    assert clipped_run(AxisRecord(u, r)) is not None


def test_pure_backlash_is_not_clipping() -> None:
    for kind in ("sine", "triangle"):
        u = drive(kind, 5)
        assert clipped_run(AxisRecord(u, 20 * play(u, 1.0))) is None


@settings(max_examples=80, deadline=None)
@given(
    kind=st.sampled_from(["sine", "triangle"]),
    f_Hz=st.sampled_from([1.0, 5.0, 20.0]),
    lsb_um=st.sampled_from([1e-9, 0.00427, 0.1]),
    depth=st.floats(0.03, 0.4),
    top=st.booleans(),
    sign=st.sampled_from([1, -1]),
)
def test_clipping_is_found(kind: str, f_Hz: float, lsb_um: float, depth: float, top: bool, sign: int) -> None:
    u = drive(kind, f_Hz, n=6000)[560:]  # from the middle of a cycle
    x = stage(u)
    rail = x.max() - depth * np.ptp(x) if top else x.min() + depth * np.ptp(x)
    clipped = np.round((np.minimum if top else np.maximum)(x, rail) / lsb_um) * lsb_um
    run = clipped_run(AxisRecord(sign * u, clipped))
    assert run is not None
    assert run.stop - run.start >= 3
    assert len(set(clipped[run])) == 1


@pytest.mark.parametrize("at", [150, 230, 320, 430])
def test_three_samples_thrown_to_a_rail_are_found(at: int) -> None:
    recording = sine_recording()
    x = recording.axes["x"].x_um.copy()
    x[at : at + 3] = 270.0
    assert clipped_run(replace(recording.axes["x"], x_um=x)) == slice(at, at + 3)


def test_known_rails_need_no_guess() -> None:
    recording = sine_recording()
    x = np.clip(recording.axes["x"].x_um, -10, 115.0)  # a whisker below the peak
    assert clipped_run(AxisRecord(None, x), (-10.0, 115.0)) is not None
    assert clipped_run(AxisRecord(None, x), (-10.0, 270.0)) is None
    x[: len(x) - 2] = np.minimum(x[: len(x) - 2], 100)
    assert clipped_run(AxisRecord(None, x), (-10.0, 115.0)) is None  # two samples are not three
    with pytest.raises(BadInput, match=r"axis x is clipped at 115 um .* less swing"):
        refuse_clipped(
            replace(
                sine_recording(),
                axes={"x": AxisRecord(None, np.full(500, 115.0))},
                meta={"rails_um": {"x": [-10, 115]}},
            )
        )


def test_refusals_name_the_record_and_what_to_do() -> None:
    good = replace(sine_recording(), source="a.csv")
    refuse_clipped(good)
    refuse_gapped(good)
    axis = good.axes["x"]
    clipped = replace(good, axes={"x": replace(axis, x_um=np.minimum(axis.x_um, 100))})
    with pytest.raises(BadInput, match=r"a\.csv: .*axis x is clipped at 100 um .*less swing"):
        refuse_clipped(clipped)
    with pytest.raises(BadInput, match=r"a\.csv: has gaps in 2 places.*again"):
        refuse_gapped(replace(good, meta={"gaps": [[5, 1], [9, 3]]}))


DATA = Path(os.environ.get("PHASELEAD_DATA", "/nowhere"))


@pytest.mark.skipif(not (DATA / "dbo").is_dir(), reason="PHASELEAD_DATA does not hold the measured records")
def test_measured_records_are_not_clipped_until_they_are() -> None:
    stage150 = read_recording(
        f"{DATA}/stage150/hysteresis_v_150_1hz.csv", columns={"t_s": (2, 1.0), "x_um": (3, 1.0), "u_V": (4, 1.0)}
    )
    dbo = read_recording(DATA / "dbo/Model_Vi_Do.dat", columns={"u_V": (1, 1.0), "x_um": (5, 1.0)}, rate_Hz=200.0)
    for recording in (stage150, dbo):
        refuse_clipped(recording)
        x = recording.axes["x"].x_um
        cut = replace(recording.axes["x"], x_um=np.minimum(x, x.min() + 0.97 * np.ptp(x)))
        with pytest.raises(BadInput, match="clipped"):
            refuse_clipped(replace(recording, axes={"x": cut}))
