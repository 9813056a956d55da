"""About which zero residuals are compared: of each record its own, or one for all where what moves it is asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples


def standing_together(entries: Sequence[SizedEffect], runs: Sequence[ModelledRun], levelled: bool) -> list[bool]:
    """Of each run whether it is compared about the zero of all: driven ones, where an effect moves the zero and their
    levels say something (``levelled``)."""
    moves = levelled and any(effect.moves_zero is not None for effect, _ in entries)
    return [moves and not one.run.idle for one in runs]


def about_their_zero(columns: Sequence[Samples], together: Sequence[bool]) -> list[Samples]:
    """Columns (n, k) or (n,) of each run about their mean in it, and of those that stand ``together`` about that in all
    these."""
    standing = [one for one, of_all in zip(columns, together, strict=True) if of_all]
    zero = np.concatenate(standing).mean(axis=0) if standing else 0.0
    pairs = zip(columns, together, strict=True)
    return [one - (zero if of_all else one.mean(axis=0)) for one, of_all in pairs]
