"""Settings edited from the page: what is shown, what a change makes, and what is refused."""

from __future__ import annotations

import re

import pytest

from phaselead.errors import BadInput
from phaselead.model import AdoptedEffect, load_stage
from phaselead.scope.settings import changed, settings_of
from phaselead.sim import built_in


def rows(stage, axis="x"):
    return {f"{row['part']}.{row['name']}": row for row in settings_of(stage)[axis]}


def test_every_setting_has_its_words_and_its_value():
    stage = built_in("xyz250")
    found = rows(stage)
    assert set(settings_of(stage)) == set("xyz")
    assert found["limits.u_max_V"]["value"] == stage.axis("x").limits.u_max_V
    assert all(row["what"] for row in found.values())
    assert "gains.filters" not in found
    assert found["filters.1.poles_Hz"]["value"] is None
    resonance = found["effects.1.resonance.f_Hz"]
    assert (resonance["value"], resonance["low"], resonance["high"]) == (200.0, 10.0, 5000.0)
    assert found["effects.0.creep.tau_s.2"]["value"] == 10.0
    assert settings_of(None) == {}


def test_a_change_leaves_the_rest_and_names_its_parent():
    before = built_in("xyz250")
    after = changed(before, "y", {"limits.u_max_V": 8, "gains.kp_V_per_um": 0.0, "gains.ki_V_per_um_s": 20})
    assert after.axis("y").limits == before.axis("y").limits.model_copy(update={"u_max_V": 8.0})
    assert after.axis("y").gains.ki_V_per_um_s == 20
    assert after.axis("y").gains.origin is None
    assert after.axis("x") == before.axis("x")
    assert after.axis("y").effects == before.axis("y").effects
    assert after.provenance.parent_sha256 == before.sha256


NOTCH = {"zeros_Hz": 200.0, "zeros_zeta": 0.05, "poles_Hz": 200.0, "poles_zeta": 0.5}


def test_filters_are_put_in_changed_and_taken_out():
    model = changed(built_in("xyz250"), "x", {f"filters.1.{name}": value for name, value in NOTCH.items()})
    (notch,) = model.axis("x").gains.filters
    assert notch.model_dump() == NOTCH
    assert rows(model)["filters.0.zeros_Hz"]["value"] == 200.0
    both = changed(model, "x", {"filters.1.poles_Hz": 800, "filters.1.poles_zeta": 0.7, "filters.0.zeros_zeta": 0.1})
    assert [one.zeros_zeta for one in both.axis("x").gains.filters] == [0.1, 0.0]
    gains = both.axis("x").gains
    assert gains.model_copy(update={"filters": None}) == model.axis("x").gains.model_copy(update={"filters": None})
    one = changed(both, "x", {f"filters.0.{name}": None for name in NOTCH})
    assert [filter_.poles_Hz for filter_ in one.axis("x").gains.filters] == [800]
    none = changed(one, "x", {f"filters.0.{name}": None for name in NOTCH})
    assert none.axis("x").gains.filters is None


