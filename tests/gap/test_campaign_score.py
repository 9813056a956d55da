"""How a campaign scores answers, and that its figures follow from them."""

from __future__ import annotations

import pytest

from phaselead.errors import BadInput
from phaselead.model.effects import catalogue
from phaselead.validation import score
from phaselead.validation.summary import accuracy_coverage, by_size, confusion, numbers, summary
from phaselead.validation.table import BEGIN, END, markdown, reached, write_table


def outcome(kind="single", hidden=("delay",), named=(), ties=(), size=1.0, **more):
    """An answer; sizes are in units of the typical, which is 1 here."""
    found = {
        "case": f"set/{kind}/{'+'.join(hidden)}/{size:g}/{more.pop('number', 0)}",
        "kind": kind,
        "hidden": [{"name": n, "size": size, "value": size, "unit": unit_of(n), "axis": None} for n in hidden],
        "without": list(hidden) if kind == "removed" else [],
        "error": None,
        "verdicts": ["named"] if named else ["tie"] if ties else ["none"],
        "named": list(named),
        "scores": dict.fromkeys(named, 50.0),
        "ties": [list(t) for t in ties],
        "excluded": [],
        "untestable": [],
        "gap": {"before": 1.0, "after": 0.1, "floor": 0.1},
        "seconds": 10.0,
        "cpu_seconds": 10.0,
        "rows": 100_000,
    }
    return found | more


def unit_of(name):
    sizes = catalogue()[name].sizes if name in catalogue() else ()
    return sizes[0].unit if sizes else "1"


def test_rivals_are_mutual_and_never_oneself():
    for name in catalogue():
        rivals = score.honest_rivals(name)
        assert name not in rivals
        assert all(name in score.honest_rivals(other) for other in rivals)


@pytest.mark.parametrize(
    ("named", "ties", "worth"),
    [
        (["delay"], [], 1.0),
        ([], [["delay", "sensor_lowpass"]], 0.5),
        ([], [["delay", "sensor_lowpass", "amplifier_lowpass"]], 1 / 3),
        ([], [["delay", "creep"]], 0.0),  # creep is no honest rival of a delay
        (["creep"], [], 0.0),
        (["delay", "creep"], [], 0.0),  # something beside it
        ([], [], 0.0),
    ],
)
def test_what_an_answer_is_worth(named, ties, worth):
    assert score.exactly_right(outcome(named=named, ties=ties)) == pytest.approx(worth)


def test_a_crash_is_a_wrong_answer_and_no_false_name():
    assert score.exactly_right(outcome(named=["delay"], error="ValueError: x")) == 0
    assert not score.false_names(outcome("none", hidden=(), named=["delay"], error="ValueError: x"))


def test_a_removed_effect_wants_abstention():
    assert score.abstained_honestly(outcome("removed", verdicts=["unknown"]))
    assert score.abstained_honestly(outcome("removed", ties=[["sensor_lowpass", "amplifier_lowpass"]]))
    assert not score.abstained_honestly(outcome("removed", named=["sensor_lowpass"]))
    assert not score.abstained_honestly(outcome("removed", verdicts=["none"]))
    assert not score.abstained_honestly(outcome("removed", named=["creep"], verdicts=["named", "unknown"]))


def test_without_references_whatever_is_claimed_is_there_and_none_is_true():
    def right(**more):
        return score.nothing_false(outcome("unreferenced", **more))

    assert right(named=["delay"])
    assert right(ties=[["delay", "sensor_lowpass"]])
    assert right(verdicts=["unknown"])
    assert right(hidden=())
    assert not right(hidden=(), named=["vibration"], verdicts=["named"])
    assert not right(named=["delay", "vibration"])
    assert not right(ties=[["creep", "sensor_lowpass"]])
    assert not right(error="broke")
    assert not right()
    assert right(untestable=["delay"])
    bound = {"name": "delay", "upper_95": 1.5, "unit": "s", "axis": None}
    assert right(excluded=[bound])
    assert not right(excluded=[{**bound, "upper_95": 0.5}])


