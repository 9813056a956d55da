"""The inverse of a modified rate-dependent Prandtl-Ishlinskii operator, after Ang, Khosla and Riviere 2007 ([9] in Xu
and Li 2010).

From their title, what Xu and Li say of it, and Kuhnen 2003, on which it rests: plays for the loop, one-sided dead zones
behind them for its asymmetry, weights of the plays that change linearly with the rate; the inverse is the feed-forward,
and there is no feedback. With 10 plays, 10 slopes against the rate and 8 dead zones it has 28 parameters, as Xu and Li
count.

    h(t) = sum_i (w_i + c_i |du/dt|) play_ri[u](t),   S(x) = h

S is a rising line with bends on the side of the position, so that records tell w, c and S in one linear fit with bounds
(Kuhnen 2003, section 4): no weight is negative from rest to the highest rate that was recorded, beyond which they stay
as they are. The inverse solves h for u, which is exact: h rises with u by straight pieces.
"""

from __future__ import annotations

from bisect import insort

import numpy as np
from scipy.optimize import lsq_linear

from rivals.bench import Reference
from rivals.evidence import TICK_S, Evidence, Samples, Sine
from rivals.paths import Path

PLAYS, BENDS = 10, 8
ROWS = 160
"""A period of a record in the fit."""
LEAST_SLOPE = 0.2
"""Of S against its first piece: it must rise."""
LEAST_WEIGHT = 1e-3
"""Of the first play against the gain: it must move."""


class RateDependentInverse:
    """The voltage whose modified Prandtl-Ishlinskii operator is the path."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        self._wanted_um = reference.by_tick()
        self._inverse = ModifiedInverse(*fitted(evidence))

    def step(self, tick: int, measured_um: float) -> float:
        now, ahead = self._wanted_um(tick), self._wanted_um(tick + 1)
        return self._inverse.step(now, (ahead - now) / TICK_S)


class Operator:
    """Plays with thresholds r (V) and weights (um/V) at a standstill and at ``fastest`` (V/s), at rest at 0 V."""

    def __init__(self, r: Samples, still: Samples, fast: Samples, fastest: float) -> None:
        self.r, self.still, self.fast = list(map(float, r)), np.asarray(still), np.asarray(fast)
        self.p = [0.0] * len(self.r)
        self._fastest = fastest
        self._least = LEAST_WEIGHT * float(self.still.sum())

    def weights(self, rate: float) -> list[float]:
        """At a rate in V/s; the first is above 0."""
        share = min(abs(rate) / self._fastest, 1.0)
        found: list[float] = ((1 - share) * self.still + share * self.fast).tolist()
        found[0] = max(found[0], self._least)
        return found

    def move(self, u: float, rate: float) -> float:
        """On to ``u`` V; what it gives there, um."""
        self.p = [min(max(p, u - r), u + r) for p, r in zip(self.p, self.r, strict=True)]
        return sum(w * p for w, p in zip(self.weights(rate), self.p, strict=True))

    def solve(self, h: float, rate: float) -> float:
        """The ``u`` V to which to move on so that it gives ``h``; the first threshold must be 0. It does not move."""
        weights = self.weights(rate)
        missing = h - sum(w * p for w, p in zip(weights, self.p, strict=True))
        sign = 1.0 if missing >= 0 else -1.0
        begins: list[tuple[float, float]] = []
        for p, r, w in zip(self.p, self.r, weights, strict=True):
            insort(begins, (sign * p + r, w))
        left, at, slope = abs(missing), begins[0][0], 0.0
        for begin, w in begins:
            if slope > 0 and slope * (begin - at) >= left:
                break
            left -= slope * (begin - at)
            at, slope = begin, slope + w
        return sign * (at + left / slope)


class ModifiedInverse:
    """u from position and its rate: S first, then the inverse of the plays."""

    def __init__(self, operator: Operator, knots_um: Samples, values: Samples, offset_um: float) -> None:
        self._operator, self._offset_um = operator, offset_um
        self._knots_um, self._values = knots_um, values
        self._slope = float(operator.still.sum())

    def straightened(self, x_um: float) -> float:
        """S."""
        return float(np.interp(x_um, self._knots_um, self._values)) - self._offset_um

    def step(self, x_um: float, rate_um_per_s: float) -> float:
        rate = rate_um_per_s / self._slope
        u = self._operator.solve(self.straightened(x_um), rate)
        self._operator.move(u, rate)
        return u


def fitted(evidence: Evidence) -> tuple[Operator, Samples, Samples, float]:
    """Operator, knots of S (um), its values there, and its offset, from all settled records at once, each with the same
    weight for the same share of its travel."""
    largest_V = max(one.swing_V for one in evidence.sines)
    fastest = max(np.pi * one.swing_V * one.f_Hz for one in evidence.sines)
    r = largest_V / 2 * (np.arange(PLAYS) / PLAYS) ** 2  # dense where loops are small
    top_um = max(float(one.x_um.max()) for one in evidence.sines)
    knots = np.linspace(0.0, 1.0, BENDS + 2)[:-1] * top_um
    rows = [_rows(one, r, knots, fastest) for one in evidence.sines]
    columns, first = (np.concatenate(part) for part in zip(*rows, strict=True))
    # sum w p - sum s_j piece_j(x) + offset = piece_0(x), whose slope is 1.
    low = np.r_[np.zeros(2 * PLAYS), np.full(BENDS, LEAST_SLOPE), -np.inf]
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-12)
    found = lsq_linear(columns / scale, first, (low * scale, np.full(len(low), np.inf))).x / scale
    still, fast, slopes, offset = np.split(found, [PLAYS, 2 * PLAYS, 2 * PLAYS + BENDS])
    ends = np.r_[-top_um, knots[1:], 2 * top_um]
    values = np.r_[0.0, np.cumsum(np.r_[1.0, slopes] * np.diff(ends))]  # S(0) = 0
    return Operator(r, still, fast, fastest), ends, values - np.interp(0.0, ends, values), float(offset[0])


def _rows(one: Sine, r: Samples, knots: Samples, fastest: float) -> tuple[Samples, Samples]:
    """Of a record's steady rows: plays still and fast, pieces of S, 1; and the first piece of S."""
    p, plays = np.zeros(len(r)), np.empty((len(one.u_V), len(r)))
    for i, u in enumerate(one.u_V):
        p = np.minimum(np.maximum(p, u - r), u + r)
        plays[i] = p
    period = round(1 / (one.f_Hz * TICK_S))
    every = slice(one.settled, one.settled + period, max(period // ROWS, 1))
    share = np.minimum(np.abs(np.gradient(one.u_V, TICK_S)) / fastest, 1.0)[every, None]
    x, own = one.x_um[every], plays[every]
    pieces = np.clip(x[:, None] - knots[1:], 0.0, np.append(knots[2:], np.inf) - knots[1:])
    columns = np.hstack([(1 - share) * own, share * own, -pieces, np.ones((len(x), 1))])
    size = float(np.ptp(x))
    return columns / size, np.minimum(x, knots[1]) / size
