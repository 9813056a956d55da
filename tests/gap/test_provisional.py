"""Under `unknown` and `tie` the nearest set is adopted without its name being vouched for, and the next model works."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import outsiders
import pytest
from click.testing import CliRunner

from phaselead.cli import main
from phaselead.gap.adopt import adopted
from phaselead.gap.base_operator import with_operator
from phaselead.gap.findings import Adopted, Bound, GapSize, NamedEffect
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.provisional import _best_that_pays, nearest_that_pays
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.gap.run import run_gap
from phaselead.identify import fit
from phaselead.model import AdoptedEffect, catalogue, effect, load_stage, predict, save_stage, simulate
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.stage_file import Stage
from phaselead.record import write_csv

NEAR = ("resonance", "delay", "saturation")
OTHERS = tuple(name for name in catalogue() if name not in NEAR)
"""Left out of the catalogue, for speed."""
LINE = AxisModel(time=TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 8.0), rate_Hz=1000.0))


def unnamed(system, axis=LINE, count=4):
    """The runs of a system and a final fit in which the axis is alone."""
    roles = ["train"] * (count - 1) + ["holdout"]
    records = outsiders.records(system, count, seconds=2.0)
    runs = [
        GapRun("x", role, r.t_s, r.axes["x"].u_V, r.axes["x"].x_um, None, 0, len(r.t_s), r.source, {}, {})
        for role, r in zip(roles, records, strict=True)
    ]
    modelled = tuple(modelled_run(axis, run) for run in runs)
    alone = FinalFit(axis, (), modelled, modelled, GapSize(0.0, 0.0, 1e9)).with_entries(())
    return records, runs, replace(alone, gap=replace(alone.gap, before=alone.gap.after))


def test_the_nearest_set_predicts_held_out_records_better():
    records, runs, alone = unnamed(outsiders.mode)
    effects = [effect(name) for name in NEAR]
    final, entries = nearest_that_pays(alone, [], runs, effects)
    assert entries[0].name == "resonance"
    assert final.gap.after < 0.1 * alone.gap.after
    value, _, (low, high) = entries[0].params["f_Hz"]
    assert low <= value <= high
    assert value == pytest.approx(69.0, rel=0.02)
    assert entries[0].share > 0.9
    # What was found is what the next model predicts, from rest.
    following = adopted(final.axis, entries, {e.name for e in entries})
    assert {e.status for e in following.effects} == {"provisional"}
    said = predict(Stage(name="s", axes={"x": following}), records[-1]).axes["x"].x_um
    assert float(np.std(records[-1].axes["x"].x_um - said)) == pytest.approx(final.gap.after, rel=0.05)


def test_what_helps_in_all_blocks_is_adopted_though_one_record_holds_nearly_all_of_the_squares(monkeypatch):
    """A multisine through a mode that moved holds a thousand times the squares of the slow records."""
    was = np.array([1.0, 1.2, 0.9, 1.1, 1e4, 0.8, 1.3, 1.0])
    helps, in_one = 0.2 * was, np.where(was > 100, 1.0, was)
    for now, pays in ((helps, True), (in_one, False), (was, False)):
        monkeypatch.setitem(_best_that_pays.__globals__, "_squares", lambda *_, now=now: (was, now))
        assert (_best_that_pays(None, ["it"]) == "it") is pays


def test_what_saves_no_more_than_chance_is_not_adopted():
    _, runs, alone = unnamed(lambda u, step_s: 20.0 * u)
    final, entries = nearest_that_pays(alone, [], runs, [effect(name) for name in NEAR])
    assert entries == []
    assert final is alone
    # One sign of so small a change saves a little of any noise.
    either = [alone.with_entries([(effect("gain_change"), {"gain": gain})]) for gain in (1e-6, -1e-6)]
    assert min(one.gap.after for one in either) < alone.gap.after
    assert _best_that_pays(alone, either) is None


@pytest.mark.parametrize("system", [outsiders.hardening, outsiders.upside_down])
def test_a_system_outside_the_catalogue_ends_unknown(system):
    records = outsiders.records(system, 4)
    gap = run_gap(fit(records[:2], base="linear")[0], records[:3], records[3:], without=OTHERS)
    assert "unknown" in gap.verdicts
    assert "none" not in gap.verdicts
    written = gap.as_json()
    assert written["unexplained"]["share"] > written["unexplained"]["chance"] + 0.03
    assert {e.name for e in gap.effects} == {one.name for one in gap.adopted if one.status == "named"}
    assert [e.name for e in gap.next_model.axes["x"].effects] == [one["name"] for one in written["adopted"]]
    assert gap.gap.after <= gap.gap.before


def test_own_plays_go_with_what_is_adopted_beside_them():
    """Plays that were fitted before had taken a part of what is now the effect's."""
    bend = {"bend": 0.05, "skew": 0.0, "reach": 0.4}
    view = TimeView(
        gain_um_per_V=12.0, play_r_V=(0.4, 1.2), play_w_um_per_V=(4.0, 3.0), u_range_V=(0.0, 8.0), rate_Hz=1000.0
    )
    bent = AxisModel(time=view, effects=[AdoptedEffect(name="asymmetric_hysteresis", params=bend)])

    def looped(u, step_s):
        return simulate(bent, step_s * np.arange(len(u)), u)

    _, runs, line = unnamed(looped)
    axis = with_operator(LINE, [run for run in runs if run.role == "train"])
    modelled = tuple(modelled_run(axis, run) for run in runs)
    alone = FinalFit(axis, (), modelled, modelled, line.gap).with_entries(())
    names = [effect("asymmetric_hysteresis")]
    fixed, _ = nearest_that_pays(alone, [], runs, names)
    final, entries = nearest_that_pays(alone, [], runs, names, open_plays=True)
    assert [e.name for e in entries] == ["asymmetric_hysteresis"]
    assert final.gap.after < 0.9 * fixed.gap.after
    assert final.axis.time.play_w_um_per_V != axis.time.play_w_um_per_V


