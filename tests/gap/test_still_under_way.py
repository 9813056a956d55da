"""Where much of what is left is what a slow effect still had under way when held-out records began, a line says so."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from phaselead.gap.axis import _still_under_way
from phaselead.gap.findings import GapSize
from phaselead.model import catalogue


@pytest.mark.parametrize(
    ("name", "before", "after", "without", "said"),
    [
        ("creep", 0.37, 0.43, 0.1, "further off"),
        ("charge_leakage", 0.37, 0.43, 0.1, "further off"),
        ("creep", 0.43, 0.37, 0.1, "0.1 um would be left"),
        ("creep", 0.43, 0.1, 0.08, None),
        ("resonance", 0.37, 0.43, 0.1, None),
    ],
)
def test_only_what_is_slow_may_and_only_where_it_is_much(name, before, after, without, said):
    gap = GapSize(before, after, 0.06)
    apart = SimpleNamespace(gap=GapSize(before, without, 0.06))
    final = SimpleNamespace(gap=gap, entries=((catalogue()[name], {}),), without_history=lambda: apart)
    lines = _still_under_way(final)
    assert len(lines) == (said is not None)
    assert all(said in line and name in line for line in lines)
    assert all(("further off" in line) == (after > before) for line in lines)
