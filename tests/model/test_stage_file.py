"""The stage file: every bit comes back, every mistake is one line that names its key."""

# ruff: noqa: E501 - a table of mistakes reads best with one on a line
from __future__ import annotations

import os
import re
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.effects import catalogue
from phaselead.model.stage_file import Stage, load_stage, parse_stage, provenance_of, save_stage, stage_text
from phaselead.model.table import XU_LI_2010
from phaselead.model.validation_errors import explained
from phaselead.record import AxisRecord, Recording

from stages import SHA, assert_one_line, example_stage, stages  # isort: skip

TEXT = stage_text(example_stage())


@settings(max_examples=100, deadline=None)
@given(stages())
def test_round_trip(stage: Stage) -> None:
    back = parse_stage(stage_text(stage))
    assert back == stage
    assert back.sha256 == stage.sha256
    assert repr(back) == repr(stage)  # tells -0.0 from 0.0


def test_files_round_trip(tmp_path: Path) -> None:
    save_stage(tmp_path / "s.toml", example_stage())
    assert load_stage(tmp_path / "s.toml") == example_stage()
    with pytest.raises(BadInput, match="exists already"):
        save_stage(tmp_path / "s.toml", example_stage(), overwrite=False)
    assert os.listdir(tmp_path) == ["s.toml"]


def test_an_effect_of_a_file_without_a_status_is_a_named_one() -> None:
    assert 'status = "named"' in TEXT
    before = re.sub(r"(?m)^status = .*\n", "", TEXT)
    assert "status" not in before
    assert parse_stage(before) == example_stage()
    with pytest.raises(BadInput, match=r"axes.x.effects\[0\].status"):
        parse_stage(TEXT.replace('status = "named"', 'status = "guessed"'))


def test_every_key_is_commented() -> None:
    described = set()
    for line in TEXT.splitlines():
        match = re.match(r"(?:# )?(\w+)(?: = .* # \w|: \w)", line)
        if match:
            described.add(match[1])
    keys = set(re.findall(r"^(\w+) = ", TEXT, flags=re.MULTILINE)) - {"format", "version", "k", "tau_s"}
    assert keys <= described
    assert len(keys) > 35


def test_hash_is_of_the_content_not_of_the_layout() -> None:
    stage = example_stage()
    bare = re.sub(r"[ \t]*# .*", "", TEXT)
    assert bare.count("#") == 0
    assert parse_stage(bare).sha256 == stage.sha256
    turned = Stage(name="s", axes={"y": AxisModel(), "x": AxisModel()})
    assert turned.sha256 == Stage(name="s", axes={"x": AxisModel(), "y": AxisModel()}).sha256
    changed = TEXT.replace("14.284 ", "14.284000000000002 ")
    assert changed != TEXT
    assert parse_stage(changed).sha256 != stage.sha256


def test_arrays_of_numpy_are_taken() -> None:
    view = TimeView(
        gain_um_per_V=np.float64(2),
        play_r_V=np.array([0.1, 0.2]),
        play_w_um_per_V=np.array([1, 2]),
        u_range_V=np.array([0.0, 1.0]),
        rate_Hz=np.int64(200),
    )
    assert view.play_w_um_per_V == (1.0, 2.0)
    assert type(view.play_r_V[0]) is float


def test_built_in_stage_loads() -> None:
    stage = parse_stage((resources.files("phaselead.sim") / "xyz250.toml").read_text())
    assert sorted(stage.axes) == ["x", "y", "z"]


def test_asking_for_an_axis_it_lacks() -> None:
    with pytest.raises(BadInput, match=r"'example' has no axis y; it has x"):
        example_stage().axis("y")