def test_what_a_straight_line_lacks_may_be_named_and_is_never_nothing():
    lacks = {"hidden": (), "allowed": ["hysteresis", "resonance"]}
    assert score.nothing_false(outcome("straight", named=["hysteresis"], **lacks))
    assert not score.nothing_false(outcome("straight", named=["hysteresis", "creep"], **lacks))
    assert not score.nothing_false(outcome("straight", **lacks))
    rows = {
        row["what"]: (row["reached"], row["of"])
        for row in numbers([
            outcome("straight", named=["hysteresis"], **lacks),
            outcome("straight", named=["creep"], hidden=("delay",), allowed=["hysteresis"], number=1),
            outcome("unreferenced", named=["delay"], number=2),
        ])
    }  # fmt: skip
    assert rows["from a straight line: right, a tie with what is there, or unknown"] == (50.0, 2)
    assert rows["from a straight line: what is hidden named, or in an honest tie, 0.2 x and more"] == (0.0, 1)
    assert rows["without reference records: right, a tie with what is there, or unknown"] == (100.0, 1)
    assert rows["names that are given are right"] == (pytest.approx(200 / 3), 3)
    assert rows["from a straight line: names right, beside those that such stages have"] == (0.0, 1)


def test_of_what_the_stage_had_before_only_the_sum_could_be_found():
    """A delay of 1 on top of one of 2 is rightly found as 3."""
    sized = {"sizes": {"delay": (3.0, 2.8, 3.2)}, "named": ["delay"], "floor": None}
    missed = {"excluded": [{"name": "delay", "upper_95": 0.5, "unit": "s", "axis": None}]}
    for allowed, measured in ((["delay"], []), (["creep"], [False])):
        assert score.intervals_hold(outcome("straight", allowed=allowed, **sized)) == measured
        assert score.bounds_hold(outcome("straight", allowed=allowed, **missed)) == measured
    assert score.power_left(outcome("straight", allowed=["creep"], **sized)) is None
    assert score.power_left(outcome("straight", allowed=["creep"], **{**sized, "floor": 0.1})) == 0.0
    rows = {row["what"]: row["of"] for row in numbers([outcome("straight", allowed=["delay"], **sized)])}
    assert rows["from a straight line: what is hidden named, or in an honest tie, 0.2 x and more"] == 0


def test_a_system_outside_the_catalogue_wants_no_name_and_no_none():
    def answered(**more):
        return score.outside_honestly(outcome("outside", hidden=(), **more))

    assert answered(verdicts=["unknown"])
    assert answered(ties=[["creep", "delay"]])
    assert not answered(verdicts=["none"])
    assert not answered(named=["creep"])
    assert not answered(named=["creep"], verdicts=["named", "unknown"])
    assert answered(named=["backlash"], allowed=["backlash"])
    assert not answered(named=["backlash", "creep"], allowed=["backlash"])
    assert not answered(verdicts=["unknown"], error="ValueError: x")


def test_several_effects():
    both = ("delay", "creep")
    assert score.all_named(outcome("pair", both, named=both))
    assert score.all_named(outcome("pair", both, named=["creep"], ties=[["delay", "sensor_lowpass"]]))
    assert not score.all_named(outcome("pair", both, named=["creep"]))
    assert not score.all_named(outcome("pair", ("delay", "sensor_lowpass"), ties=[["delay", "sensor_lowpass"]]))
    assert score.spurious(outcome("pair", both, named=[*both, "saturation"])) == [["saturation"]]


def test_power_left_counts_from_the_floor():
    assert score.power_left(outcome(gap={"before": 1.0, "after": 0.2, "floor": 0.1})) == pytest.approx(0.03 / 0.99)
    assert score.power_left(outcome(gap={"before": 1.0, "after": 0.05, "floor": 0.1})) == 0
    assert score.power_left(outcome(gap={"before": 0.1, "after": 0.1, "floor": 0.1})) is None
    known = outcome(gap={"before": 1.0, "after": 0.2, "floor": 0.1}, floor=0.2)
    assert score.power_left(known) == 0


def test_a_bound_must_hold_the_size_of_what_was_missed():
    bound = [{"name": "delay", "upper_95": 0.5, "unit": "s", "axis": None}]
    assert score.bounds_hold(outcome(size=0.2, excluded=bound)) == [True]
    assert score.bounds_hold(outcome(size=1.0, excluded=bound)) == [False]
    assert score.bounds_hold(outcome(size=1.0, named=["delay"], excluded=bound)) == []
    assert score.bounds_hold(outcome(size=1.0)) == []


