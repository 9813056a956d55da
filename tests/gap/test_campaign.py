"""A small fixed slice of the blind trial, on short records of tuning stages: large effects are named, and adopting them
closes the held-out gap. `make campaign` runs the whole of it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from phaselead.validation import score
from phaselead.validation.trial import try_case
from phaselead.validation.truth import load_truth
from trials import in_trials

FOLDER = str(Path(__file__).parent / "truth")
UNIT_ROWS = 1200


@pytest.fixture(autouse=True)
def short_records(monkeypatch):
    load_truth(FOLDER)
    monkeypatch.setattr(sys.modules["phaselead_truth.sessions"], "UNIT_ROWS", UNIT_ROWS)


def tried(name):
    outcome = try_case(FOLDER, name, follow_up=False)
    assert outcome["error"] is None
    return outcome


def test_nothing_hidden_nothing_named():
    outcome = tried("tuning/none/nothing/0/slow/3")
    assert outcome["verdicts"] == ["none"]
    assert outcome["excluded"]
    assert outcome["gap"]["before"] == pytest.approx(outcome["floor"])


@pytest.mark.parametrize(
    ("case", "left"),
    [
        ("tuning/single/gain_change/1/slow/1", 0.05),
        *in_trials(("tuning/single/delay/1/fast/0", 0.05), ("tuning/single/charge_leakage/1/slow/0", 0.15)),
    ],
)
def test_a_large_effect_is_named_and_its_gap_closed(case, left):
    outcome = tried(case)
    (truth,) = score.hidden_names(outcome)
    assert truth in outcome["named"]
    assert score.power_left(outcome) < left


@pytest.mark.trial
def test_both_of_a_pair_are_named_though_a_third_could_stand_in_for_them():
    outcome = tried("tuning/pair/load_change+sensor_lowpass/1/fast/0")
    assert sorted(outcome["named"]) == ["load_change", "sensor_lowpass"]
    assert score.power_left(outcome) < 0.02


def test_hum_is_named_though_no_voltage_predicts_it():
    assert tried("tuning/single/mains_hum/1/slow/1")["named"] == ["mains_hum"]


@pytest.mark.trial
def test_what_is_not_in_the_catalogue_is_not_given_its_name():
    outcome = tried("tuning/removed/gain_change/1/slow/1")
    assert "gain_change" not in outcome["named"]
