"""Whether plays weigh the same at all levels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from phaselead.identify.gauss_newton import ridged
from phaselead.identify.operator.choosing import FINEST
from phaselead.identify.operator.records import Records, searched_from
from phaselead.identify.operator.regressors import Basis, FitRun
from phaselead.identify.operator.session import SEARCH
from phaselead.identify.operator.solution import (
    DELAY_STEP,
    PART_PAYS,
    SLOPES_RIDGE,
    Solution,
    linearised,
    moments_of,
    of_records,
    solve_slopes,
    together,
)
from phaselead.model import MOST_UNEVEN
from phaselead.record import Samples

FIRST_STEP = 0.1
"""Of the search, for tilt and taper."""
PRECISE = 1e-3
"""How finely the best ones are searched: a thousandth of the weight in the middle."""
SETTLED = 0.01
"""Change of both together from which on they are not searched again."""
ROUNDS = 5
"""In which the weights and what goes with them are searched in turn, at most."""
CLEAR_OF_MOST = 0.95
"""Of the most that is allowed: weights that come nearer are none, as more may be what is there."""


def of_best_weights(records: Records, found: Solution) -> Records:
    """The records with plays of the weights at each level with which an operator of the most plays and segments leaves
    least of them; as they are where uneven weights do not pay, or nothing tells them. Delay, memory at rest and modes
    go with the weights, and are searched in turn from those of ``found``."""
    try:
        return _weighed(records, found)
    except np.linalg.LinAlgError:
        return records


def _weighed(records: Records, found: Solution) -> Records:
    uneven, squares = records, _Squares(records, found)
    without = squares.left((0.0, 0.0))
    for _ in range(ROUNDS):
        best = squares.best((uneven.tilt, uneven.taper))
        moved = float(np.abs(best - (uneven.tilt, uneven.taper)).sum())
        uneven = uneven.weighing(*best.tolist())
        if moved < SETTLED:
            break
        found = searched_from(uneven, replace(found, basis=uneven.basis(*SEARCH)))
        squares = _Squares(uneven, found)
    pays = squares.left((uneven.tilt, uneven.taper)) < PART_PAYS * without
    return uneven if pays and abs(uneven.tilt) + abs(uneven.taper) < CLEAR_OF_MOST * MOST_UNEVEN else records


class _Squares:
    """What is left of records for any weights: the columns of plays are a sum of three, the even ones and what tilt and
    taper add to these, so that all moments follow from one set. Delay, memory at rest and modes give way, in proportion
    to small changes of what was found: of another memory at rest plays seem to weigh less at one end."""

    def __init__(self, records: Records, found: Solution) -> None:
        bases = [records.weighing(*weights).basis(*FINEST) for weights in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
        self._segments, self._width = bases[0].n_segments, bases[0].size + 2
        self._plays = slice(self._segments, self._segments + bases[0].n_plays)
        about = records.at(records.basis(*FINEST), found.delay_s, found.rest_fraction, found.modes)
        giving_way = 2 + 3 * len(found.modes)
        step_s = DELAY_STEP * min(f.run.step_s for f in records.fits)

        def columns() -> Iterator[Samples]:
            for f in records.fits:
                even, tilted, tapered = (self._columns(f, basis, about) for basis in bases)
                more = [(one - even)[:, self._plays] for one in (tilted, tapered)]
                changes = linearised(f, about, step_s)[:, -2 - giving_way : -2]
                yield np.hstack([changes, even[:, :-2], *more, even[:, -2:]])

        size = giving_way + self._width + 2 * bases[0].n_plays
        moments = together(of_records(records.fits, moments_of(records.fits, columns(), size)), records.offset_weight)
        self._moments = _without_first(moments, giving_way)
        self._moments[-2, -2] = 1.0  # all are about their means: a unit in place of the offset

    @staticmethod
    def _columns(fit: FitRun, basis: Basis, at: Solution) -> Samples:
        room = np.empty((len(fit.rows), basis.size + 2))
        fit.fill(room, at.delay_s, basis, at.rest_fraction, basis.in_C(at.rest_fraction), at.modes)
        return room

    def best(self, first: tuple[float, float]) -> Samples:
        """Tilt and taper (2,) that leave least, searched from ``first``."""
        simplex = np.array(first) + FIRST_STEP * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"initial_simplex": simplex, "xatol": PRECISE, "fatol": np.inf}
        return np.asarray(minimize(self.left, first, method="Nelder-Mead", options=options).x)

    def left(self, weights: Samples | tuple[float, float]) -> float:
        """Relative square error with a tilt and a taper; inf beyond what is allowed."""
        tilt, taper = weights
        if abs(tilt) + abs(taper) > MOST_UNEVEN:
            return float(np.inf)
        each = np.eye(self._width)
        plays = each[self._plays]
        mixed = np.vstack([each[:-2], tilt * plays, taper * plays, each[-2:]])
        _, _, error = solve_slopes((mixed.T @ self._moments @ mixed)[None], self._segments, 1.0)
        return error**2


def _without_first(moments: Samples, count: int) -> Samples:
    """Moments (k - count, k - count) of what the first columns do not explain of the others."""
    first, across = moments[:count, :count], moments[:count, count:]
    unit = np.sqrt(np.maximum(np.diag(first), 1e-300))
    scaled = across / unit[:, None]
    held = ridged(first / np.outer(unit, unit), SLOPES_RIDGE)
    told = np.linalg.solve(held, scaled)
    return np.asarray(moments[count:, count:] - scaled.T @ told)
