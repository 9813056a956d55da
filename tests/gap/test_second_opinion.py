"""What the search does with an explanation that leaves too much: laws of the decisions, on searches made up."""

from __future__ import annotations

from types import SimpleNamespace as Made

import pytest

from phaselead.gap import second_opinion, surplus

EFFECTS = [Made(name=name) for name in ("resonance", "load_change", "sensor_lowpass")]


def growth(*names, reference=True):
    """A search that named these."""
    return made_replaceable(
        named=[Made(effect=Made(name=n)) for n in names],
        candidates=[Made(name="resonance")],
        messages=[],
        bench=Made(reference=Made() if reference else None),
    )


def made_replaceable(**fields):
    from phaselead.gap.grow import Growth

    return Growth(fields["bench"], None, None, fields["named"], fields["candidates"], messages=fields["messages"])


def final(after, floor=0.05, before=2.0):
    return Made(gap=Made(before=before, after=after, floor=floor))


def explained(monkeypatch, first, second, left):
    """The answer when the first search ends as ``first`` and one without its beginning as ``second``."""
    asked = []

    def grow(model, runs, effects, frozen, on_progress):
        asked.append([e.name for e in effects])
        return first if len(asked) == 1 else second

    monkeypatch.setattr(second_opinion, "grow", grow)
    monkeypatch.setattr(second_opinion, "finish", lambda found, runs: final(left[found is second]))
    found, _ = second_opinion.explained(None, [], EFFECTS, False, lambda share: None)
    return [n.effect.name for n in found.named], asked


def test_two_effects_replace_the_one_that_stood_in_for_them(monkeypatch):
    first, second = growth("resonance"), growth("load_change", "sensor_lowpass")
    named, asked = explained(monkeypatch, first, second, (0.4, 0.06))
    assert named == ["load_change", "sensor_lowpass"]
    assert asked[1] == ["load_change", "sensor_lowpass"]


@pytest.mark.parametrize(
    ("first", "second", "left", "searches"),
    [
        (growth("resonance"), growth("load_change"), (0.09, 0.05), 1),  # little is left: nobody else is asked
        (growth("resonance"), growth("load_change"), (0.4, 0.35), 2),  # hardly better
        (growth("resonance"), growth(), (0.4, 0.06), 2),  # names nothing
        (growth("resonance", reference=False), growth("load_change"), (0.4, 0.06), 1),  # no floor to go by
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
    bench = Made(reference="reference", slim="train", correction=None)
    squares = {("reference", 0): 1.0, ("train", 0): before, ("train", 1): left}
    monkeypatch.setattr(
        surplus, "_mean_squares", lambda panel, correction, entries: Made(mean=lambda: squares[panel, len(entries)])
    )
    search = Made(bench=bench, named=["one"], fitted=Made(entries=("one",)))
    assert surplus.leaves_too_much(search, final(after)) is too_much
