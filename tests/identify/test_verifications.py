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
from phaselead.sim import built_in

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
    [(1e-6, 1.0, "moves 1e-06 times"), (1.0, 15.0, "moves 0.067 times"), (-1.0, 1.0, "moves backwards")],
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


@pytest.mark.parametrize(
    ("slower", "said"), [(5.0, "4 ms later"), (0.25, "0.75 ms earlier"), (1.0, None), (1.005, None)]
)
def test_at_another_rate_it_says_how_much_of_a_delay_is_of_the_rows(slower, said):
    other = replace(record(gain=1.03), t_s=slower * T_s)
    found = [line for line in verify(STAGE, [other, other]).doubts if "held from row to row" in line]
    assert not [line for line in verify(STAGE, replace(record(), t_s=slower * T_s)).doubts if "held from row" in line]
    assert len(found) == (said is not None)
    if said is not None:
        assert f"is sampled at {RATE_HZ / slower:g} Hz, the model at 500 Hz" in found[0]
        assert said in found[0]
        assert "(1 more like it)" in found[0]


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
    assert line.startswith("rec.csv: axis x begins at 1 V, which counts as a step from rest at 0 V: that leaves")
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


def test_a_record_from_a_voltage_at_which_a_stage_stood_after_a_larger_one_is_told():
    """It had been tried straight from rest alone, which is as wrong, so that nothing was said of an error of a quarter
    of the range: on a newcomer's stage that had been driven in full before."""
    u_V = 1.2 - 0.4 * np.cos(2 * np.pi * 2 * T_s)
    before_V = np.r_[0.0, np.linspace(0, 2, 500), np.linspace(2, u_V[0], 500)]
    t_s = np.arange(-len(before_V), len(T_s)) / RATE_HZ
    x_um = simulate(LOOPED.axis("x"), t_s, np.r_[before_V, u_V])[len(before_V) :]
    noise_um = np.random.default_rng(2).normal(0, 0.01, len(T_s))
    (line,) = verify(LOOPED, recording(t_s=T_s, u_V=u_V, x_um=x_um + noise_um, source="rec.csv")).doubts
    assert line.startswith("rec.csv: axis x begins at 0.8 V, which counts as a step from rest at 0 V: that leaves")
    assert re.search(r"if the stage had come from about (1\.9\d*|2\.\d+|2) V", line)


def test_a_record_from_rest_is_in_no_doubt_however_wrong_the_model():
    assert verify(LOOPED, from_0_V(None)).doubts == []
    assert verify(STAGE, from_0_V(None)).doubts == []


def changed(gain: float = 1.0, higher_um: float = 0.0, late_s: float = 0.0) -> Recording:
    """Of the straight stage, with a noise of 10 nm."""
    u_V = np.where(T_s < late_s, 0.0, 2.5 - 2.5 * np.cos(2 * np.pi * 5 * (T_s - late_s)))
    noise_um = np.random.default_rng(3).normal(0, 0.01, len(T_s))
    return recording(t_s=T_s, u_V=U_V, x_um=gain * 20 * u_V + higher_um + noise_um, source="rec.csv")


def told(found) -> list[str]:
    """The lines on what describes an error, without the one that says what to do."""
    return [line for line in found.remarks() if "than the model says" in line]


@pytest.mark.parametrize(
    ("made", "said", "by"),
    [
        (changed(gain=1.03), "moves 3 % further than", ("gain", 0.03)),
        (changed(gain=0.98), "moves 2 % less far than", ("gain", -0.02)),
        (changed(higher_um=-1.5), "stands 1.5 um lower than", ("shift", -1.5)),
        (changed(late_s=0.002), "comes 2 ms later than", ("delay", 0.002)),
        (changed(late_s=0.0131), "comes 13.1 ms later than", ("delay", 0.0131)),
        (changed(late_s=0.025), "comes 25 ms later than", ("delay", 0.025)),
    ],
)
def test_the_one_number_that_describes_an_error_is_told(made, said, by):
    found = verify(STAGE, made)
    (line,) = told(found)
    assert f"rec.csv: axis x {said} the model says: of " in line
    assert line in str(found)
    (way,) = found.as_dict()["records"][0]["described_by"]
    (change,) = way["changes"]
    assert change["what"] == by[0]
    assert change["value"] == pytest.approx(by[1], rel=0.03)
    assert found[0].described is not None
    assert way["left_um_rms"] < 0.5 * found[0].described.error_um_rms


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (changed(gain=1.05, higher_um=4), "stands 4 um higher and moves 5 % further than"),
        (changed(gain=1.05, late_s=0.006), "moves 5 % further and comes 6 ms later than"),
        (changed(higher_um=4, late_s=0.006), "stands 4 um higher and comes 6 ms later than"),
        (changed(0.9, 4, 0.006), "stands 4 um higher and moves 10 % less far and comes 6 ms later than"),
    ],
)
def test_changes_that_only_together_describe_an_error_are_told_together(made, said):
    """One of them alone would be given the size of both."""
    (line,) = told(verify(STAGE, made))
    assert said in line
    assert float(line.split()[-1]) < 0.02


