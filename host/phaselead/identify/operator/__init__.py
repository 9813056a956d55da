"""The time view of one axis: reversible slopes, plays, delay and memory fitted to records."""

from __future__ import annotations

from phaselead.identify.operator.creep import Creep
from phaselead.identify.operator.fitting import fit_linear, fit_operator, place_operator
from phaselead.identify.operator.regressors import Turns, fitted_span_V, play_thresholds
from phaselead.identify.operator.result import OperatorFit, amounts_before, apart_from, effective_rows
from phaselead.identify.operator.solution import PART_PAYS
from phaselead.identify.operator.starting_memories import starting_memory, way_before
from phaselead.identify.operator.symmetric_plays import fit_plays
from phaselead.identify.operator.telling_creep import apart_from_before, creep_beside

__all__ = [
    "PART_PAYS",
    "Creep",
    "OperatorFit",
    "Turns",
    "amounts_before",
    "apart_from",
    "apart_from_before",
    "creep_beside",
    "effective_rows",
    "fit_linear",
    "fit_operator",
    "fit_plays",
    "fitted_span_V",
    "place_operator",
    "play_thresholds",
    "starting_memory",
    "way_before",
]