def test_nothing_is_adopted_where_nothing_is_missing():
    records = outsiders.records(lambda u, step_s: 20.0 * u, 4, seconds=2.0)
    stage = fit(records[:2], base="linear")[0]
    gap = run_gap(stage, records[:3], records[3:], without=OTHERS)
    assert gap.verdicts == ("none",)
    assert gap.adopted == ()
    assert gap.next_model.axes == stage.axes


def found(name, size, value, half=0.1):
    return NamedEffect(name, {size: (value, "1", (value * (1 - half), value * (1 + half)))}, 0.5)


@pytest.fixture
def next_toml(tmp_path):
    """A stage with hysteresis, named, and creep, provisional; and the one without a word about either."""
    view = TimeView(gain_um_per_V=18.0, u_range_V=(-2.0, 10.0), rate_Hz=5000.0)
    effects = [found("hysteresis", "width", 0.12), found("creep", "gamma", 0.01)]
    for name, unsure in (("next", {"creep"}), ("plain", set())):
        save_stage(
            tmp_path / f"{name}.toml", Stage(name="s", axes={"x": adopted(AxisModel(time=view), effects, unsure)})
        )
    return tmp_path / "next.toml"


def test_a_provisional_effect_is_kept_and_marked(next_toml):
    loaded = load_stage(next_toml)
    assert [e.status for e in loaded.axes["x"].effects] == ["named", "provisional"]
    assert 'status = "provisional"' in next_toml.read_text()


def test_a_model_that_holds_one_is_doubted():
    """What it stands for is closed, and the answer was none."""
    u = [outsiders.noisy(0.5, 5000.0, (2.0, 40.0), seed) for seed in (0, 1)]
    train, holdout = (outsiders.record(lambda u, step_s: 18.0 * u, one, 5000.0, i) for i, one in enumerate(u))
    view = TimeView(gain_um_per_V=18.0, u_range_V=(-2.0, 10.0), rate_Hz=5000.0)
    others = tuple(name for name in catalogue() if name != "gain_change")

    def doubts(status):
        late = AdoptedEffect(name="delay", status=status, params={"delay_s": 1e-5})
        stage = Stage(name="s", axes={"x": AxisModel(time=view, effects=(late,))})
        return run_gap(stage, [train], [holdout], without=others).doubts

    assert doubts("named") == ()
    assert doubts("provisional") == (
        "x: the model holds delay provisionally, a name that no records vouch for, and only what changed since is "
        "looked for; to look for what it is, run gap with the model from before it was adopted",
    )


def test_it_predicts_uploads_and_tracks_like_a_named_one(next_toml, tmp_path):
    u = outsiders.noisy(0.5, 5000.0, (2.0, 40.0), 0)
    write_csv(tmp_path / "rec.csv", outsiders.record(lambda u, step_s: 18.0 * u, u, 5000.0, 0))
    said = {}
    for name in ("next", "plain"):
        model = str(tmp_path / f"{name}.toml")
        port = ("--port", "sim://xyz250")
        for words in (
            ("predict", "--model", model, str(tmp_path / "rec.csv"), "-o", str(tmp_path / f"{name}.csv")),
            ("verify", "--model", model, str(tmp_path / "rec.csv"), "--json", str(tmp_path / f"v{name}.json")),
            ("upload", model, *port),
            ("track", "sine:20um@5Hz", *port, "--model", model, "--mode", "inverse", "--duration", "1",
             "-o", str(tmp_path / f"{name}.h5"), "--json", str(tmp_path / f"{name}.json")),
        ):  # fmt: skip
            ran = CliRunner().invoke(main, list(words))
            assert ran.exit_code == 0, ran.output
        texts = [(tmp_path / f"{part}.json").read_text() for part in (f"v{name}", name)]
        said[name] = (
            (tmp_path / f"{name}.csv").read_text(),
            json.loads(texts[0])["records"],
            json.loads(texts[1])["rms_um"],
        )
    assert said["next"] == said["plain"]


@pytest.mark.parametrize("status", ["named", "provisional"])
@pytest.mark.parametrize("axis", [None, "x"])
def test_what_is_adopted_is_in_no_other_list(status, axis):
    from test_gap_cli_page import result

    bounds = (Bound("creep", 0.002, "per decade"), Bound("delay", 0.01, "s"), Bound("hysteresis", 0.04, "of range"))
    found = replace(
        result(), verdicts=("unknown",), excluded=bounds, untestable=("creep", "gain_change"), ties=(),
        adopted=tuple(Adopted(name, status, axis) for name in ("hysteresis", "creep")),
    )  # fmt: skip
    found = replace(found, untestable_why={"creep": "too short", "gain_change": "nothing to compare with"})
    written = found.as_json()
    assert [b["name"] for b in written["excluded"]] == ["delay"]
    assert written["untestable"] == ["gain_change"]
    assert written["untestable_why"] == {"gain_change": "nothing to compare with"}
