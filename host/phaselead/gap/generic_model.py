"""A generic model of what a voltage does to a position: any causal response with some memory, nothing of the catalogue.

It is linear in its columns: averages of the voltage over past windows, modes at every frequency, plays, bends, and
products of the position that a linear model predicts. The ridge of each kind of column (Hoerl and Kennard 1970) is
chosen by leaving out a quarter of the records that it is fitted to: it is to predict others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.signal import lfilter

from phaselead.gap.records import GapRun
from phaselead.identify import STILL_V
from phaselead.model import plays
from phaselead.record import Samples

LONGEST_LAG_s, MEMORY_OF_RECORD = 30.0, 0.25
"""Longest memory in seconds, and of the longest record: a column that is still settling where a record ends says
nothing reliable of another record."""
LAG_RATIO = 1.5
"""Of the far end of a window of past voltage to that of the one before."""
MODE_RATIO, MODE_ZETA, HIGHEST_OF_RATE = 1.2, 0.05, 0.4
"""Modes stand in this ratio of frequencies, at this damping, so that neighbours overlap, up to this part of the
sampling rate."""
PLAY_SHARES = (0.01, 0.02, 0.04, 0.08, 0.12, 0.18, 0.25, 0.35, 0.5, 0.7)
"""Thresholds of the plays, of the span of the voltage; half of it moves no play."""
BENDS = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Where a static curve may bend, in halves of the voltage's span about its middle."""
SPEED_TIMES_s = (0.003, 0.03, 0.3, 3.0)
"""Over which the speed of the voltage is averaged: what it heats or softens follows it."""
POWER_LAGS = 6
"""Windows of past powers of the position: what a spring that hardens does comes late."""
FOLDS = 4
"""That are left out in turn: whole records, or parts of every record where there are fewer. A part of a record is
predicted from the rest of it also by columns that say nothing of any other record."""
RIDGES = tuple(10.0**e for e in range(-6, 3))
"""Tried for all columns: precision of an amount's prior, as a share of what the records say of it at most."""
NO_AMOUNT = 1e9
"""A ridge that leaves a column out."""
CHANGES = (0.01, 0.1, 10.0, 100.0, NO_AMOUNT)
"""By which the ridge of one kind may differ from the others'."""
ROUNDS = 2
"""In which the ridges of the kinds are chosen in turn."""
CHUNK_ROWS = 8192
"""Multiplied at once in single precision."""

LINEAR, MEMORY, STATIC, SPEED, POWERS, OTHERS = range(6)
"""Kinds of columns."""