MISTAKES = [
    ('name = "example"', "", "s.toml: name: missing key; add it"),
    ("gain_um_per_V = 14.284", "", "axes.x.time.gain_um_per_V: missing key"),
    ("gain_um_per_V = 14.284", "gain_um_V = 14.284", "axes.x.time.gain_um_V: unknown key; did you mean gain_um_per_V?"),
    ("offset_um = 0.0", "qqq = 0.0", "axes.x.time.qqq: unknown key; known here: gain_um_per_V, "),
    ("[axes.x.limits]", "[axes.x.limit]", "axes.x.limit: unknown key; did you mean limits?"),
    ("swing_V = 5.0, f_Hz = 20.0", "swing = 5.0, f_Hz = 20.0", "axes.x.table.points[3].swing: unknown key; did you mean swing_V?"),
    ("14.284", '"14.284"', "axes.x.time.gain_um_per_V = '14.284': must be a number"),
    ("14.284", "true", "axes.x.time.gain_um_per_V = True: must be a number"),
    ("14.284", "nan", "axes.x.time.gain_um_per_V = nan: must be a finite number"),
    ("14.284", "-inf", "axes.x.time.gain_um_per_V = -inf: must be a finite number"),
    ("14.284", "1e12", "axes.x.time.gain_um_per_V = 1000000000000.0: is out of range"),
    ("14.284", "1" + "0" * 400, "axes.x.time.gain_um_per_V = 1000"),
    ("0.15, 0.3", "0.3, 0.3", "axes.x.time.play_r_V[2] = 0.3 is not above the threshold before it; sort them"),
    ("[0.05, 0.15", "[-0.05, 0.15", "axes.x.time.play_r_V[0] = -0.05 is negative"),
    ("[1.982, 0.453", "[1.982, -0.453", "axes.x.time.play_w_um_per_V[1] = -0.453 is negative"),
    ("[1.982, 0.453", "[1.982, nan", "axes.x.time.play_w_um_per_V[1] = nan: must be a finite number"),
    ("[1.982, 0.453, 0.0", "[1.982, 0.0", "axes.x.time.play_w_um_per_V: has 3 elements but play_r_V has 4"),
    ("[1.0, 2.0]", "[2.0, 1.0]", "axes.x.time.deadzone_d_V[1] = 1 is not above"),
    ("[1.65, -0.249]", "[1.65]", "axes.x.time.deadzone_s_um_per_V: has 1 elements but deadzone_d_V has 2"),
    ("delay_s = 0.00012", "delay_s = -1", "axes.x.time.delay_s = -1: is out of range; it must be at least 0"),
    ("rest_fraction = 0.55", "rest_fraction = 2", "axes.x.time.rest_fraction = 2: is out of range; it must be at most 1"),
    ("rate_Hz = 5000.0", "rate_Hz = 0", "axes.x.time.rate_Hz = 0: is out of range; it must be above 0"),
    ("u_range_V = [0.0, 10.0]", "u_range_V = [10, 0]", "axes.x.time.u_range_V: must be [lowest, highest], but 10 is not below 0"),
    ("1.9619", "-2.9619", "axes.x.table.a_um_per_V: is not monotone: the range K(um) um does not rise with um at"),
    ("15.2536, ", "", "axes.x.table.a_um_per_V[2]: missing key"),
    ("swing_V = [0.5, 10.0]", "swing_V = [0, 10.0]", "axes.x.table.swing_V[0] = 0: must be above 0"),
    ("f_Hz = [1.0, 20.0]", "f_Hz = [20, 1]", "axes.x.table.f_Hz: must be [lowest, highest]"),
    ("[1e-09, -1e-12, -1e-12]", "[-1e-09, -1e-12, -1e-12]", "axes.x.table.a_cov[0][0] = -1e-09: a variance cannot be negative"),
    ("u_max_V = 10.0", "u_max_V = -3.0", "axes.x.limits.u_max_V = -3 is not above u_min_V = -2"),
    ("u_park_V = 0.0", "u_park_V = 11", "axes.x.limits.u_park_V = 11 is outside u_min_V..u_max_V; park inside"),
    ("ramp_V_per_s = 50.0", "ramp_V_per_s = 5000", "axes.x.limits.ramp_V_per_s = 5000 is faster than slew_V_per_s"),
    ("bits = 16", "bits = 0", "axes.x.sensor.bits = 0: is out of range; it must be at least 1"),
    ("bits = 16", "bits = 1.5", "axes.x.sensor.bits = 1.5: must be a whole number"),
    ("x_max_um = 270.0", "x_max_um = -20.0", "axes.x.sensor.x_max_um = -20 is not above x_min_um = -10"),
    ('name = "creep"', 'name = "crep"', "axes.x.effects[0].name = 'crep': is no known effect; did you mean creep?"),
    ("share = 0.3", "share = 1.5", "axes.x.effects[0].share = 1.5: is out of range"),
    ("tau_s = 0.1\n", 'tau_s = "fast"\n', "axes.x.effects[0].params.tau_s = 'fast': must be a number"),
    ("k = [0.004, 0.006]", "k = [0.004, nan]", "axes.x.effects[0].params.k[1]: must be a finite number"),
    ("tau_s = [0.09, 0.11]", "tau_s = [0.11, 0.09]", "axes.x.effects[0].ci95.tau_s: has its low end 0.11 above"),
    ("tau_s = [0.09, 0.11]", "tau = [0.09, 0.11]", "axes.x.effects[0].ci95.tau: is an interval of no parameter"),
    ("version = 1\n", "version = 2\n", "was written by a newer phaselead (format version 2; this one knows 1); update"),
    ("version = 1\n", "version = 0\n", "version = 0"),
    ('format = "phaselead-stage"', 'format = "other"', 's.toml: is no stage file; one begins with format = "phaselead-stage"'),
    ('format = "phaselead-stage"', "", "s.toml: is no stage file"),
    ('format = "phaselead-stage"', "format =", "s.toml: is not TOML: Invalid value (at line 4"),
    (SHA, SHA.upper(), "provenance.parent_sha256 ="),
    ("[1.0, 0.02, 0.0]", "[0.9, 0.02, 0.0]", "cross_coupling[0][0] = 0.9: must be 1"),
    ("[1.0, 0.02, 0.0]", "[1.0, 0.02]", "cross_coupling[0][2]: missing key"),
    ("[axes.x.", "[axes.w.", "axes.w: is no axis; there are x, y and z"),
]  # fmt: skip


