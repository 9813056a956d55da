"""How much equations and base may miss: no stage obeys an equation exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.parameters import SizedEffect
from phaselead.model import Place
from phaselead.record import Samples

SHARES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0)
"""Of an effect that its equation may miss."""
LEAST_OF_MATERIAL = 0.05
"""Share that is missed at least by an equation of the ceramic itself, of its loops and its creep: published operators,
fitted to one stage, leave 1 to 3 % of the travel where loops are 10 to 20 % of it (Ge and Jouaneh 1995, Kuhnen
2003)."""
MOST_MISSED = 0.3
"""Share of an effect that may be missed by an equation which still bears its name: it then describes nine tenths of its
power."""
OUTSIDE = 0.1
"""Prior probability that more is missed: that the effect is none of the catalogue, and this one only the nearest."""
TIMES_BASE = (0.5, 1.0, 2.0, 4.0)
"""Factors, in um and not in power, between what the base misses in one record and what the references say, all as
likely."""


def is_of_material(entries: Sequence[SizedEffect]) -> NDArray[np.bool_]:
    """Of each of some effects whether it is of the ceramic's loops or creep."""
    return np.array([effect.place in (Place.HYSTERESIS, Place.CREEP) for effect, _ in entries], dtype=bool)


def missed_um2(share: Samples | float, signal: Samples, of_material: Samples) -> Samples:
    """Power (blocks,) that the equations miss of what effects add, of which a part is of the ceramic."""
    return np.asarray(share**2 * signal + np.maximum(LEAST_OF_MATERIAL**2 - share**2, 0.0) * of_material)


def may_be_missed_um2(base: Samples, gap: Samples) -> Samples:
    """Power (blocks,) that is missed of a base and of a gap by equations that only just bear their names."""
    return np.asarray(base + MOST_MISSED**2 * gap)


def shares_of(entries: Sequence[SizedEffect]) -> list[float]:
    """The shares that the equations of some effects may miss."""
    return list(SHARES if entries else SHARES[:1])


def beside_one_another(one: float, other: float) -> bool:
    """Whether shares are next to one another on the grid."""
    return abs(SHARES.index(one) - SHARES.index(other)) == 1


def log_prior_of_share(entries: Sequence[SizedEffect], share: float) -> float:
    """Of a share that the equations of some effects miss."""
    within = sum(one <= MOST_MISSED for one in SHARES)
    of_share = (1 - OUTSIDE) / within if share <= MOST_MISSED else OUTSIDE / (len(SHARES) - within)
    return float(np.log(of_share)) if entries else 0.0