@dataclass(frozen=True)
class Columns:
    """Makes the columns of any run of one axis. ``position``: amounts of the linear columns that predict it, in um."""

    middle_V: float
    half_V: float
    """Of the span of the voltage in the runs that the model is fitted to."""
    step_s: float
    longest_s: float
    """Memory that these runs can show."""
    others: tuple[str, ...]
    """Axes that are driven as well."""
    position: Samples | None = None
    position_um: float = 1.0
    """Rms of the predicted position."""

    def of(self, run: GapRun) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
        """Columns (n, k) over the scored rows, about their means, and the kind (k,) of each."""
        parts = list(self._parts(run))
        kinds = np.concatenate([np.full(part.shape[1], kind) for kind, part in parts])
        columns = np.concatenate([part[run.rows] for _, part in parts], axis=1)
        return (columns - columns.mean(axis=0)).astype(np.float32), kinds

    def _parts(self, run: GapRun) -> Iterator[tuple[int, Samples]]:
        """Kind and columns (n, m) over all rows, kind by kind."""
        v = (_drive_V(run) - self.middle_V) / self.half_V
        linear = self._linear(v)
        yield LINEAR, linear
        moved, _ = plays(v, 2 * np.array(PLAY_SHARES), np.full(len(PLAY_SHARES), v[0]))
        yield MEMORY, np.concatenate([moved, moved**2], axis=1)
        yield STATIC, np.concatenate([np.maximum(v[:, None] - BENDS, 0.0), v[:, None] ** [2, 3]], axis=1)
        yield SPEED, self._speeds(v)
        if self.position is not None:
            yield POWERS, self._powers(v, (linear - linear[0]) @ self.position / self.position_um)
        for name in self.others:
            other = run.others_V.get(name)
            # Axes are driven over about the same span.
            scaled = np.zeros_like(v) if other is None else (other - other[0]) / self.half_V
            yield OTHERS, self._linear(scaled)

    def _linear(self, v: Samples) -> Samples:
        """Means over past windows, and the two states of every mode."""
        lowest_Hz, highest_Hz = 1 / (2 * np.pi * MODE_ZETA * self.longest_s), HIGHEST_OF_RATE / self.step_s
        count = max(2, round(np.log(highest_Hz / lowest_Hz) / np.log(MODE_RATIO)))
        states = [_mode_state(v, f_Hz * self.step_s) for f_Hz in np.geomspace(lowest_Hz, highest_Hz, count)]
        modes = np.stack([part for s in states for part in (s.real - v, s.imag)], axis=1)
        return np.concatenate([self._windows(v), modes], axis=1)

    def _windows(self, v: Samples, most: int | None = None) -> Samples:
        """Means over past windows that begin where the one before ends, v itself first; v[0] before the record."""
        reach = max(2, round(self.longest_s / self.step_s))
        lags = np.unique(np.round(np.geomspace(1, reach, max(2, round(np.log(reach) / np.log(LAG_RATIO)) + 1))))
        edges = [0, *lags.astype(int).tolist()][: None if most is None else most + 1]
        total = np.concatenate([[0.0], np.cumsum(v - v[0])])
        past = [total[np.maximum(np.arange(1, len(total)) - lag, 0)] for lag in edges]
        means = [(past[i] - past[i + 1]) / (edges[i + 1] - edges[i]) for i in range(len(edges) - 1)]
        return np.stack([v - v[0], *means], axis=1)

    def _speeds(self, v: Samples) -> Samples:
        """Speed averaged over several times, and its product with the voltage."""
        speed = np.abs(np.diff(v, prepend=v[0])) / self.step_s
        means = []
        for tau_s in (tau_s for tau_s in SPEED_TIMES_s if tau_s <= max(self.longest_s, SPEED_TIMES_s[0])):
            decay = np.exp(-self.step_s / tau_s)
            means.append(lfilter([1 - decay], [1, -decay], speed))
        levels = np.stack(means, axis=1)
        return np.concatenate([levels, levels * v[:, None]], axis=1)

    def _powers(self, v: Samples, z: Samples) -> Samples:
        """Products of the position ``z`` (n,) that a linear model predicts with itself, its speed and the voltage."""
        speed = np.gradient(z) / max(float(np.std(np.gradient(z))), 1e-12)
        now = np.stack([z * v, z * speed, speed * np.abs(speed), np.abs(z), np.abs(speed), z**2 * speed], axis=1)
        return np.concatenate([now, self._windows(z**2, POWER_LAGS), self._windows(z**3, POWER_LAGS)], axis=1)


def _drive_V(run: GapRun) -> Samples:
    """What drives a run, (n,) in V. In a closed loop the voltage holds the sensor's noise, so that the reference that
    was followed stands for it."""
    if run.r_um is None or not np.ptp(run.r_um) > 0:
        return run.u_V
    slope, at_0 = np.polyfit(run.r_um, run.u_V, 1)
    return np.asarray(slope * run.r_um + at_0)


def _mode_state(v: Samples, turns: float) -> NDArray[np.complex128]:
    """State (n,) of a mode of ``turns`` periods per row, that has rested at v[0]; v where v stands still."""
    pole = np.exp(2 * np.pi * turns * (1j * np.sqrt(1 - MODE_ZETA**2) - MODE_ZETA))
    return np.asarray(lfilter([1 - pole], [1, -pole], v - v[0]) + v[0])


