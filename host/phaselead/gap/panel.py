"""A panel: the fixed columns (atoms of every effect, base) of some tracks in the metric, multiplied out once.

Columns that change as the search goes on (the residual, tangents of what was named) are multiplied against them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.atoms import Atom, Freedom, base_columns
from phaselead.gap.evidence import Evidence
from phaselead.gap.residual import Track
from phaselead.model import Extra
from phaselead.record import Samples

Index = NDArray[np.intp]


@dataclass(frozen=True)
class Raw:
    """The fixed columns of one track in um, (n, k): atoms in order, then base."""

    track: Track
    base_um: Samples
    columns: NDArray[np.float32]


@dataclass(frozen=True)
class Layout:
    """Which columns are whose."""

    atoms: tuple[Atom, ...]
    n_base: int

    @property
    def size(self) -> int:
        return sum(len(a.steps) for a in self.atoms) + self.n_base

    def of_atom(self, index: int) -> Index:
        first = sum(len(a.steps) for a in self.atoms[:index])
        return np.arange(first, first + len(self.atoms[index].steps))

    @property
    def base(self) -> Index:
        return np.arange(self.size - self.n_base, self.size)

    def common(self) -> Index:
        """Columns that describe what the base misses: coarse atoms and the base's own, in order."""
        picked = [self.of_atom(i) for i, a in enumerate(self.atoms) if a.coarse]
        return np.concatenate([*picked, self.base]).astype(np.intp)

    def coarser(self) -> Layout:
        """Of panels that hold the common columns only."""
        return Layout(tuple(a for a in self.atoms if a.coarse), self.n_base)


def raw(track: Track, atoms: Sequence[Atom], freedom: Freedom, extra: Extra = ()) -> Raw:
    """Simulate every atom on one track, beside ``extra``."""
    base_um = track.answer(extra)
    parts = [atom.columns(track, base_um, extra).astype(np.float32) for atom in atoms]
    parts.append(base_columns(track, freedom, extra).astype(np.float32))
    return Raw(track, base_um, np.concatenate(parts, axis=1))


