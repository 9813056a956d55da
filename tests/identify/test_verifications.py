"""A model judged on records: which are left out, and which do not seem to be of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from phaselead.api import fit, recording, verify
from phaselead.errors import BadInput
from phaselead.model import AdoptedEffect, AxisModel, Stage, TimeView, simulate
from phaselead.record import Recording
from phaselead.record.exporting import write_csv

RATE_HZ = 500.0
VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=RATE_HZ)
STAGE = Stage(name="line", axes={"x": AxisModel(time=VIEW)})
T_s = np.arange(500) / RATE_HZ
U_V = 2.5 - 2.5 * np.cos(2 * np.pi * 5 * T_s)


def record(gain: float = 1.0, volts: float = 1.0, source: str = "rec.csv") -> Recording:
    noise_um = np.random.default_rng(0).normal(0, 0.01, len(T_s))
    return recording(t_s=T_s, u_V=volts * U_V, x_um=gain * (20 * U_V + noise_um), source=source)


PARKED = recording(t_s=T_s, u_V=0 * T_s, x_um=np.random.default_rng(1).normal(0, 0.01, len(T_s)), source="park.csv")


def test_a_parked_record_is_left_out_and_said_to_be():
    found = verify(STAGE, [record(source="a.csv"), PARKED, record(source="b.csv")])
    assert [one.file for one in found] == ["a.csv", "b.csv"]
    assert found.left_out == found.as_dict()["left_out"] == [str(found.left_out[0])]
    assert "left out: park.csv: the voltage never moves" in str(found)
    assert "left_out" not in verify(STAGE, record()).as_dict()


def test_a_row_that_stands_alone_is_said_once():
    """Of however many records."""
    t_s, glitched = np.arange(2000) / RATE_HZ, []
    for seed, name in enumerate(("a.csv", "b.csv")):
        u_V = 2.5 - 2.5 * np.cos(2 * np.pi * 5 * t_s)
        x_um = 20 * u_V + np.random.default_rng(seed).normal(0, 0.01, len(t_s))
        x_um[700] += 30.0
        glitched.append(recording(t_s=t_s, u_V=u_V, x_um=x_um, source=name))
    (line,) = [line for line in verify(STAGE, glitched).doubts if "jumps away and back" in line]
    assert line.startswith("a.csv: ")
    assert "(1 more like it)" in line
    (line,) = [line for line in fit(glitched).report.remarks() if "jumps away and back" in line]
    assert line.startswith("a.csv: ")


def test_where_no_record_is_left_it_is_refused():
    with pytest.raises(BadInput, match=r"park\.csv: the voltage never moves; give a record"):
        verify(STAGE, [PARKED])
    with pytest.raises(BadInput, match="no recordings to verify the model on; give at least one file"):
        verify(STAGE, [])


@pytest.mark.parametrize(
    ("gain", "volts", "said"),
    [(1e-6, 1.0, "moves 1e-06 times"), (1.0, 15.0, "moves 0.067 times"), (-1.0, 1.0, "moves -1 times")],
    ids=["metres for um", "volts of the amplifier's output", "turned round"],
)
def test_another_unit_or_sign_is_said_in_one_line(gain, volts, said):
    found = verify(STAGE, [record(gain, volts, "a.csv"), record(gain, volts, "b.csv")])
    (line,) = [line for line in found.doubts if said in line]
    assert line.startswith("a.csv: axis x")
    assert line.endswith("(1 more like it)")
    assert "check units, signs and columns" in line
    assert line in str(found)


@pytest.mark.parametrize(("per_second", "unit"), [(1e3, "ms"), (1e6, "us"), (1.0, None), (3.0, None)])
def test_times_in_another_unit_are_asked_about(per_second, unit):
    slow = replace(record(), t_s=per_second * T_s)
    found = [line for line in verify(STAGE, slow).doubts if "are its times in" in line]
    assert len(found) == (unit is not None)
    assert (
        not found
        or f"rec.csv: is sampled at {RATE_HZ / per_second:g} Hz, the model at 500 Hz; are its times in {unit}"
        in found[0]
    )


def test_rows_that_are_given_twice_are_refused_by_fit(tmp_path):
    """They would count twice; windows of one file that share no time are two records."""
    path = tmp_path / "rec.csv"
    write_csv(path, record())
    with pytest.raises(BadInput, match=r"rec\.csv@0\.5:: its rows are also in another record .*; give them once"):
        fit([f"{path}@0:0.6", f"{path}@0.5:"])
    fit([f"{path}@0:0.5", f"{path}@0.6:"], base="linear")


def test_what_a_stage_can_come_to_is_no_doubt():
    assert verify(STAGE, [record(0.2), record(), record(2.9)]).doubts == []


def test_a_view_that_is_not_there_is_told_in_the_words_of_both():
    """From Python the remedy was an option of the command line."""
    with pytest.raises(BadInput, match=r'has no table view.*--view time \(in Python view="time"\)'):
        verify(STAGE, record(), view="table")


RINGING = Stage(
    name="mode",
    axes={"x": AxisModel(time=VIEW, effects=(AdoptedEffect(name="resonance", params={"f_Hz": 60.0, "zeta": 0.1}),))},
)


def ringing(stood: bool, *, offset_um: float = 0.0, late_s: float = 0.0, stage: Stage = RINGING) -> Recording:
    """From 1 V on, of a stage that had long stood there, or of one that was switched there in the first row."""
    u_V = 1 + 2 * np.sin(2 * np.pi * 5 * T_s)
    before_V = np.full(2000, 1.0 if stood else 0.0)
    t_s = np.arange(-len(before_V), len(T_s)) / RATE_HZ
    x_um = simulate(stage.axis("x"), t_s, np.r_[before_V, u_V])[len(before_V) :]
    noise_um = np.random.default_rng(2).normal(0, 0.01, len(T_s))
    return recording(t_s=T_s + late_s, u_V=u_V, x_um=x_um + noise_um + offset_um, source="rec.csv")


@pytest.mark.parametrize("late_s", [0.0, 1e5])
@pytest.mark.parametrize(("offset_um", "refit"), [(0.0, False), (-20.0, True)])
def test_a_stage_that_had_stood_where_a_record_begins_is_told_from_which_time_it_counts(late_s, offset_um, refit):
    record = ringing(stood=True, offset_um=offset_um, late_s=late_s)
    (line,) = verify(RINGING, [record] * 2, refit_offset=refit).doubts
    assert line.startswith("rec.csv: axis x begins at 1 V, which counts as a step from rest at 0 V: it leaves")
    assert line.endswith("(1 more like it)")
    after_s = float(re.search(r" @([\d.]+):", line)[1])
    late = replace(record, scored=slice(int(np.searchsorted(record.t_s, after_s)), None))
    found = verify(RINGING, late, refit_offset=refit)
    assert found[0].max_um < 0.1
    assert found.doubts == []
    early = replace(record, scored=slice(2, None))
    assert verify(RINGING, early, refit_offset=refit).doubts


def test_a_step_in_the_first_row_is_in_no_doubt():
    assert verify(RINGING, ringing(stood=False)).doubts == []


def test_where_both_starts_say_the_same_there_is_no_doubt():
    """A line has no dynamics: the prediction is the record, to the last digit."""
    exact = recording(t_s=T_s, u_V=2 + np.sin(T_s), x_um=20 * (2 + np.sin(T_s)), source="rec.csv")
    assert verify(STAGE, exact).doubts == []


def test_where_the_start_matters_to_the_end_no_window_is_proposed():
    hardly = AdoptedEffect(name="resonance", params={"f_Hz": 60.0, "zeta": 0.002})
    stage = Stage(name="mode", axes={"x": AxisModel(time=VIEW, effects=(hardly,))})
    (line,) = verify(stage, ringing(stood=True, stage=stage)).doubts
    assert line.endswith("that matters to the end: record it with the way from 0 V, and score what comes after")


LOOPED = Stage(
    name="loop",
    axes={"x": AxisModel(time=VIEW.model_copy(update={"play_r_V": (0.3, 0.8), "play_w_um_per_V": (2.0, 3.0)}))},
)


def from_0_V(turned_V: float | None) -> Recording:
    """A sine from 0 V on, of a stage at rest, or of one that had come from ``turned_V``."""
    u_V = 1 - np.cos(2 * np.pi * 2 * T_s)
    before_V = (
        np.zeros(1) if turned_V is None else np.r_[0.0, np.linspace(0, turned_V, 500), np.linspace(turned_V, 0, 500)]
    )
    t_s = np.arange(-len(before_V), len(T_s)) / RATE_HZ
    x_um = simulate(LOOPED.axis("x"), t_s, np.r_[before_V, u_V])[len(before_V) :]
    return recording(t_s=T_s, u_V=u_V, x_um=x_um + np.random.default_rng(2).normal(0, 0.01, len(T_s)), source="rec.csv")


def test_a_record_from_0_V_of_a_stage_that_had_come_from_elsewhere_is_told():
    """Its loop was said to be off by micrometres, of a model that was right."""
    (line,) = verify(LOOPED, from_0_V(5.0)).doubts
    assert line.startswith("rec.csv: axis x begins at 0 V, which counts as at rest: that leaves")
    assert re.search(r"if the stage had come from about 1\.\d+ V or further", line)
    after_s = float(re.search(r" @([\d.]+):", line)[1])
    late = replace(from_0_V(5.0), scored=slice(int(np.searchsorted(T_s, after_s)), None))
    found = verify(LOOPED, late)
    assert found[0].max_um < 0.1
    assert found.doubts == []


def test_a_record_from_rest_is_in_no_doubt_however_wrong_the_model():
    assert verify(LOOPED, from_0_V(None)).doubts == []
    assert verify(STAGE, from_0_V(None)).doubts == []
