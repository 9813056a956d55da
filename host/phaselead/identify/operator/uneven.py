"""Whether the operator is another at some levels than at others: in its field, or in the weights of its plays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phaselead.identify.operator.bending import in_best_field
from phaselead.identify.operator.choosing import FINEST
from phaselead.identify.operator.records import Records, searched_from
from phaselead.identify.operator.session import SEARCH
from phaselead.identify.operator.solution import Solution
from phaselead.identify.operator.weighing import of_best_weights

SMALL_LOOP = (0.1, 0.5)
"""Of the largest swing, chosen: loops that tell a bend of the field or uneven weights, which make them wider at some
places than at others, from what else may make one loop uneven."""


def unevenly(records: Records, found: Solution, *, fading: bool = False) -> Records:
    """The records in the field, and with plays of the weights at each level, with which an operator and the modes of
    ``found`` leave least of them; as they are where neither pays, or none can be told.

    Both are looked for beside ``fading`` plays where the memory fades: loops that fade and loops that are wider at some
    levels hide each other.
    """
    if not _has_small_loops(records):
        return records
    beside = replace(records, beside_fading=fading)
    uneven = _either(beside, found)
    return records if uneven is beside else replace(uneven, beside_fading=False)


def _either(records: Records, found: Solution) -> Records:
    """First the one of the two that leaves less, then the other where it pays beside that: each may stand in for a part
    of the other."""
    field, weights = in_best_field(records, found), of_best_weights(records, found)
    if field is records:
        return weights if weights is records else in_best_field(weights, found)
    if weights is records:
        return of_best_weights(field, found)
    if _left(field, found) < _left(weights, found):
        return of_best_weights(field, found)
    return in_best_field(weights, found)


def _left(records: Records, found: Solution) -> float:
    """Relative error of an operator of the most plays and segments, at what goes with it from ``found`` on."""
    near = searched_from(records, replace(found, basis=records.basis(*SEARCH)))
    return records.at(records.basis(*FINEST), near.delay_s, near.rest_fraction, near.modes).error


def _has_small_loops(records: Records) -> bool:
    """Whether the voltage turns round in small swings, from turn to turn, at places that are apart by as much."""
    turns = [r.u_V[r.turning_rows] for r in records.runs]
    swings_V = np.concatenate([np.abs(np.diff(turned_V)) for turned_V in turns])
    middles_V = np.concatenate([(turned_V[1:] + turned_V[:-1]) / 2 for turned_V in turns])
    least, most = (share * float(swings_V.max(initial=0.0)) for share in SMALL_LOOP)
    small_V = middles_V[(swings_V > least) & (swings_V < most)]
    return bool(len(small_V) and np.ptp(small_V) > least)