@dataclass(frozen=True)
class Panel:
    """Projected fixed columns per track and their moments (blocks, k, k).

    Columns that are 0 in every track are left out of ``projected``, whose columns are those at ``live``.
    """

    evidence: Evidence
    layout: Layout
    projected: tuple[NDArray[np.floating], ...]
    live: Index
    fixed: Samples

    @property
    def size(self) -> int:
        return int(self.fixed.shape[-1])

    def restricted(self, index: Index) -> Panel:
        """The same with some of the fixed columns only; its layout no longer holds."""
        live = np.flatnonzero(np.isin(index, self.live))
        kept = np.searchsorted(self.live, index[live])
        projected = tuple(np.ascontiguousarray(p[:, kept], dtype=np.float64) for p in self.projected)
        return replace(self, projected=projected, live=live, fixed=self.fixed[:, index[:, None], index])

    def with_columns(self, fresh: Sequence[Samples]) -> Samples:
        """Moments (blocks, k + q, k + q) with further raw columns (n, q) per track appended."""
        q, k = fresh[0].shape[1], self.size
        moments = np.zeros((len(self.fixed), k + q, k + q))
        moments[:, :k, :k] = self.fixed
        block = 0
        for i, columns in enumerate(fresh):
            new = self.evidence.project(i, columns)
            edges = self.evidence.edges[i]
            for start, stop in pairwise(edges):
                part = new[start:stop]
                cross = part.T @ np.asarray(self.projected[i][start:stop], dtype=np.float64)
                moments[block, k:, self.live] = moments[block, self.live, k:] = cross.T
                moments[block, k:, k:] = part.T @ part
                block += 1
        return moments

    def total_with_columns(self, fresh: Sequence[Samples]) -> Samples:
        """The same summed over all blocks, (k + q, k + q)."""
        q, k = fresh[0].shape[1], self.size
        cross = np.zeros((q, len(self.live)))
        total = np.zeros((k + q, k + q))
        total[:k, :k] = self.fixed_total
        for i, columns in enumerate(fresh):
            # An offset so large that it would cost digits below is a nuisance anyway.
            white = self.evidence.whitened(i, columns - columns.mean(axis=0))
            own = self.evidence.nuisances[i].T @ white
            cross += white.T @ np.asarray(self.projected[i], dtype=np.float64) - own.T @ self._shared[i][0]
            total[k:, k:] += white.T @ white - own.T @ (2 * own - self._shared[i][1] @ own)
        total[k:, self.live], total[self.live, k:] = cross, cross.T
        return total

    @cached_property
    def _shared(self) -> list[tuple[Samples, Samples]]:
        """Per track the products of its own nuisances with the live columns (m, l) and each other (m, m)."""
        pairs = zip(self.projected, self.evidence.nuisances, strict=True)
        return [(own.T @ np.asarray(p, dtype=np.float64), own.T @ own) for p, own in pairs]

    @cached_property
    def fixed_total(self) -> Samples:
        """Their moments (k, k) summed over all blocks."""
        return np.asarray(self.fixed.sum(axis=0))

    def reweighted(self, weights: Sequence[Samples]) -> Panel:
        """The same with other weights (blocks,) per track. Shrunk nuisances move a little with them: ignored."""
        old = self.evidence
        projected, ratios = [], []
        for i, (new, columns) in enumerate(zip(weights, self.projected, strict=True)):
            ratio = new / old.weights[i]
            rows = np.sqrt(np.repeat(ratio, np.diff(old.edges[i])))[:, None]
            projected.append((columns * rows).astype(columns.dtype))
            ratios.append(ratio)
        fixed = self.fixed * np.concatenate(ratios)[:, None, None]
        return replace(self, evidence=old.weighted(weights), projected=tuple(projected), fixed=fixed)

    def unweighted(self, per_block: Samples) -> list[Samples]:
        """Weighted squares (blocks,) as unweighted ones, per track."""
        edges = self.evidence.edges
        parts = np.split(per_block, np.cumsum([len(e) - 1 for e in edges])[:-1])
        return [part / w for part, w in zip(parts, self.evidence.weights, strict=True)]


def panel(evidence: Evidence, layout: Layout, raws: Sequence[Raw]) -> Panel:
    """Whiten and multiply out the fixed columns of the tracks of ``evidence``."""
    size = raws[0].columns.shape[1]
    live = np.flatnonzero(np.any([r.columns.any(axis=0) for r in raws], axis=0))
    projected = [evidence.project(i, r.columns[:, live].astype(np.float64)) for i, r in enumerate(raws)]
    moments = evidence.moments(projected)
    fixed = np.zeros((len(moments), size, size))
    fixed[:, live[:, None], live] = moments
    return Panel(evidence, layout, tuple(p.astype(np.float32) for p in projected), live, fixed)


def condition(moment: Samples, nuisances: Index, precision: Samples | None = None) -> Samples:
    """Moment (k, k) after columns ``nuisances`` were fitted to everything, with a prior of that precision."""
    if not len(nuisances):
        return moment
    gains = cho_solve(nuisance_factor(moment, nuisances, precision), moment[nuisances])
    return np.asarray(moment - moment[:, nuisances] @ gains)


def nuisance_factor(moment: Samples, nuisances: Index, precision: Samples | None = None) -> tuple[Samples, bool]:
    """As ``scipy.linalg.cho_solve`` takes it, of columns of a moment (k, k), with a prior of that precision."""
    inner = moment[np.ix_(nuisances, nuisances)]
    if precision is not None:
        inner += precision
    inner += 1e-10 * (np.trace(inner) / len(inner) + 1e-300) * np.eye(len(inner))
    factor: tuple[Samples, bool] = cho_factor(inner)
    return factor


def ridge(moment: Samples, columns: Index, target: int, precision: Samples) -> Samples:
    """Amounts (len(columns),) of ``columns`` that explain column ``target`` under a prior."""
    inner = moment[np.ix_(columns, columns)] + precision
    return np.asarray(cho_solve(cho_factor(inner), moment[columns, target]))
