"""Whether the operator answers to a field that rises unevenly with the voltage."""

from __future__ import annotations

from dataclasses import replace

from scipy.optimize import minimize_scalar

from phaselead.identify.operator.choosing import FINEST
from phaselead.identify.operator.records import Records, searched_from
from phaselead.identify.operator.session import SEARCH
from phaselead.identify.operator.solution import PART_PAYS, Solution
from phaselead.model import LARGEST_BEND

TRIED = (-0.1, -0.02, 0.02, 0.1)
"""Bends tried first: where one explains most of what is left, the nearest of them gains a good part of that."""
ABOUT = 0.02
"""Within which the best bend of few plays is searched again with the most. One that comes so near to the largest is
none: more may be what is there."""
PRECISE = 1e-3
"""How finely the best one is searched: a thousandth of half the range."""
ROUNDS = 5
"""In which the bend and the operator that goes with it are searched in turn, at most."""


def in_best_field(records: Records, found: Solution) -> Records:
    """The records in the field in which an operator and the modes of ``found`` leave least of them; as they are where
    no bend pays.

    It is searched with few plays and segments, and judged with the most: what a bend makes up for where these lie
    wrong is no bend.
    """
    bent, even = records, found
    for _ in range(ROUNDS):
        bend = _best_bend(bent, found, SEARCH, _bounds(bent, found))
        if abs(bend - bent.field.bend) < PRECISE:
            break
        bent = records.in_field(bend)
        found = searched_from(bent, replace(found, basis=bent.basis(*SEARCH)))
    if not bent.field.bend:
        return records
    about = bent.field.bend - ABOUT, bent.field.bend + ABOUT
    bend = _best_bend(bent, found, FINEST, about)
    pays = _squares(records, found, FINEST, bend) < PART_PAYS * _squares(records, even, FINEST, 0.0)
    return records.in_field(bend) if pays and abs(bend) < LARGEST_BEND - ABOUT else records


def _bounds(records: Records, found: Solution) -> tuple[float, float]:
    """Between which the best bend lies; both 0 where none pays."""
    even = _squares(records, found, SEARCH, 0.0)
    tried = {bend: _squares(records, found, SEARCH, bend) for bend in TRIED}
    first = min(tried, key=tried.__getitem__)
    if not tried[first] < PART_PAYS * even:
        return 0.0, 0.0
    return (0.0, LARGEST_BEND) if first > 0 else (-LARGEST_BEND, 0.0)


def _best_bend(records: Records, found: Solution, size: tuple[int, int], bounds: tuple[float, float]) -> float:
    """Within the bounds, with so many plays and segments."""
    if bounds[0] == bounds[1]:
        return bounds[0]
    best = minimize_scalar(
        lambda bend: _squares(records, found, size, float(bend)),
        bounds=bounds,
        method="bounded",
        options={"xatol": PRECISE},
    )
    return float(best.x)


def _squares(records: Records, found: Solution, size: tuple[int, int], bend: float) -> float:
    """That an operator of so many plays and segments leaves, at the delay, memory at rest and modes of ``found``."""
    bent = records.in_field(bend)
    return bent.at(bent.basis(*size), found.delay_s, found.rest_fraction, found.modes).error ** 2