@pytest.mark.parametrize(("right", "wrong", "told"), MISTAKES)
def test_mistakes_are_named(tmp_path: Path, right: str, wrong: str, told: str) -> None:
    assert right in TEXT
    path = tmp_path / "s.toml"
    path.write_text(TEXT.replace(right, wrong))
    with pytest.raises(BadInput) as refusal:
        load_stage(path)
    assert_one_line(refusal.value)
    assert str(refusal.value).startswith(str(path))
    assert told.removeprefix("s.toml: ") in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "is no stage file"),
        (b"\xff\xfe\x00", "is not text"),
        (b"t_s,u_V\n0,1\n", "is it a recording?"),
        (b"a = " + b"[" * 100_000, "is not TOML"),
        (b"a = 1" + b"0" * 10_000, "is no"),
        (b"#" * (16 * 2**20 + 1), "larger than any stage file"),
        (b'format = "phaselead-stage"\nversion = 1\nname = "a"\naxes = 3\n', "axes = 3: must be a table"),
        (b'format = "phaselead-stage"\nversion = 1\nname = "a"\naxes = {}\n', "axes"),
        (b'format = "phaselead-stage"\nversion = 1\nname = "a"\naxes.x.table = 3\n', "axes.x.table = 3: must be a table"),
        (b'format = "phaselead-stage"\nversion = 1\nname = 3\naxes.x = {}\n', "name = 3: must be"),
        (b'format = "phaselead-stage"\nversion = 1\nname = "a"\naxes.x = {}\n"a\\nb" = 1\n', "a\\nb: unknown key"),
    ],
)  # fmt: skip
def test_other_files_are_refused(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "s.toml"
    path.write_bytes(content)
    with pytest.raises(BadInput) as refusal:
        load_stage(path)
    assert_one_line(refusal.value)
    assert told in str(refusal.value)


@pytest.mark.parametrize("name", ["missing.toml", ".", "a\0b"])
def test_what_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match=r"give a stage file \(\.toml\)"):
        load_stage(name)


def test_models_built_in_code_are_explained_too() -> None:
    with pytest.raises(BadInput, match=r"fit of a\.csv: play_w_um_per_V: has 0 elements"), explained("fit of a.csv"):
        TimeView(gain_um_per_V=1, play_r_V=[1], u_range_V=(0, 1), rate_Hz=1)


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "s.toml"
    save_stage(path, example_stage())
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(BadInput, match="No space left"):
        save_stage(path, Stage(name="new", axes={"x": AxisModel(table=XU_LI_2010)}))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["s.toml"]


def load_or_refuse(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        load_stage(path)
    except BadInput as refusal:
        assert_one_line(refusal)


@settings(max_examples=150, deadline=None)
@given(content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
def test_any_bytes(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    load_or_refuse(path, content)
    load_or_refuse(path, b'format = "phaselead-stage"\n' + content)


@settings(max_examples=250, deadline=None)
@given(where=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 30), st.binary(max_size=6)), min_size=1, max_size=4))
def test_mutated_files(tmp_path_factory: pytest.TempPathFactory, where: list[tuple[float, int, bytes]]) -> None:
    content = TEXT.encode()
    for at, cut, data in where:
        i = int(at * len(content))
        content = content[:i] + data + content[i + cut :]
    load_or_refuse(tmp_path_factory.getbasetemp() / "fuzz.toml", content)


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=250, deadline=None)
@given(data=st.data(), value=anything)
def test_any_value_under_any_key(data: st.DataObject, value: object) -> None:
    """Replace one part of a good stage, at any depth, by anything."""
    content = tomllib.loads(TEXT)
    here: object = content
    while True:
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))  # type: ignore[arg-type]
        key = data.draw(st.sampled_from(keys))
        below = here[key]  # type: ignore[index]
        if isinstance(below, (dict, list)) and below and data.draw(st.booleans()):
            here = below
            continue
        here[key] = value  # type: ignore[index]
        break
    try:
        with explained("stage"):
            Stage.model_validate(content)
    except BadInput as refusal:
        assert_one_line(refusal)