def columns_of(runs: Sequence[GapRun]) -> Columns:
    """Columns for a model that is fitted to these runs, of which one is driven at least."""
    drives = [_drive_V(run)[run.rows] for run in runs]
    low, high = min(float(u.min()) for u in drives), max(float(u.max()) for u in drives)
    names = sorted({name for run in runs for name, u in run.others_V.items() if np.ptp(u[run.rows]) > STILL_V})
    longest_s = min(LONGEST_LAG_s, MEMORY_OF_RECORD * max(run.step_s * (run.stop - run.start) for run in runs))
    bare = Columns((low + high) / 2, max((high - low) / 2, STILL_V), runs[0].step_s, longest_s, tuple(names))
    linear = moments_of(bare, runs, [run.x_um[run.rows] for run in runs]).linear()
    amounts = _Regression.of(linear, None).amounts(np.full(1, RIDGES[0]))
    said = float(amounts @ linear.squares.sum(axis=0) @ amounts) / sum(run.stop - run.start for run in runs)
    return replace(bare, position=amounts, position_um=max(float(np.sqrt(said)), 1e-12))


@dataclass(frozen=True)
class FoldMoments:
    """Products of the columns with each other and with what they are to predict, fold by fold."""

    kinds: NDArray[np.intp]
    """(k,)"""
    squares: Samples
    """(folds, k, k)"""
    along: Samples
    """(folds, k) of columns with the target."""
    power: Samples
    """(folds,) of the target with itself."""

    def linear(self) -> FoldMoments:
        """Of the linear columns alone."""
        kept = self.kinds == LINEAR
        return FoldMoments(self.kinds[kept], self.squares[:, kept][:, :, kept], self.along[:, kept], self.power)

    def with_others(self, others: FoldMoments) -> FoldMoments:
        """Of these records and others."""
        squares, along, power = self.squares + others.squares, self.along + others.along, self.power + others.power
        return FoldMoments(self.kinds, squares, along, power)

    def without(self, fold: int | None) -> tuple[Samples, Samples]:
        """Squares (k, k) and products with the target (k,), summed over all folds but one."""
        squares, along = self.squares.sum(axis=0), self.along.sum(axis=0)
        return (squares, along) if fold is None else (squares - self.squares[fold], along - self.along[fold])


def moments_of(columns: Columns, runs: Sequence[GapRun], targets: Sequence[Samples]) -> FoldMoments:
    """Moments of some runs, at least one, with what is to be predicted there, (n,) each."""
    kinds, found = np.zeros(0, dtype=np.intp), []
    for i, (run, target) in enumerate(zip(runs, targets, strict=True)):
        made, kinds = columns.of(run)
        found.append(_by_fold(made, target - target.mean(), i, FOLDS if len(runs) < FOLDS else 1))
    squares, along, power = (np.sum(part, axis=0) for part in zip(*found, strict=True))
    return FoldMoments(kinds, squares, along, power)


def _by_fold(columns: NDArray[np.float32], target: Samples, shift: int, parts: int) -> tuple[Samples, Samples, Samples]:
    """Moments of one run: its ``parts`` go to different folds, the first to fold ``shift``."""
    k = columns.shape[1]
    squares, along, power = np.zeros((FOLDS, k, k)), np.zeros((FOLDS, k)), np.zeros(FOLDS)
    edges = np.linspace(0, len(target), parts + 1).astype(int).tolist()
    for part, (start, stop) in enumerate(pairwise(edges)):
        fold = (part + shift) % FOLDS
        power[fold] = float(target[start:stop] @ target[start:stop])
        for first in range(start, stop, CHUNK_ROWS):
            rows = slice(first, min(first + CHUNK_ROWS, stop))
            exact = columns[rows].astype(np.float64)
            squares[fold] += exact.T @ exact
            along[fold] += exact.T @ target[rows]
    return squares, along, power


def ridge_amounts(learned: FoldMoments) -> Samples:
    """Amounts (k,) of the columns that predict best what is left out of the records they are fitted to."""
    plain = _Regression.of(learned, None)
    return plain.amounts(_best_ridges([_Regression.of(learned, fold) for fold in range(FOLDS)], plain))


def new_amounts(learned: FoldMoments, reference: FoldMoments) -> tuple[Samples, Samples]:
    """Amounts (k,) that the learned records share with the reference, and those that are their own.

    Both are fitted together: the shared ones to all records, the own ones to what the learned records say beyond them.
    """
    both = learned.with_others(reference)
    plain = _Regression.of(both, None)
    ridges = _best_ridges([_Regression.of(both, fold) for fold in range(FOLDS)], plain)
    precision = np.diag(plain.precision(ridges))
    every = [_beyond_shared(learned, reference, precision, fold) for fold in (None, *range(FOLDS))]
    own_ridges = _best_ridges([regression for regression, _ in every[1:]], every[0][0])
    regression, shared = every[0]
    own = regression.amounts(own_ridges)
    return shared.at_0 - shared.gives_way @ own, own