def test_a_tie_is_resolved_by_the_name_of_the_truth_alone():
    tie = ["delay", "sensor_lowpass"]
    after = {"tie": tie, "named": ["delay"], "ties": []}
    assert score.resolved(outcome(ties=[tie], after_next=after)) is True
    assert score.resolved(outcome(ties=[tie], after_next=after | {"named": []})) is False
    assert score.resolved(outcome(ties=[tie], after_next=after | {"named": tie})) is False
    assert score.resolved(outcome(ties=[tie], after_next=None)) is None
    assert score.resolved(outcome(hidden=("creep",), ties=[tie], after_next=after)) is None


def test_of_a_tie_it_is_kept_what_was_promised_and_whether_a_sensor_was_asked_for():
    tie, after = ["delay", "sensor_lowpass"], {"tie": ["delay", "sensor_lowpass"], "named": ["delay"], "ties": []}
    promised = {"tie": tie, "waveform": "steps", "chance": 0.8, "needs_sensor": None}
    told = outcome(ties=[tie], next=promised, after_next=after)
    asks = outcome(ties=[tie], next=promised | {"needs_sensor": "a camera", "chance": 0.1}, after_next=None)
    assert (score.stated_chance(told), score.needs_sensor(told)) == (0.8, False)
    assert (score.stated_chance(asks), score.needs_sensor(asks)) == (None, True)
    assert score.needs_sensor(outcome(hidden=("creep",), ties=[tie], next=promised)) is None
    older = outcome(ties=[tie], after_next=after)
    assert (score.stated_chance(older), score.needs_sensor(older)) == (None, None)
    reached = {row["what"]: (row["reached"], row["of"]) for row in numbers([told, asks, older])}
    assert reached["one proposed experiment resolves a tie"] == (100.0, 2)
    assert reached["mean of the chance that was stated there"] == (80.0, 1)
    assert reached["ties of the truth for which a sensor was asked, and no experiment"] == (50.0, 2)


def test_numbers_count_what_they_say():
    outcomes = [
        outcome(named=["delay"]),
        outcome(named=["creep"], number=1),
        outcome(named=[], size=0.05),
        outcome("none", hidden=()),
        outcome("none", hidden=(), named=["creep"], number=1),
        outcome("pair", ("delay", "creep"), named=["delay", "creep", "offset"]),
        outcome("outside", hidden=(), verdicts=["unknown"]),
        outcome("outside", hidden=(), verdicts=["none"], number=1),
    ]
    reached = {row["what"]: (row["reached"], row["of"]) for row in numbers(outcomes)}
    assert reached["names exactly right, one effect of 0.2 x its typical size and more"] == (50.0, 2)
    assert reached["the same at 0.05 x"] == (0.0, 1)
    assert reached["false names with nothing hidden"] == (1, 2)
    assert reached["both of a pair named"] == (100.0, 1)
    assert reached["a system outside the catalogue ends as unknown or a tie"] == (50.0, 2)
    assert reached["pairs with a spurious name beside them"] == (100.0, 1)
    assert reached["an effect left out of the catalogue ends as unknown or an honest tie"] == (None, 0)


def test_narrow_cases_count_for_ties_and_names_but_not_for_single_effects():
    tie = ["delay", "sensor_lowpass"]
    after = {"tie": tie, "named": ["delay"], "ties": []}
    outcomes = [
        outcome("narrow", ties=[tie], after_next=after),
        outcome("narrow", named=["delay"], number=1),
        outcome("narrow", named=["creep"], number=2),
        outcome("narrow", ties=[tie], named=["offset"], number=3),
        outcome("narrow", named=["delay"], size=0.05),
    ]
    found = summary(outcomes)
    reached = {row["what"]: (row["reached"], row["of"]) for row in found["numbers"]}
    alone = "one kind of excitation alone: the truth named, or in an honest tie, 0.2 x and more"
    assert reached[alone] == (50.0, 4)
    assert reached["one proposed experiment resolves a tie"] == (100.0, 1)
    assert reached["names that are given are right"] == (50.0, 4)
    assert reached["names exactly right, one effect of 0.2 x its typical size and more"] == (None, 0)
    assert reached["the same at 0.05 x"] == (None, 0)
    assert found["accuracy_by_size"] == {"mixed": {}, "sines": {}}
    assert (found["confusion"], found["accuracy_coverage"]) == ({}, [])
    assert [w["case"] for w in found["wrong"]] == ["set/narrow/delay/1/2", "set/narrow/delay/1/3"]


