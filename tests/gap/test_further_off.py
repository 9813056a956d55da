"""Where held-out records are further off with a slow effect that is there, a line says why."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from phaselead.gap.axis import _if_further_off
from phaselead.gap.findings import GapSize
from phaselead.model import catalogue


@pytest.mark.parametrize(
    ("name", "before", "after", "said"),
    [
        ("creep", 0.37, 0.43, True),
        ("charge_leakage", 0.37, 0.43, True),
        ("creep", 0.43, 0.37, False),
        ("creep", 0.37, 0.371, False),
        ("resonance", 0.37, 0.43, False),
    ],
)
def test_only_what_is_slow_may_and_only_where_it_does(name, before, after, said):
    final = SimpleNamespace(gap=GapSize(before, after, 0.06), entries=((catalogue()[name], {}),))
    lines = _if_further_off(final)
    assert [name in line for line in lines] == [True] * said
