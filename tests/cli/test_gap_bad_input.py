"""What ``phaselead gap`` refuses: one line that says what to do, exit 2, nothing written."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from phaselead.api import gap, gap_next
from phaselead.errors import BadInput
from phaselead.gap.records import refuse_overlap
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.stage_file import Stage, save_stage
from phaselead.record.atomic import write_texts
from phaselead.record.read import read_recording
from phaselead.record.recording import AxisRecord, Recording

RATE_HZ = 1000.0


def rows(seed: int, seconds: float = 2.0, rate_Hz: float = RATE_HZ, start_s: float = 0.0) -> np.ndarray:
    """t_s, u_V, x_um of a 5 Hz sine with noise."""
    t = start_s + np.arange(round(seconds * rate_Hz)) / rate_Hz
    u = 2.5 - 2.5 * np.cos(2 * np.pi * 5.0 * t)
    x = 20 * u + np.random.default_rng(seed).normal(0, 0.01, len(t))
    return np.column_stack([t, u, x])


def write(path: Path, values: np.ndarray, header: str = "t_s,u_V,x_um") -> Path:
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture(name="folder")
def _folder(tmp_path: Path) -> Path:
    """A model, and records that it can be compared with."""
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=RATE_HZ)
    save_stage(tmp_path / "model.toml", Stage(name="line", axes={"x": AxisModel(time=view)}))
    for seed, name in enumerate(("train", "other")):
        write(tmp_path / f"{name}.csv", rows(seed))
    return tmp_path


def refused(run, folder: Path, *words: str, **changed: object) -> None:
    """``gap`` on the folder with some arguments ``changed``; None leaves one out."""
    given = {
        "model": folder / "model.toml",
        "train": folder / "train.csv",
        "holdout": folder / "other.csv",
        "output": folder / "next.toml",
        "report": folder / "gap.html",
        "json": folder / "gap.json",
    }
    before = {path: path.read_bytes() for path in folder.iterdir()}
    arguments: list[object] = []
    for name, value in {**given, **changed}.items():
        if value is not None:
            arguments += [f"--{name}" if name != "output" else "-o", *(value if isinstance(value, list) else [value])]
    outcome = run("gap", *arguments)
    assert outcome.status == 2, outcome
    assert outcome.error is None
    assert outcome.err.startswith("phaselead: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_what_must_be_given(run, folder):
    refused(run, folder, "--model", model=None)
    refused(run, folder, "--train", "--holdout", train=None)
    refused(run, folder, "--train", "--holdout", holdout=None)


def test_records_at_another_rate(run, folder):
    write(folder / "slow.csv", rows(3, seconds=5.0, rate_Hz=500.0))
    said = "slow.csv", "500 Hz", "record at 1000 Hz", "phaselead fit"
    refused(run, folder, *said, train=folder / "slow.csv")
    refused(run, folder, *said, reference=folder / "slow.csv")


@pytest.mark.parametrize(("unit", "seconds"), [("ms", 1e-3), ("us", 1e-6)])
def test_times_in_another_unit(run, folder, unit, seconds):
    """The map that the message shows mends it."""
    for i, name in enumerate(("train", "other")):
        write(folder / f"{name}_{unit}.csv", rows(i) / [seconds, 1, 1])
    of = {"train": folder / f"train_{unit}.csv", "holdout": folder / f"other_{unit}.csv"}
    shown = f"t_s=1*{seconds:g},u_V=2,x_um=3"
    refused(run, folder, f"train_{unit}.csv", f"are its times in {unit}?", f"--map {shown}", **of)
    outcome = run("gap", "--model", folder / "model.toml", "--train", of["train"], "--holdout", of["holdout"],
                  "--map", shown)  # fmt: skip
    assert outcome.status == 0, outcome.err


def test_records_of_another_axis(run, folder):
    values = np.column_stack([rows(3), rows(4)[:, 1:]])
    path = write(folder / "yz.csv", values[:, [0, 1, 3, 2, 4]], "t_s,uy_V,uz_V,y_um,z_um")
    said = "no common channel", "axis x", "both voltage and position of y, z"
    refused(run, folder, *said, train=f"{path}@0:1", holdout=f"{path}@1:2")


def test_one_record_of_another_axis(run, folder):
    """It is the one that is named, not one that has the axis of the model."""
    write(folder / "y.csv", rows(3), "t_s,uy_V,y_um")
    said = "phaselead: " + str(folder / "y.csv"), "is of axis y, the model has axis x; leave it out"
    refused(run, folder, *said, train=[folder / "train.csv", "--train", folder / "y.csv"])
    refused(run, folder, *said, holdout=[folder / "y.csv", "--holdout", folder / "other.csv"])


def test_records_without_a_common_axis(run, folder):
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=RATE_HZ)
    both = Stage(name="plane", axes={"x": AxisModel(time=view), "y": AxisModel(time=view)})
    save_stage(folder / "both.toml", both)
    write(folder / "y.csv", rows(3), "t_s,uy_V,y_um")
    said = "no axis is in all", "train.csv has axis x", "y.csv has axis y", "one axis at a time"
    refused(run, folder, *said, model=folder / "both.toml", holdout=folder / "y.csv")


def test_a_model_without_a_time_view(run, folder):
    save_stage(folder / "table.toml", Stage(name="table", axes={"x": AxisModel()}))
    refused(run, folder, "no time view", "phaselead fit", model=folder / "table.toml")


def test_a_model_of_a_newer_version(run, folder):
    text = (folder / "model.toml").read_text()
    (folder / "newer.toml").write_text(text.replace("version = 1", "version = 7"))
    refused(run, folder, "newer.toml", "newer phaselead", "update", model=folder / "newer.toml")


def test_judging_on_what_was_trained_on(run, folder):
    train = folder / "train.csv"
    refused(run, folder, "also a training record", holdout=train)
    refused(run, folder, "also a training record", train=f"{train}@0:1.2", holdout=f"{train}@1:2")
    refused(run, folder, "also a reference record", reference=folder / "other.csv")
    (folder / "copy.csv").write_bytes(train.read_bytes())
    refused(run, folder, "also a training record", holdout=folder / "copy.csv")


def test_judging_on_a_copy_in_other_words(run, folder):
    """The digest of the file is another, the measurement is the same."""
    values = rows(0)
    np.savetxt(folder / "digits.csv", values, delimiter=",", header="t_s,u_V,x_um", comments="", fmt="%.12g")
    refused(run, folder, "also a training record", holdout=folder / "digits.csv")
    shifted = values.copy()
    shifted[:, 0] += 100
    write(folder / "later.csv", shifted)
    refused(run, folder, "also a training record", holdout=folder / "later.csv")
    write(folder / "part.csv", values[500:1500])
    refused(run, folder, "also a training record", holdout=folder / "part.csv")
    assert run("log", "export", folder / "train.csv", folder / "train.h5").status == 0
    refused(run, folder, "also a training record", holdout=folder / "train.h5")


def test_a_training_record_is_no_reference(run, folder):
    refused(run, folder, "train.csv: the training record is also a reference record", reference=folder / "train.csv")


def test_windows_that_only_touch_are_apart():
    values = rows(0)
    parts = [
        Recording(t_s=part[:, 0], axes={"x": AxisRecord(part[:, 1], part[:, 2])}, source=name)
        for name, part in (("a", values[:1000]), ("b", values[1000:]))
    ]
    refuse_overlap(parts[:1], parts[1:], "training")
    refuse_overlap(parts[1:], parts[:1], "training")


def test_a_voltage_that_never_moves(run, folder):
    still = rows(5)
    still[:, 1] = 1.0
    write(folder / "still.csv", still)
    refused(run, folder, "constant in every train record", "drive the stage", train=folder / "still.csv")
    refused(run, folder, "constant in every holdout record", holdout=folder / "still.csv")


def test_a_position_that_never_moves(run, folder):
    dead = rows(5)
    dead[:, 2] = 3.0
    write(folder / "dead.csv", dead)
    refused(run, folder, "never changes", "connected and mapped", train=folder / "dead.csv")


def test_a_coarse_sensor_at_rest_may_read_one_value(run, folder):
    """Of records that are driven it would be dead."""
    coarse = [rows(seed) for seed in (6, 7)]
    for values, name in zip(coarse, ("train", "other"), strict=True):
        values[:, 2] = np.round(values[:, 2])
        write(folder / f"{name}.csv", values)
    idle = rows(8)
    idle[:, 1:] = 0.0
    outcome = run(
        "gap", "--model", folder / "model.toml", "--train", folder / "train.csv", write(folder / "idle.csv", idle),
        "--holdout", folder / "other.csv", "-o", folder / "next.toml",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err


def test_a_saturated_sensor(run, folder):
    clipped = rows(5)
    clipped[:, 2] = np.minimum(clipped[:, 2], 80.0)
    write(folder / "clipped.csv", clipped)
    refused(run, folder, "clipped at 80 um", "less swing", train=folder / "clipped.csv")


def test_gaps(run, folder):
    write(folder / "gapped.csv", np.delete(rows(5), np.s_[700:710], axis=0))
    refused(run, folder, "gapped.csv", "samples are missing", train=folder / "gapped.csv")


def test_too_short(run, folder):
    write(folder / "short.csv", rows(5, seconds=0.1))
    refused(run, folder, "100 rows", "too short", "at least 256", train=folder / "short.csv")
    refused(run, folder, "100 rows", "too short", train=f"{folder / 'train.csv'}@0:0.1")


def test_no_number(run, folder):
    bent = rows(5)
    bent[100, 2] = np.nan
    write(folder / "nan.csv", bent)
    refused(run, folder, "line 102", "x_um", train=folder / "nan.csv")
    refused(run, folder, "nowhere.csv", train=folder / "nowhere.csv")


def test_outputs_are_checked_before_anything_is_read(run, folder):
    nothing = {"model": folder / "none.toml", "train": folder / "none.csv"}
    refused(run, folder, "next.txt", "must end in .toml", output=folder / "next.txt", **nothing)
    refused(run, folder, "gap.toml", "must end in .html", report=folder / "gap.toml", **nothing)
    for name, ending in (("output", "toml"), ("report", "html"), ("json", "json")):
        refused(run, folder, "no folder", **{name: folder / "no" / f"out.{ending}"}, **nothing)
    refused(run, folder, "two outputs at once", report=folder / "a.html", json=folder / "a.html", **nothing)


def test_no_input_is_written_over(run, folder):
    refused(run, folder, "one of the inputs", output=folder / "model.toml")
    refused(run, folder, "one of the inputs", json=folder / "train.csv", train=f"{folder / 'train.csv'}@0:1")
    refused(run, folder, "one of the inputs", json=folder / "other.csv")


def test_nothing_is_written_when_the_last_output_cannot_be(folder, monkeypatch):
    """The disk fills up with the last file: the first ones do not stay behind."""
    real = Path.write_text

    def full(path, text, **options):
        if text == "gap.json":
            raise OSError(28, "No space left on device")
        return real(path, text, **options)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(BadInput, match=r"gap\.json: cannot be written \(No space"):
        write_texts({str(folder / name): name for name in ("next.toml", "gap.html", "gap.json")})
    assert sorted(os.listdir(folder)) == ["model.toml", "other.csv", "train.csv"]
    monkeypatch.undo()
    write_texts({str(folder / name): name for name in ("next.toml", "gap.html", "gap.json")})
    assert (folder / "gap.json").read_text() == "gap.json"


EXPERIMENT = {
    "waveform": "triangle", "level": 2.0, "band": [1.0, 5.0], "bias": 1.0, "axis": None, "seconds": 1.0,
    "separation": 100.0, "needs_sensor": None,
}  # fmt: skip
AGAIN = {**EXPERIMENT, "waveform": "record", "source": "ref.csv", "points": [abs(1 - i / 512) for i in range(1024)]}
TIE = {"verdicts": ["tie"], "ties": [["delay", "sensor_lowpass"]], "next_experiment": EXPERIMENT}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("not json", ("is no gap.json",)),
        ("[1, 2]", ("is no gap.json",)),
        ("{}", ("is no gap.json",)),
        (json.dumps({**TIE, "ties": [], "next_experiment": None}), ("no tie",)),
        (
            json.dumps({"verdicts": ["unknown"], "ties": [], "untestable": ["creep"], "next_experiment": None}),
            ("no tie", "creep (steps of both signs with holds of 30 s and more)"),
        ),
        (json.dumps({**TIE, "next_experiment": None}), ("no experiment", "other waveforms")),
        (json.dumps({**TIE, "next_experiment": "triangle"}), ("damaged",)),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "needs_sensor": "a thermometer"}}), ("a thermometer",)),
        (json.dumps({**TIE, "next_experiment": {"waveform": "triangle"}}), ("lacks one of",)),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "waveform": "wiggle"}}), ("'wiggle'", "make gap.json")),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "seconds": -1}}), ("-1 s",)),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "waveform": "record"}}), ("'record'", "make gap.json")),
        (json.dumps({**TIE, "next_experiment": {**AGAIN, "points": [0.0, 1.0]}}), ("'record'", "make gap.json")),
        (json.dumps({**TIE, "next_experiment": {**AGAIN, "points": "abc"}}), ("lacks one of",)),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "level": 60.0}}), ("outside the limits",)),
        (json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "band": [300, 300]}}), ("V/s",)),
    ],
)
def test_experiments_that_cannot_be_run(run, tmp_path, content, words):
    path = tmp_path / "gap.json"
    path.write_text(content)
    outcome = run("gap", "next", path, "-o", tmp_path / "more.h5")
    assert outcome.status == 2, outcome
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err
    assert os.listdir(tmp_path) == ["gap.json"]


def test_the_output_of_an_experiment_is_checked_first(run, tmp_path):
    path = tmp_path / "gap.json"
    path.write_text(json.dumps(TIE))
    for output, word in ((tmp_path / "more.csv", ".h5"), (tmp_path / "no" / "more.h5", "no folder")):
        outcome = run("gap", "next", path, "-o", output, "--port", "/dev/does-not-exist")
        assert (outcome.status, outcome.err.count("\n")) == (2, 1)
        assert word in outcome.err


def test_a_proposed_experiment_is_run_and_recorded(run, tmp_path):
    path, more = tmp_path / "gap.json", tmp_path / "more.h5"
    path.write_text(json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "bias": 3.0}}))
    outcome = run("gap", "next", path, "-o", more)
    assert outcome.status == 0, outcome.err
    assert run("log", "info", more, "--json", "-").json["rate_Hz"] == pytest.approx(5000)
    path.write_text(json.dumps({**TIE, "next_experiment": {**AGAIN, "bias": 3.0, "band": [0.5, 0.5]}}))
    assert run("gap", "next", path, "-o", tmp_path / "again.h5").status == 0
    assert run("log", "info", tmp_path / "again.h5", "--json", "-").json["samples"] == 5000
    idle = {**EXPERIMENT, "waveform": "idle", "level": 0.0, "bias": 0.0, "seconds": 0.2}
    path.write_text(json.dumps({**TIE, "next_experiment": idle}))
    assert run("gap", "next", path, "-o", tmp_path / "idle.h5").status == 0
    assert run("log", "info", tmp_path / "idle.h5", "--json", "-").json["samples"] == 1000


def test_an_experiment_beside_records_of_another_rate_is_refused_before_it_is_made(run, tmp_path):
    """``gap`` would refuse its record; that was said when the stage had been driven."""
    (tmp_path / "gap.json").write_text(json.dumps({**TIE, "next_experiment": {**EXPERIMENT, "bias": 3.0}}))
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=2000.0)
    save_stage(tmp_path / "slow.toml", Stage(name="slow", axes={"x": AxisModel(time=view)}))
    outcome = run("gap", "next", tmp_path / "gap.json", "--model", tmp_path / "slow.toml", "-o", tmp_path / "more.h5")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "records at 2000 Hz, a device records at 5000 Hz" in outcome.err
    assert not (tmp_path / "more.h5").exists()


def test_the_experiment_is_run_on_the_axis_of_its_tie(run, tmp_path):
    """Also where gap.json has no axis because the data have a single one."""
    path, more = tmp_path / "gap.json", tmp_path / "more.h5"
    content = {**TIE, "next_experiment": {**EXPERIMENT, "bias": 3.0, "drives": "y"}}
    path.write_text(json.dumps(content))
    outcome = run("gap", "next", path, "--axis", "x", "-o", more)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "the tie is of axis y" in outcome.err
    for axis in ("q", "xy", "x"):
        with pytest.raises(BadInput, match=f"axis '?{axis}"):
            gap_next(path, output=more, axis=axis)
    assert os.listdir(tmp_path) == ["gap.json"]
    assert run("gap", "next", path, "-o", more).status == 0
    assert list(read_recording(more).axes) == ["y"]
    path.write_text(json.dumps({**content, "next_experiment": {**content["next_experiment"], "drives": ["y"]}}))
    outcome = run("gap", "next", path, "-o", tmp_path / "again.h5")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)


def test_a_map_for_files_of_which_some_name_their_columns_is_refused(run, folder):
    """It was for all of them: the file with the right header was scaled too, and there was no gap."""
    values = rows(0) * (1, 1e3, 1e3)
    foreign = write(folder / "mV.csv", values, "t_s,u_mV,x_nm")
    shown = "t_s=1,u_V=2*0.001,x_um=3*0.001"
    refused(run, folder, "other.csv: names its columns", "log import", str(foreign), train=foreign, map=shown)
    with pytest.raises(BadInput, match=r"other\.csv: names its columns"):
        gap(folder / "model.toml", train=foreign, holdout=folder / "other.csv", map=shown)


@pytest.mark.parametrize(
    ("columns", "header", "said"),
    [
        ([0, 2], "t_s,x_um", "has no voltage beside its position"),
        ([0, 1], "t_s,u_V", "has no position beside its volt"),
    ],
)
def test_half_a_record(run, folder, columns, header, said):
    half = write(folder / "half.csv", rows(3)[:, columns], header)
    refused(run, folder, "half.csv", said, "map the missing column", train=half)


def test_a_gap_json_in_place_of_a_model(run, folder):
    (folder / "old.json").write_text('{"verdicts": ["none"]}')
    refused(run, folder, "old.json: is JSON", "give the .toml", model=folder / "old.json")


def test_a_record_in_the_place_of_a_command(run, folder):
    outcome = run("gap", "--model", folder / "model.toml", folder / "train.csv")
    assert outcome.status == 2
    assert "train.csv: what is it for? Give records with --train, --holdout, --reference" in outcome.err
    assert outcome.err.count("\n") == 1


def test_a_copy_of_a_sine_whose_sensor_has_coarse_steps(run, folder):
    """Its position takes few values, again and again."""
    t = np.arange(2000) / RATE_HZ
    u = 3 + 2 * np.sin(2 * np.pi * 3 * t)
    x = 0.5 * np.round((20 * u + np.random.default_rng(4).normal(0, 0.1, len(t))) / 0.5)
    assert len(np.unique(np.diff(x, 2))) < len(x) // 100
    write(folder / "coarse.csv", np.column_stack([t, u, x]))
    assert run("log", "export", folder / "coarse.csv", folder / "coarse.h5").status == 0
    refused(run, folder, "also a training record", train=folder / "coarse.csv", holdout=folder / "coarse.h5")
    refused(
        run, folder, "also a training record", train=f"{folder}/coarse.csv@0:1", holdout=f"{folder}/coarse.h5@0.5:2"
    )


def test_steps_that_a_coarse_sensor_sees_alike_are_two_measurements():
    """Nothing but the drive shows in them."""
    t = np.arange(2000) / RATE_HZ
    u = np.where(t % 0.5 < 0.25, 1.0, 6.0)
    first, second = (
        Recording(
            t_s=t,
            axes={
                "x": AxisRecord(
                    u, 0.5 * np.round((20 * u + 0.1 + np.random.default_rng(i).normal(0, 0.02, 2000)) / 0.5)
                )
            },
            source=f"{i}.csv",
        )
        for i in range(2)
    )
    refuse_overlap([first], [second], "training")
