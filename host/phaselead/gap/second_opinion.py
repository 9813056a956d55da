"""A second search without the effect that the first one began with.

The search names one effect after the other, and the one that explains most alone may be a stand-in for two that act
together: a mode for a load and a lag. Where plainly more is left than the reference records allow, the search is run
again without it, and the better explanation is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.gap.final import Final, finish
from phaselead.gap.grow import Growth, Progress, grow
from phaselead.gap.records import Run
from phaselead.gap.result import NAMED
from phaselead.gap.surplus import PLAINLY
from phaselead.model import AxisModel, Effect

LEFT = 0.5
"""Of the power that the first search left beyond the floor: a second one that leaves less is believed instead."""


def explained(
    model: AxisModel, runs: Sequence[Run], effects: Sequence[Effect], frozen: bool, on_progress: Progress
) -> tuple[Growth, Final]:
    """The search, or the second one where that explains the held-out records much better."""
    growth = grow(model, runs, effects, frozen, lambda share: on_progress(0.8 * share))
    final = finish(growth, runs)
    stand_in = _began_with(growth)
    if stand_in is None or growth.bench.reference is None or final.gap.after < PLAINLY * final.gap.floor:
        return growth, final
    others = [effect for effect in effects if effect.name != stand_in]
    again = grow(model, runs, others, frozen, lambda share: on_progress(0.8 + 0.2 * share))
    second = finish(again, runs)
    if not again.named or _surplus(second) > LEFT * _surplus(final):
        return growth, final
    names = " and ".join(n.effect.name for n in again.named)
    said = f"{stand_in} alone explains most, but {names} without it leave less of the held-out records"
    return replace(again, stood_in=stand_in, messages=[*again.messages, said]), second


def _began_with(growth: Growth) -> str | None:
    """The first that was named, though it may have been dropped since, or that came nearest to it."""
    names = [c.name for c in growth.candidates if c.remark == NAMED] or [c.name for c in growth.candidates]
    return names[0] if names else None


def _surplus(final: Final) -> float:
    return float(final.gap.after**2 - final.gap.floor**2)
