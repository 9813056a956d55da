"""What the search does with an explanation that leaves too much: laws of the decisions, on searches made up."""

from __future__ import annotations

from types import SimpleNamespace as Made

import pytest
from phaselead.gap.comparison import Rival

from phaselead.gap import acceptance, axis, comparison, goodness_of_fit
from phaselead.gap.search import Selection
from phaselead.model.effects import effect

EFFECTS = [Made(name=name) for name in ("resonance", "load_change", "sensor_lowpass")]


def selection(*names, reference=True):
    """A search that named these, if any."""
    candidates = [Made(name="resonance", remark="too little"), *(Made(name=n, remark="named") for n in names)]
    named = [Made(effect=Made(name=n)) for n in names]
    return Selection(Made(reference=Made() if reference else None), None, None, named, candidates)


def final(after, floor=0.05, before=2.0):
    return Made(gap=Made(before=before, after=after, floor=floor))


def explained(monkeypatch, first, second, left):
    """The answer when the first search ends as ``first`` and one without its beginning as ``second``."""
    asked = []

    def select_effects(model, runs, effects, frozen, on_progress):
        asked.append([e.name for e in effects])
        return first if len(asked) == 1 else second

    monkeypatch.setattr(axis, "select_effects", select_effects)
    monkeypatch.setattr(axis, "final_fit", lambda found, runs: final(left[found is second]))
    found, _ = axis.search_twice(None, [], EFFECTS, False, lambda share: None)
    assert (found.substitute == "resonance") == (found.candidates is second.candidates)
    return [n.effect.name for n in found.named], asked


def test_two_effects_replace_the_one_that_stood_in_for_them(monkeypatch):
    first, second = selection("resonance"), selection("load_change", "sensor_lowpass")
    named, asked = explained(monkeypatch, first, second, (0.4, 0.06))
    assert named == ["load_change", "sensor_lowpass"]
    assert asked[1] == ["load_change", "sensor_lowpass"]


def test_where_nothing_was_named_what_came_nearest_is_left_out(monkeypatch):
    named, asked = explained(monkeypatch, selection(), selection("load_change", "sensor_lowpass"), (1.9, 0.06))
    assert named == ["load_change", "sensor_lowpass"]
    assert "resonance" not in asked[1]


@pytest.mark.parametrize(
    ("first", "second", "left", "searches"),
    [
        (selection("resonance"), selection("load_change"), (0.09, 0.05), 1),  # little is left: nobody else is asked
        (selection("resonance"), selection("load_change"), (0.4, 0.35), 2),  # hardly better
        (selection("resonance"), selection(), (0.4, 0.06), 2),  # names nothing
        (selection("resonance", reference=False), selection("load_change"), (0.4, 0.06), 1),  # no floor to go by
    ],
)
def test_otherwise_the_first_search_stands(monkeypatch, first, second, left, searches):
    named, asked = explained(monkeypatch, first, second, left)
    assert named == ["resonance"]
    assert len(asked) == searches


@pytest.mark.parametrize(
    ("after", "metric", "too_much"),
    [
        (0.09, (2.0, 1.9), False),  # within twice the floor, whatever the metric says
        (0.3, (2.0, 1.9), False),  # two per cent in um
        (1.0, (2.0, 1.9), True),  # a quarter in um, nine tenths in the metric
        (1.0, (20.0, 1.1), False),  # the metric is content: what was there when the records began
        (1.6, (20.0, 1.1), True),  # most of it is left in um
    ],
)
def test_names_that_leave_too_much_are_withdrawn(monkeypatch, after, metric, too_much):
    before, left = metric
    problem = Made(reference="reference", train_common="train", discrepancy=None)
    squares = {("reference", 0): 1.0, ("train", 0): before, ("train", 1): left}
    monkeypatch.setattr(
        goodness_of_fit,
        "_mean_squares",
        lambda regressors, discrepancy, entries: Made(mean=lambda: squares[regressors, len(entries)]),
    )
    search = Made(problem=problem, named=[Made(effect=effect("delay"))], fitted=Made(entries=("one",)))
    assert goodness_of_fit.names_leave_too_much(search, final(after)) is too_much
    slow = Made(problem=problem, named=[Made(effect=effect("creep"))], fitted=Made(entries=("one",)))
    assert goodness_of_fit.names_leave_too_much(slow, final(after)) is (
        too_much and left > 1.5
    )  # it began before the records


@pytest.mark.parametrize(("mass", "trifle"), [(-2.6e-5, True), (4e-4, True), (6e-4, False), (-0.1, False)])
def test_what_is_far_smaller_than_anything_known_is_no_name(mass, trifle):
    assert acceptance._negligible((effect("load_change"), {"mass": mass})) is trifle


@pytest.mark.parametrize(
    ("name", "reference", "z", "worse", "harms"),
    [
        ("gain_change", True, 40.0, 0.2, False),  # plainly there: another effect works against it
        ("gain_change", True, 5.0, 0.2, True),
        ("gain_change", False, 40.0, 0.2, True),  # nothing tells in the end whether the names explain it
        ("thermal_drift", True, 40.0, 0.2, True),
        ("gain_change", True, 5.0, 0.005, False),
    ],
)
def test_a_larger_held_out_gap_counts_against_a_name(name, reference, z, worse, harms):
    found = Made(best=Made(effect=effect(name)), problem=Made(reference=Made() if reference else None))
    assert acceptance._harms(found, Made(z=z, harm=worse)) is harms


def test_a_moving_base_takes_over_what_only_references_tell():
    whole = effect("sensor_nonlinearity")
    alone = whole.for_refitted_base()
    assert {p.name for p in whole.parameters} - {p.name for p in alone.parameters} == {"linear"}
    assert alone.complete({"quadratic": 0.1}) == whole.complete({"quadratic": 0.1})
    assert {p.name for p in effect("rate_dependence").for_refitted_base().parameters} == {
        "growth", "onset_per_s", "reach"
    }  # fmt: skip


def rivals(*scored):
    """Of a contest, best first."""
    return [Rival(effect(name), None, score, 0.0) for name, score in scored]


@pytest.mark.parametrize(
    ("scored", "first"),
    [
        ((("resonance", 14000.0), ("load_change", 13800.0)), "load_change"),
        ((("resonance", 14000.0), ("load_change", 12000.0)), "resonance"),  # plainly less
        ((("resonance", 1400.0), ("load_change", 1390.0)), "resonance"),  # little is gained: a tie, if anything
        ((("resonance", 14000.0), ("gain_change", 13900.0)), "resonance"),  # nobody confuses these
        ((("load_change", 14000.0), ("resonance", 13900.0)), "load_change"),
    ],
)
def test_where_a_simpler_effect_says_nearly_all_of_it_the_richer_one_follows_the_rest(scored, first):
    found = comparison._simple_first(rivals(*scored))
    assert found[0].effect.name == first
    assert (len(found) < len(scored)) == (first != scored[0][0])  # the richer one is no rival any more


def test_what_explains_nearly_as_much_alone_must_gain_as_much_as_what_is_confused_with_it():
    alone = rivals(("hysteresis", 40000.0), ("gain_change", 30000.0), ("saturation", 1000.0))
    named = [acceptance.Named(alone[0].effect, alone[0].score, None, tuple(alone), ("hysteresis",))]
    near = acceptance.cost(named, effect("backlash"))
    assert acceptance.cost(named, effect("gain_change")) == near > 10 * acceptance.cost(named, effect("saturation"))