def test_a_stage_with_one_more_effect():
    before = example_stage()
    after = before.with_effect("amplifier_lowpass", tau_s=5e-4)
    assert after.axis("x").effects[:-1] == before.axis("x").effects
    assert after.axis("x").effects[-1].params == {"tau_s": 5e-4}
    assert parse_stage(stage_text(after)) == after
    with pytest.raises(BadInput, match="no known effect; one of") as unknown:
        before.with_effect("wear", tau_s=1.0)
    assert_one_line(str(unknown.value))
    with pytest.raises(BadInput, match="has no axis q"):
        before.with_effect("amplifier_lowpass", "q", tau_s=1.0)


@pytest.mark.parametrize(
    ("name", "params", "said"),
    [
        ("load_change", {"mas": 0.2}, "params.mas is no parameter of load_change; did you mean mass?"),
        ("load_change", {"wide": 0.2}, "params.wide is no parameter of load_change; it has mass"),
        ("load_change", {"mass": -3}, "params.mass = -3 is out of range; load_change takes -0.5..3 (of moving mass)"),
        ("creep", {"gamma": 5}, "params.gamma = 5 is out of range; creep takes -0.2..0.2 (per decade)"),
        (
            "amplifier_lowpass",
            {"tau_s": -1e-3},
            "params.tau_s = -0.001 is out of range; amplifier_lowpass takes at least 0 (s)",
        ),
        ("resonance", {"f_Hz": [200, -1], "zeta": [0.1, 0.1]}, "params.f_Hz = -1 is out of range"),
    ],
)
def test_effects_are_refused_at_once_with_parameters_that_make_no_sense(name, params, said):
    """They were saved, loaded, and met by the first command that drives the stage, or by none."""
    before = example_stage()
    with pytest.raises(BadInput, match=re.escape(said)) as refused:
        before.with_effect(name, **params)
    assert_one_line(str(refused.value))
    effects = (AdoptedEffect(name=name, params=params),)
    text = stage_text(Stage(name="s", axes={"x": before.axis("x").model_copy(update={"effects": effects})}))
    with pytest.raises(BadInput, match=re.escape(f"s.toml: axes.x.effects[0].{said}")) as refused:
        parse_stage(text, "s.toml")
    assert_one_line(str(refused.value))


@pytest.mark.parametrize("name", catalogue())
def test_what_a_search_may_find_is_taken(name):
    """Both bounds, and a bound that a logarithmic scale misses by its rounding."""
    known = catalogue()[name]
    for params in ({p.name: p.low for p in known.parameters}, {p.name: p.high * (1 + 1e-15) for p in known.parameters}):
        example_stage().with_effect(name, **params)


def test_modes_and_lags_are_taken_wherever_a_fit_finds_them():
    example_stage().with_effect("resonance", f_Hz=[4.0, 7000.0], zeta=[0.9, 0.001], c=[3.0, -2.0])
    example_stage().with_effect("amplifier_lowpass", tau_s=0.05)


@pytest.mark.parametrize(
    "text", ["t_s,u_V,x_um\n0,0,0\n", "# t_s,u_V\n0,1.5e-3\n", "0;0,5;1\n", "-1\t2\n", '"t_ms","u_mV"\n0,1\n']
)
def test_a_recording_in_place_of_a_stage_file_is_told(tmp_path, text):
    (tmp_path / "rec.csv").write_text(text)
    with pytest.raises(BadInput, match=r"rec\.csv: has columns.*is it a recording\?"):
        load_stage(tmp_path / "rec.csv")


def test_other_text_is_not_taken_for_a_recording(tmp_path):
    (tmp_path / "broken.toml").write_text('format = "phaselead-stage"\nname = \n')
    with pytest.raises(BadInput, match=r"is not TOML: .*repair the line"):
        load_stage(tmp_path / "broken.toml")


def test_recordings_of_one_name_are_told_apart_by_their_folders() -> None:
    t_s = np.arange(20) / 1e3

    def recorded(source: str, top_V: int) -> Recording:
        return Recording(
            t_s,
            {"x": AxisRecord(np.linspace(0, top_V, 20), np.linspace(0, 1, 20))},
            source=source,
            sha256=f"{top_V:064}",
        )

    every = [
        recorded("monday/a.csv", 1),
        recorded("tuesday/a.csv", 2),
        recorded("tuesday/b.csv@0.1:", 3),
        recorded("", 4),
    ]
    files = [one.file for one in provenance_of(None, every).data]
    assert files == ["monday/a.csv", "tuesday/a.csv", "b.csv@0.1:", "recording"]