class _Shared(NamedTuple):
    """Shared amounts as they depend on the own ones: ``at_0 - gives_way @ own``."""

    at_0: Samples
    gives_way: Samples


def _beyond_shared(
    learned: FoldMoments, reference: FoldMoments, precision: Samples, fold: int | None
) -> tuple[_Regression, _Shared]:
    """The regression of own amounts with the shared ones of this ``precision`` (k, k) eliminated, a fold left out."""
    squares, along = learned.without(fold)
    more, also = reference.without(None)
    factor = cho_factor(squares + more + precision)
    shared = _Shared(cho_solve(factor, along + also), cho_solve(factor, squares))
    moves = np.eye(len(along)) - shared.gives_way
    seen = _Regression(learned.kinds, _scale(learned), squares @ moves, along - squares @ shared.at_0)
    if fold is None:
        return seen, shared
    out, out_along = learned.squares[fold], learned.along[fold] - learned.squares[fold] @ shared.at_0
    power = learned.power[fold] - shared.at_0 @ (learned.along[fold] + out_along)
    return replace(seen, out=_LeftOut(moves.T @ out @ moves, moves.T @ out_along, float(power))), shared


class _LeftOut(NamedTuple):
    """Moments (k, k), (k,) and () of a fold to be predicted."""

    squares: Samples
    along: Samples
    power: float


@dataclass(frozen=True)
class _Regression:
    """Normal equations of all records but a fold, and the moments of that fold."""

    kinds: NDArray[np.intp]
    scale: Samples
    """(k,) the unit of each column: its rms times the root of the rows of all folds; 0 of a column that is 0."""
    squares: Samples
    along: Samples
    out: _LeftOut | None = None

    @classmethod
    def of(cls, moments: FoldMoments, fold: int | None) -> _Regression:
        """Of moments, with a fold left out or none."""
        out = None if fold is None else _LeftOut(moments.squares[fold], moments.along[fold], float(moments.power[fold]))
        return cls(moments.kinds, _scale(moments), *moments.without(fold), out)

    def precision(self, ridges: Samples) -> Samples:
        """(k,) of each amount under ridges (kinds,)."""
        return np.asarray(np.where(self.scale > 0, np.maximum(ridges[self.kinds], RIDGES[0]) * self.scale**2, 1.0))

    def amounts(self, ridges: Samples) -> Samples:
        """Amounts (k,) under ridges (kinds,)."""
        unit = np.where(self.scale > 0, self.scale, 1.0)
        normal = (self.squares + np.diag(self.precision(ridges))) / np.outer(unit, unit)
        amounts = cho_solve(cho_factor(normal), self.along / unit) / unit
        return np.asarray(np.where(ridges[self.kinds] < NO_AMOUNT, amounts, 0.0))

    def left(self, ridges: Samples) -> float:
        """Squares left of the fold left out."""
        assert self.out is not None
        amounts = self.amounts(ridges)
        return float(self.out.power - amounts @ (2 * self.out.along - self.out.squares @ amounts))


def _scale(moments: FoldMoments) -> Samples:
    return np.asarray(np.sqrt(np.einsum("fkk->k", moments.squares)))


def _best_ridges(folds: Sequence[_Regression], whole: _Regression) -> Samples:
    """Ridges (kinds,) that predict left-out folds best: one for all, then kind by kind, and none at all if that is
    better."""

    def left(ridges: Samples) -> float:
        return sum(fold.left(ridges) for fold in folds)

    kinds = int(whole.kinds.max()) + 1
    best = min((np.full(kinds, ridge) for ridge in RIDGES), key=left)
    for kind in list(np.unique(whole.kinds)) * ROUNDS:
        tried = [best]
        for change in CHANGES:
            other = best.copy()
            other[kind] *= change
            tried.append(other)
        best = min(tried, key=left)
    return min(np.full(kinds, NO_AMOUNT), best, key=left)
