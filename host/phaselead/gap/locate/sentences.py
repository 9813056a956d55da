"""Cells of a residual and bounds on effects in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import Bound, Cell, NamedEffect
from phaselead.gap.locate.cells import AMPLITUDE, AXIS, DIRECTION, FREQUENCY, HARMONIC, STEP
from phaselead.gap.locate.steps import ALL
from phaselead.model import catalogue

HEADLINE_SHARE = 0.25
"""Of the unexplained power, from which a cell may be the headline."""
CELL_KINDS = (HARMONIC, FREQUENCY, STEP, AXIS, AMPLITUDE, DIRECTION)
"""Kinds of cells, the one that points at a cause most directly first."""

DIRECTION_WORDS = {
    "rising": "occurs while the voltage rises",
    "falling": "occurs while the voltage falls",
    "still": "occurs while the voltage is constant",
}
# Where the residual lies, never why: the effect that the words would name may be one that the records cannot test.
ORDER_WORDS = {
    "1": "is at the frequency of the drive: motion of another size or phase than predicted",
    "2": "is at the second harmonic of the drive: one half of the loop differs from the other",
    "3": "is at the third harmonic of the drive: both halves of the loop are wrong in the same way",
}


def sentence_of(by: str, cell: str, share: float) -> str:
    """One cell, of kind ``by`` with this share of the power, as a sentence without its full stop."""
    words = {
        FREQUENCY: f"lies between {_words(cell)}",
        AMPLITUDE: f"occurs while the voltage is between {_words(cell)}",
        STEP: f"comes {_words(cell, ' to ')} after a step",
        DIRECTION: DIRECTION_WORDS.get(cell, ""),
        HARMONIC: ORDER_WORDS.get(cell, f"is at harmonic {cell} of the drive"),
        AXIS: f"is on axis {cell}",
    }[by]
    return f"{100 * share:.0f} % of the unexplained power {words}"


def unit_of(unit: str) -> str:
    """A unit as it is printed: empty for a plain number."""
    return "" if unit == "1" else unit


def percent(share: float) -> str:
    """A share of the power in per cent; a small one is never printed as 0."""
    return "less than 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def explained(effect: NamedEffect) -> str:
    """How much of the gap a named effect explains, in words."""
    known = catalogue().get(effect.name)
    if known is not None and known.moves_zero == "at once":
        return "none of the gap, which is about each record's own mean"
    return f"{percent(effect.share)} of the unexplained power"


def typical_of(bound: Bound) -> float | None:
    """The typical size of the bounded effect in the unit of the bound; None where the catalogue has none."""
    entry = catalogue().get(bound.name)
    return next((p.typical for p in entry.sizes if p.unit == bound.unit), None) if entry else None


def excludes(bound: Bound) -> bool:
    """Whether the bound excludes the effect at its typical size; otherwise it may be present after all."""
    typical = typical_of(bound)
    return typical is None or bound.upper_95 <= typical


def headline(cells: Sequence[Cell]) -> str | None:
    """The sentence of the cell that says most: it stands out, holds a good part of the power, and is of the kind that
    points at a cause most directly. None where no cell does."""
    telling = [c for c in cells if c.p <= ERROR_RATE and c.share >= HEADLINE_SHARE]
    if not telling:
        return None
    return min(telling, key=lambda c: (c.cell != ALL, CELL_KINDS.index(c.by), -c.share)).sentence


def _words(cell: str, between: str = " and ") -> str:
    return cell.replace("..", between)