def test_effects_are_edited_and_removed():
    resonance = AdoptedEffect(
        name="resonance",
        params={"f_Hz": (200.0, 600.0), "zeta": 0.02},
        ci95={"f_Hz": [199, 201], "zeta": [0.01, 0.03]},
        share=0.8,
    )
    creep = AdoptedEffect(name="creep", params={"gamma": 0.01, "tau_first_s": 0.1, "tau_last_s": 100.0})
    axis = built_in("xyz250").axis("x").model_copy(update={"effects": (creep, resonance)})
    before = built_in("xyz250").model_copy(update={"axes": {"x": axis}})
    after = changed(before, "x", {"effects.1.resonance.f_Hz.1": 640, "effects.0.creep.gamma": 0.02})
    found = {one.name: one for one in after.axis("x").effects}
    assert found["resonance"].params == {"f_Hz": (200.0, 640.0), "zeta": 0.02}
    assert (set(found["resonance"].ci95), found["resonance"].share) == ({"zeta"}, None)
    assert found["creep"].params["gamma"] == 0.02
    less = changed(before, "x", {"effects.0.creep": None, "effects.1.resonance.zeta": 0.03})
    assert [(one.name, one.params["zeta"]) for one in less.axis("x").effects] == [("resonance", 0.03)]
    assert before.axis("x").effects == (creep, resonance)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"limits.u_max_V": -5}, "u_max_V"),
        ({"limits.u_max_V": "8"}, "must be a number"),
        ({"limits.u_max_V": None, "limits.u_min_V": 50}, "u_max_V"),
        ({"limits.nothing": 1}, "limits.nothing: is no setting"),
        ({"effects.name": 1}, "effects.name: is no effect"),
        ({"effects.0.resonance.f_Hz": 190}, "effects.0.resonance.f_Hz: is no effect"),
        ({"effects.1.resonance.f_Hz": 1}, "resonance.f_Hz = 1: must be 10 to 5000"),
        ({"effects.1.resonance.f_Hz": "190"}, "must be a number"),
        ({"effects.1.resonance.f_Hz": None}, "must be a number"),
        ({"effects.1.resonance.q": 1}, "resonance.q: is no number of this effect"),
        ({"effects.1.resonance": 1}, "an effect is removed, or its numbers are given"),
        ({"effects.0.creep.tau_s.0": 0}, "creep.tau_s.0 = 0: must be at least"),
        ({"filters.2.poles_Hz": 500}, "filters.2.poles_Hz: is no setting"),
        ({"filters.0.poles_Hz": 500}, "filters[0].poles_zeta: missing key"),
        ({"filters.0.poles_Hz": 5000, "filters.0.poles_zeta": 0.7}, "must be at most 2250"),
        ({"filters.0.poles_Hz": "500", "filters.0.poles_zeta": 0.7}, "must be a number"),
        ({"gains.filters": None}, "is no setting"),
        ({}, "nothing was changed"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(values, said):
    with pytest.raises(BadInput, match=re.escape(said)):
        changed(built_in("xyz250"), "x", values)


def test_they_are_uploaded_and_kept(make_rig, tmp_path):
    rig = make_rig(stage=built_in("xyz250"))
    tab = rig.open()
    tab.until(lambda: tab.state.get("settings"))
    assert "stage file" in tab.order("settings", axis="x", values={"limits.u_max_V": 7.5})
    tab.until(lambda: any(row["value"] == 7.5 for row in tab.state["settings"]["x"]))
    (kept,) = tmp_path.glob("settings-*.toml")
    assert load_stage(kept).axis("x").limits.u_max_V == 7.5
    assert rig.hub.dev.model.axis("x").limits.u_max_V == 7.5
    assert "u_max_V" in tab.refused("settings", axis="x", values={"limits.u_max_V": -5})


def test_hard_limits_go_to_the_device_alone(rig, tmp_path):
    tab = rig.open()
    tab.until(lambda: tab.state.get("settings"))
    assert {row["part"] for row in tab.state["settings"]["x"]} == {"hard"}
    tab.order("settings", axis="x", values={"hard.u_min_V": -1, "hard.u_max_V": 8})
    tab.order("settings", axis="x", values={"hard.u_min_V": None})
    found = rig.hub.dev.limits()["x"]
    assert found.u_max_V == pytest.approx(8, abs=1e-3)
    assert found.u_min_V is None
    tab.until(lambda: any(row["name"] == "u_max_V" and row["value"] for row in tab.state["settings"]["x"]))
    assert "leave out 0 V" in tab.refused("settings", axis="x", values={"hard.u_max_V": -5})
    assert "must be a number" in tab.refused("settings", axis="x", values={"hard.u_max_V": "8"})
    assert "is no hard limit" in tab.refused("settings", axis="x", values={"hard.nothing": 8})
    assert list(tmp_path.iterdir()) == []


def test_of_both_none_is_changed_where_one_makes_no_sense(make_rig):
    rig = make_rig(stage=built_in("xyz250"))
    tab = rig.open()
    assert "u_max_V" in tab.refused("settings", axis="x", values={"hard.u_max_V": 8, "limits.u_max_V": -5})
    assert rig.hub.dev.limits()["x"].u_max_V is None


def test_they_wait_until_it_is_parked(make_rig):
    tab = make_rig(stage=built_in("xyz250")).open()
    tab.order("arm")
    assert "park it first" in tab.refused("settings", axis="x", values={"limits.u_max_V": 7.5})


def test_without_a_stage_file_there_are_none(rig):
    assert "upload one" in rig.open().refused("settings", axis="x", values={"limits.u_max_V": 7.5})
