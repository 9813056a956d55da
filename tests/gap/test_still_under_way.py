"""Where much of what is left is what a slow effect still had under way when held-out records began, a line says so."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from phaselead.gap.axis import _still_under_way
from phaselead.gap.findings import GapSize
from phaselead.model import catalogue


def said(names, before, after, without):
    final = SimpleNamespace(gap=GapSize(before, after, 0.06), entries=tuple((catalogue()[n], {}) for n in names))
    return " ".join(_still_under_way(final, GapSize(before, without, 0.06)))


@pytest.mark.parametrize(
    ("name", "before", "after", "without", "further_off", "under_way"),
    [
        ("creep", 0.37, 0.43, 0.1, True, True),
        ("charge_leakage", 0.37, 0.43, 0.1, True, True),
        ("creep", 0.37, 0.43, 0.428, True, False),
        ("creep", 0.37, 0.371, 0.37, False, False),
        ("creep", 0.43, 0.37, 0.1, False, True),
        ("creep", 0.43, 0.1, 0.08, False, False),
        ("resonance", 0.37, 0.43, 0.1, False, False),
    ],
)
def test_only_what_is_slow_may_and_only_where_it_is_much(name, before, after, without, further_off, under_way):
    line = said([name], before, after, without)
    assert ("further off" in line) == further_off
    assert ("0.1 would be without" in line) == under_way
    assert (name in line) == bool(line)


def test_a_drift_has_nothing_under_way():
    line = said(["thermal_drift", "creep"], 0.43, 0.37, 0.1)
    assert "without what creep still had" in line
