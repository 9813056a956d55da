"""A name that is withdrawn, since too much is left that the voltage predicts, counts nowhere as claimed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from test_gap_laws import HIDDEN, parts

from phaselead.gap import axis, effect_search, run
from phaselead.gap.findings import NAMED, WITHDRAWN
from phaselead.gap.scale import FarAbove
from phaselead.gap.unexplained import Unexplained
from phaselead.identify import fit
from phaselead.model import catalogue

KEPT = ("amplifier_lowpass", "delay", "gain_change")


@cache
def answer(withdraw: bool):
    """Of the axis of records that hide a delay, where a twentieth of what is left is said to follow the voltage."""
    reference, train, holdout = parts({"delay": HIDDEN["delay"]})
    without = [name for name in catalogue() if name not in KEPT]
    found = []

    def kept(*args):
        found.append(axis.search_axis(*args))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(axis, "unexplained", lambda *residuals, of_any_size: Unexplained(0.05, 1e-4))
        patch.setattr(axis, "too_much_for_names", lambda left, gap: withdraw)
        patch.setattr(run, "search_axis", kept)
        run.run_gap(fit(reference)[0], train, holdout, reference, without=without)
    return found[0]


def test_what_every_withdrawn_claim_was_for_is_still_there(monkeypatch):
    """The odds of a delay are sure. Where its name is given up, since held-out records were predicted better without
    it, something has no name: that is not nothing."""
    reference, train, holdout = parts({"delay": HIDDEN["delay"]})
    without = [name for name in catalogue() if name not in KEPT]
    monkeypatch.setattr(effect_search, "_that_pay", lambda likelihood, entries, claims: ())
    monkeypatch.setattr(
        axis, "unexplained", lambda *residuals, of_any_size: Unexplained(0.0, 1.0)
    )  # which would say so, too
    found = run.run_gap(fit(reference)[0], train, holdout, reference, without=without)
    assert found.verdicts == ("unknown",)
    assert not found.effects
    (said,) = (line for line in found.messages if "no effect of the catalogue is sure to be it" in line)
    assert "nearest by the odds: delay" in said


@pytest.mark.parametrize("end", [False, True])
def test_no_name_where_what_predicts_best_is_at_the_end_of_what_is_known(monkeypatch, end):
    """The most likely parameters may be inside, and a sensor bend as far as sensors bend: that is no sensor."""
    reference, train, holdout = parts({"delay": HIDDEN["delay"]})
    without = [name for name in catalogue() if name not in KEPT]
    delay = catalogue()["delay"].as_known()
    (seconds,) = delay.parameters
    best, most = effect_search.best_predicting, 1.0 if end else 1.01
    found_s = []

    def watched(entries, covariance, runs, levelled):
        adopted = best(entries, covariance, runs, levelled)
        found_s.extend(params[seconds.name] for effect, params in adopted if effect.name == "delay")
        short = replace(delay, parameters=(replace(seconds, high=most * found_s[-1]),)) if found_s else delay
        return tuple((short, params) if effect.name == "delay" else (effect, params) for effect, params in adopted)

    monkeypatch.setattr(effect_search, "best_predicting", watched)
    found = run.run_gap(fit(reference)[0], train, holdout, reference, without=without)
    assert [one.name for one in found.effects] == ([] if end else ["delay"])
    assert found.verdicts == (("unknown",) if end else ("named",))


def test_beside_a_name_that_survives_so_little_is_not_unknown():
    found = answer(False)
    assert [one.name for one in found.effects] == ["delay"]
    assert not found.unknown
    assert found.unexplained.of_equations
    assert "delay" not in {one.name for one in found.excluded} | set(found.untestable)
    assert found.candidates[0].remark == NAMED


@pytest.mark.parametrize("asked", [False, True])
def test_a_name_beside_which_much_is_left_that_nothing_predicts_is_not_all(monkeypatch, asked):
    """Held-out records that wander by a few tenths of the gap, as nothing in the training records does."""
    reference, train, holdout = parts({"delay": HIDDEN["delay"]})
    without = [name for name in catalogue() if name not in KEPT]
    monkeypatch.setattr(axis, "unlike_others", lambda final: [])  # which would say so, too
    if not asked:
        nothing = FarAbove(0.0, "", 0.0, "any reference record")
        monkeypatch.setattr(axis, "far_above_known", lambda final, holdout: nothing)
    found = run.run_gap(fit(reference)[0], train, [_wandering(r) for r in holdout], reference, without=without)
    assert ("unknown" in found.verdicts) == asked
    assert "delay" in {one.name for one in found.effects} | {name for tie in found.ties for name in tie}
    assert any(said.endswith("look where it is, something else may be there") for said in found.messages) == asked


def _wandering(record):
    t_s = record.t_s - record.t_s[0]
    wander_um = 0.8 * np.sin(2 * np.pi * 1.3 * t_s) * np.sin(2 * np.pi * 0.48 * t_s + 1)
    axes = {name: replace(axis, x_um=axis.x_um + wander_um) for name, axis in record.axes.items()}
    return replace(record, axes=axes)


def test_a_withdrawn_name_closes_no_gap():
    found = answer(True)
    assert not found.effects
    assert found.unknown
    assert not found.unexplained.of_equations


def test_a_withdrawn_name_is_bounded_by_no_less_than_its_estimate():
    found = answer(True)
    bounds = {one.name: one.upper_95 for one in found.excluded}
    assert bounds["delay"] >= HIDDEN["delay"] if "delay" in bounds else "delay" in found.untestable


def test_a_withdrawn_name_is_adopted_once_and_provisionally():
    kept = [(one.name, one.status) for one in answer(True).adopted]
    assert kept.count(("delay", "provisional")) == 1
    assert not any(status == NAMED for _, status in kept)


def test_a_person_is_told_which_name_is_withdrawn():
    said = "delay would be named, but too much is left that the voltage predicts: it is not vouched for"
    assert answer(True).messages == [said]
    assert answer(False).messages == []


def test_the_table_of_candidates_says_that_it_is_withdrawn():
    found = answer(True)
    assert found.candidates[0].remark == WITHDRAWN
    assert found.next_experiment is None