def test_an_interval_holds_the_true_size_of_either_sign():
    def holds(low, high):
        return score.intervals_hold(outcome(named=["delay"], sizes={"delay": [0.0, low, high]}))

    assert holds(0.9, 1.1) == [True]
    assert holds(-1.1, -0.9) == [True]
    assert holds(1.05, 1.1) == [False]
    assert score.intervals_hold(outcome(named=["creep"], sizes={"creep": [1.0, 0.0, 2.0]})) == []


def test_a_size_in_another_unit_is_not_compared():
    found = outcome(named=["delay"], sizes={"delay": [1.0, 0.9, 1.1]}, detectable={"delay": 0.25})
    found["hidden"][0]["unit"] = "per decade"
    assert score.intervals_hold(found) == []
    assert score.times_detectable(found) is None
    missed = outcome(excluded=[{"name": "delay", "upper_95": 2.0, "unit": "s", "axis": None}])
    missed["hidden"][0]["unit"] = "per decade"
    assert score.bounds_hold(missed) == []


def test_names_are_right_or_not_one_by_one():
    both = outcome("pair", ("delay", "creep"), named=["delay", "offset"], probability={"delay": 0.999, "offset": 0.99})
    assert score.names_right(both) == [True, False]
    assert score.stated_and_right(both) == [(0.999, True), (0.99, False)]
    assert score.names_right(outcome("outside", hidden=(), named=["backlash"], allowed=["backlash"])) == [True]
    assert score.names_right(outcome("removed", named=["delay"], without=["delay"])) == [False]


def test_sizes_count_in_what_was_stated_to_be_detectable():
    assert score.times_detectable(outcome(size=1.0, detectable={"delay": 0.25})) == pytest.approx(4.0)
    assert score.times_detectable(outcome(size=1.0, detectable={"creep": 0.25})) is None


def test_confusion_rows_hold_as_many_cases_as_were_tried():
    outcomes = [
        outcome(named=["delay"]),
        outcome(ties=[["delay", "sensor_lowpass"]]),
        outcome(error="x"),
        outcome(verdicts=["unknown"]),
    ]
    row = confusion(outcomes)["delay"]
    assert sum(row.values()) == pytest.approx(4)
    assert row == {"delay": 1.5, "sensor_lowpass": 0.5, "failed": 1.0, "unknown": 1.0}


def test_accuracy_by_size_and_by_coverage():
    outcomes = [outcome(named=["delay"], scores={"delay": 90.0}), outcome(named=["creep"], size=0.2)]
    assert by_size(outcomes)["delay"] == {"0.2": 0.0, "1": 1.0}
    curve = accuracy_coverage(outcomes)
    assert [(p["coverage"], p["accuracy"]) for p in curve] == [(0.5, 1.0), (1.0, 0.5)]


def test_sizes_drawn_at_will_are_gathered_by_half_decades():
    sizes = [0.031, 0.05, 0.06, 0.17, 0.2, 0.5, 0.6, 1.7, 1.8, 2.9]
    outcomes = [outcome(named=["delay"], size=size) for size in sizes]
    assert list(by_size(outcomes)["all"]) == ["0.03", "0.1", "0.3", "1", "3"]


def test_nearly_all_is_not_all():
    row = {"what": "", "target": "", "unit": "%", "of": 1000}
    shown = [reached({**row, "reached": value}) for value in (100.0, 99.66, 98.6, 2.46, 0.0)]
    assert shown == ["100 % (of 1000)", "99.7 % (of 1000)", "99 % (of 1000)", "2.5 % (of 1000)", "0 % (of 1000)"]


def test_the_table_goes_between_the_marks_and_nowhere_else(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    run = {"set": "tuning", "version": "1", "commit": "", "code": "ab", "cpu_hours": 0.1}
    result = {**summary([outcome(named=["delay"])]), "run": run}
    write_table(page, result)
    text = page.read_text()
    assert text.startswith(f"before\n{BEGIN}\n|")
    assert text.endswith(f"{END}\nafter\n")
    assert "old" not in text
    assert markdown(result) in text
    page.write_text("no marks")
    with pytest.raises(BadInput, match="needs one"):
        write_table(page, result)