def test_a_position_that_comes_before_its_voltage_is_told():
    made = changed()
    earlier = replace(made.axes["x"], x_um=np.roll(made.axes["x"].x_um, -2))
    (line,) = told(verify(STAGE, replace(made, axes={"x": earlier})))
    assert "comes 4 ms earlier than" in line


def test_numbers_that_describe_an_error_alike_are_all_told():
    """Of a small motion far from 0 V more gain is nearly a shift."""
    u_V = 4 + 0.02 * np.sin(2 * np.pi * 5 * T_s)
    x_um = 1.03 * 20 * u_V + np.random.default_rng(5).normal(0, 0.01, len(T_s))
    window = replace(recording(t_s=T_s, u_V=u_V, x_um=x_um, source="rec.csv"), scored=slice(50, None))
    (line,) = told(verify(STAGE, window))
    assert "moves 3 % further or stands 2.4 um higher than" in line


@pytest.mark.parametrize("offset_um", [40.0, 200.0])
def test_a_gain_counts_from_where_the_stage_rests(offset_um):
    """Whatever effect moved that."""
    offset = AdoptedEffect(name="offset", params={"offset_um": offset_um})
    moved = Stage(name="moved", axes={"x": AxisModel(time=VIEW, effects=(offset,))})
    (line,) = told(verify(moved, changed(gain=1.03, higher_um=offset_um)))
    assert "moves 3 % further than" in line


@pytest.mark.parametrize("made", [changed(), changed(gain=1 + 1e-5), changed(higher_um=1e-3)])
def test_an_error_of_the_noise_asks_for_no_reason(made):
    found = verify(STAGE, made)
    assert found.remarks() == []
    assert "described_by" not in found.as_dict()["records"][0]


def test_an_error_as_large_as_what_the_fit_left_asks_for_no_reason():
    """A model that left 0.5 um of its own records is expected to miss as much."""
    rough = Stage(name="rough", axes={"x": AxisModel(time=VIEW.model_copy(update={"residual_um_rms": 0.5}))})
    assert told(verify(rough, changed(higher_um=0.9))) == []
    assert told(verify(rough, changed(higher_um=1.1))) != []


FITTED = Stage(name="fitted", axes={"x": AxisModel(time=VIEW.model_copy(update={"residual_um_rms": 0.01}))})


@pytest.mark.parametrize("begins_at_V", [0.0, 1.0])
def test_where_no_change_describes_a_large_error_that_is_said(begins_at_V):
    """With what the fit left, which few know by heart; of a record from elsewhere the past may be all."""
    u_V = begins_at_V + U_V
    bent_um = 20 * u_V + 3 * np.sin(2 * np.pi * U_V / 2) + np.random.default_rng(4).normal(0, 0.01, len(T_s))
    made = recording(t_s=T_s, u_V=u_V, x_um=bent_um, source="rec.csv")
    (line,) = [line for line in verify(FITTED, made).remarks() if "times what the fit left" in line]
    assert "no shift, gain or delay of up to 50 ms describes it" in line
    assert ("what it had done before it began may" in line) == (begins_at_V > 0)
    assert told(verify(STAGE, made)) == []


def test_a_position_that_does_not_follow_the_voltage_is_described_by_nothing():
    x_um = np.cumsum(np.random.default_rng(6).normal(0, 1, len(T_s)))
    made = recording(t_s=T_s, u_V=U_V, x_um=x_um, source="rec.csv")
    assert told(verify(STAGE, made)) == []
    assert any("no shift or delay of up to 50 ms describes it" in line for line in verify(FITTED, made).remarks())


def test_what_is_left_beside_a_change_is_told_where_it_is_much():
    """Of another stage a gain is not all."""
    other_um = 30 * U_V + 3 * np.sin(2 * np.pi * U_V / 2)
    (line,) = told(verify(FITTED, recording(t_s=T_s, u_V=U_V, x_um=other_um, source="rec.csv")))
    assert "% further than" in line
    assert "the fit left 0.01, so something else changed as well" in line
    assert "something else" not in told(verify(FITTED, changed(gain=1.03)))[0]


def test_of_times_in_another_unit_no_delay_is_told():
    """Of the record that has them alone."""
    found = verify(STAGE, [replace(changed(late_s=0.002), t_s=1e3 * T_s), changed(gain=1.03)])
    assert [one.described is None for one in found] == [True, False]


def test_changes_of_other_sizes_are_not_alike():
    assert len(told(verify(STAGE, [changed(gain=1.03), changed(gain=0.97), changed(gain=0.8)]))) == 3


@pytest.mark.parametrize("gain", [0.4, 1.5, 2.2, 2.9])
def test_a_delay_is_told_beside_any_gain(gain):
    """It oscillated beside twice the gain."""
    (line,) = told(verify(STAGE, changed(gain=gain, late_s=0.006)))
    assert "comes 6 ms later" in line


@pytest.mark.parametrize(("rows", "at"), [(1, 50), (1, 250), (10, 50), (10, 250)])
def test_a_step_that_comes_late_is_told(rows, at):
    """Wherever it is, and however steep."""
    u_V = np.interp(np.arange(len(T_s)), [at, at + rows], [0.0, 5.0])
    late_um = 20 * np.interp(np.arange(len(T_s)) - 5, [at, at + rows], [0.0, 5.0])
    noise_um = np.random.default_rng(7).normal(0, 0.01, len(T_s))
    found = verify(FITTED, recording(t_s=T_s, u_V=u_V, x_um=late_um + noise_um, source="step.csv"))
    assert found[0].described is not None
    (change,) = found[0].described.ways[0].changes
    assert change.value == pytest.approx(0.01, abs=1 / RATE_HZ if rows == 1 else 1e-4)
    assert not any("something else" in line for line in found.remarks())


@pytest.mark.parametrize("late_s", [0.025, 0.03, 0.04, 0.048])
def test_a_delay_of_nearly_a_quarter_of_a_period_is_told(late_s):
    """From an eighth on the position hardly goes with the prediction row by row: no delay was looked for."""
    described = verify(FITTED, changed(late_s=late_s))[0].described
    assert described is not None
    assert [(change.what, round(change.value, 3)) for change in described.ways[0].changes] == [("delay", late_s)]


def test_without_its_mean_a_delay_is_told_as_with_it():
    """What a delay moves out of the record had changed the mean, and something else was said to have changed."""
    u_V = 2.5 - 2.5 * np.cos(2 * np.pi * T_s)
    late_um = 20 * np.interp(T_s - 0.1, T_s, u_V) + np.random.default_rng(8).normal(0, 0.01, len(T_s))
    made = recording(t_s=T_s, u_V=u_V, x_um=late_um, source="rec.csv")
    for refit_offset in (False, True):
        (line,) = told(verify(FITTED, made, refit_offset=refit_offset))
        assert "comes 100 ms later" in line
        assert "something else" not in line


RINGS = built_in("xyz250")
"""Its mode at 200 Hz rings on for a tenth of a second."""
FAST_s = np.arange(5000) / 5000.0
DRIVES = {
    "step": np.where(FAST_s < 0.2, 0.0, 5.0),
    "square": 5.0 * ((FAST_s * 5) % 1 >= 0.5),
    "staircase": np.random.default_rng(1).uniform(0, 10, 20)[(FAST_s * 20).astype(int)],
    "sine from elsewhere": 5 + 2 * np.sin(2 * np.pi * 3 * FAST_s),
}


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("late_s", [-1e-3, 2e-4, 4e-4, 1e-3, 2e-3, 1e-2])
def test_a_delay_of_a_stage_that_rings_is_told(drive, late_s):
    """Between two of the delays that are tried it rings several times: another was told, or that none describes it."""
    u_V = DRIVES[drive]
    x_um = simulate(RINGS.axis("x"), FAST_s, u_V)
    late_um = np.interp(FAST_s - late_s, FAST_s, x_um) + np.random.default_rng(2).normal(0, 0.005, len(FAST_s))
    time = RINGS.axis("x").time.model_copy(update={"residual_um_rms": 0.02})
    model = Stage(name="rings", axes={"x": RINGS.axis("x").model_copy(update={"time": time})})
    (found,) = verify(model, recording(t_s=FAST_s, u_V=u_V, x_um=late_um, source="rec.csv"))
    assert found.described is not None
    (change,) = found.described.ways[0].changes
    assert change.what == "delay"
    assert change.value == pytest.approx(late_s, abs=2e-5)


def test_of_what_no_change_describes_the_worst_is_named():
    def bent(size_um: float, source: str) -> Recording:
        x_um = 20 * U_V + size_um * np.sin(2 * np.pi * U_V / 2)
        return recording(t_s=T_s, u_V=U_V, x_um=x_um, source=source)

    (line, _) = verify(FITTED, [bent(1.5, "a.csv"), bent(6.0, "b.csv"), bent(3.0, "c.csv")]).remarks()
    assert line.startswith("b.csv: axis x leaves ")
    assert line.endswith("(2 more like it)")


@pytest.mark.filterwarnings("error")
def test_a_late_step_near_the_end_of_a_short_window_is_no_search_among_no_rows():
    u_V = np.interp(np.arange(len(T_s)), [len(T_s) - 12, len(T_s) - 11], [0.0, 5.0])
    x_um = 20 * np.roll(u_V, 5) + np.random.default_rng(9).normal(0, 0.01, len(T_s))
    whole = recording(t_s=T_s, u_V=u_V, x_um=x_um, source="step.csv")
    (found,) = verify(FITTED, replace(whole, scored=slice(len(T_s) - 20, None)))
    assert found.described is not None
    assert found.described.latest_s < 20 / RATE_HZ


def test_records_that_the_model_was_fitted_on_are_said_to_be():
    made = replace(changed(), sha256="0" * 64)
    fitted = fit(made).model
    found = verify(fitted, [made, replace(changed(), sha256="1" * 64)])
    assert [one.fitted_on for one in found] == [True, False]
    in_memory = fit(changed()).model
    assert [one.fitted_on for one in verify(in_memory, [changed(), changed(gain=2)])] == [True, False]
    unknown = [source.model_copy(update={"rows_s": None}) for source in fitted.provenance.data]
    older = fitted.model_copy(update={"provenance": fitted.provenance.model_copy(update={"data": tuple(unknown)})})
    assert not verify(older, made)[0].fitted_on
    assert "the model was fitted on rows of rec.csv" in found.remarks()
    assert [one.get("fitted_on") for one in found.as_dict()["records"]] == [True, None]


def test_another_window_of_the_same_file_is_no_record_that_the_model_was_fitted_on():
    made, half = replace(changed(), sha256="0" * 64), len(T_s) // 2
    early, late = replace(made, scored=slice(0, half)), replace(made, scored=slice(half, None))
    fitted = fit(early).model
    assert [one.fitted_on for one in verify(fitted, [early, late, made])] == [True, False, True]
    assert len(fit([early, late]).model.provenance.data) == 2


def test_records_that_move_as_no_stage_does_are_told_that_alone():
    """Each by itself, of whatever name."""
    found = verify(STAGE, [record(15.0), changed(gain=1.03)])
    assert found[0].described is None
    assert [change.what for change in found[1].described.ways[0].changes] == ["gain"]


def test_records_are_told_together_where_the_same_number_describes_them():
    every = [changed(gain=1.03), changed(higher_um=-5.0), changed(gain=1.035)]
    lines = told(verify(STAGE, every))
    assert len(lines) == 2
    assert lines[0].endswith("(1 more like it)")
    assert "3 % further" in lines[0]
    assert "5 um lower" in lines[1]
    numbers = [one["described_by"][0]["changes"][0]["value"] for one in verify(STAGE, every).as_dict()["records"]]
    assert numbers == pytest.approx([0.03, -5, 0.035], rel=0.02)


def test_a_shift_of_zero_is_none_where_it_was_refitted():
    assert told(verify(STAGE, changed(higher_um=-1.5), refit_offset=True)) == []
    (line,) = told(verify(STAGE, changed(gain=1.03, higher_um=40.0), refit_offset=True))
    assert "moves 3 % further" in line
