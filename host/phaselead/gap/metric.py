"""The metric in which explanations are compared: whitened, each record's nuisances projected out, summed in blocks.

Everything after it works on moments, the products of columns (blocks, k, k): a few hundred columns over a few hundred
thousand rows are multiplied once, and selection, shrinkage, held-out tests and bootstraps are algebra of small
matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from phaselead.gap.noise import Noise, Whitener, fit_noise
from phaselead.gap.regressors import Index, Layout, SimulatedRegressors
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

OFFSET_RIDGE = 1e-9
"""Relative prior on a record's offset, which is as good as free."""
LEAST_POWER = 1e-6
"""Whitened squares of a column at its typical size below which the records cannot show it at all."""
LEAST_WEIGHT, MOST_WEIGHT = 1e-4, 3.0
"""Bounds of a block's weight: none is thrown away, none decides alone."""
STEADY_ROWS = 50
"""Rows of the run's mean square that are mixed into each block's."""
BLOCK_s = 0.25
"""Shortest wish for a block; where the drive repeats more slowly, its period is."""
FEWEST_BLOCKS = 24
"""Over all records, before blocks are made shorter than wished: fewer do not tell how a score scatters."""
SHORTEST_BLOCK_ROWS = 64
"""Several times longer than the noise is filtered over, so that blocks hardly depend on each other."""


@dataclass(frozen=True)
class Metric:
    """Some runs, each with its whitener, its blocks and their weights."""

    modelled_runs: tuple[ModelledRun, ...]
    whiteners: tuple[Whitener, ...]
    edges: tuple[tuple[int, ...], ...]
    """Per run the rows at which its blocks begin, and its length."""
    weights: tuple[Samples, ...]
    """Per run (blocks,): what the whitened squares of each block count. What a model misses need not be spread over a
    record: a jump may ring for one block."""

    @property
    def rows(self) -> int:
        """Scored rows in all."""
        return sum(edge[-1] for edge in self.edges)

    def project(self, index: int, columns: Samples) -> Samples:
        """Columns (n, k) of run ``index``: whitened, weighted, the run's nuisances projected out."""
        white, local = self.whitened(index, columns), self.nuisances[index]
        white -= local @ (local.T @ white)
        return white

    def whitened(self, index: int, columns: Samples) -> Samples:
        """Columns (n, k) of run ``index``: whitened and weighted, a copy."""
        white = self.whiteners[index](columns)
        white *= self._roots[index]
        return white

    @cached_property
    def nuisances(self) -> list[Samples]:
        """Per run (n, m): a basis B of its nuisances, whitened and weighted. ``B @ B.T @ column`` is what they take
        out of a column under their priors, so a shrunk nuisance has a basis vector shorter than 1."""
        found = []
        for i, modelled in enumerate(self.modelled_runs):
            local = self.whitened(i, modelled.nuisances)
            normal = local.T @ local
            normal[0, 0] *= 1 + OFFSET_RIDGE
            normal += np.diag([OFFSET_RIDGE, *np.ones(len(normal) - 1)])
            root = cholesky(normal, lower=True)
            found.append(local @ solve_triangular(root, np.eye(len(root)), lower=True).T)
        return found

    @cached_property
    def _roots(self) -> list[Samples]:
        """Per run the square roots of its row weights (n, 1)."""
        return [np.sqrt(self.row_weights(i))[:, None] for i in range(len(self.modelled_runs))]

    def moments(self, projected: Sequence[Samples]) -> Samples:
        """Moments (blocks, k, k) of projected columns, run after run."""
        found = []
        for columns, edges in zip(projected, self.edges, strict=True):
            found += [columns[start:stop].T @ columns[start:stop] for start, stop in pairwise(edges)]
        return np.stack(found)

    def row_weights(self, index: int) -> Samples:
        """Weight of each row (n,) of run ``index``."""
        return np.repeat(self.weights[index], np.diff(self.edges[index]))

    def weighted(self, weights: Sequence[Samples]) -> Metric:
        """The same with other weights, (blocks,) per run."""
        return replace(self, weights=tuple(weights))


def metric_of(modelled_runs: Sequence[ModelledRun], noise: Noise) -> Metric:
    """The metric of some runs under a noise model: blocks of at least a period of the drive where that leaves enough of
    them, all of weight 1."""
    whiteners = [noise.whitener(t.run.u_V[t.run.rows], t.run.step_s) for t in modelled_runs]
    rows = [t.run.stop - t.run.start for t in modelled_runs]
    wanted = max((_block_rows(t) for t in modelled_runs), default=1)
    edges = [tuple(e) for e in block_edges(rows, wanted)]
    return Metric(tuple(modelled_runs), tuple(whiteners), tuple(edges), tuple(np.ones(len(e) - 1) for e in edges))


def _block_rows(t: ModelledRun) -> int:
    """Rows of a period of the drive, or of BLOCK_s."""
    return max(round(BLOCK_s / t.run.step_s), t.period_rows or 0)


def block_edges(rows: Sequence[int], wanted: int) -> list[list[int]]:
    """Edges of blocks of about ``wanted`` rows in series of these lengths, shorter where that leaves too few in all."""
    total = sum(rows)
    length = max(SHORTEST_BLOCK_ROWS, min(wanted, total // FEWEST_BLOCKS))
    edges = []
    for n in rows:
        count = max(1, round(n / length))
        edges.append(np.linspace(0, n, count + 1).astype(int).tolist())
    return edges


def fair_weights(squares: Samples, rows: Samples, repeated: float = 1.0) -> Samples:
    """Weights (blocks,) of one run's blocks from their unweighted whitened squares (blocks,) and rows (blocks,).

    A weight is 1 over the block's mean square, which is drawn a little towards the run's, and 1 over ``repeated``, by
    which the run only repeats itself (``repetition``).
    """
    overall = float(squares.sum() / rows.sum())
    mean = (squares + STEADY_ROWS * overall) / (rows + STEADY_ROWS)
    return np.clip(1 / np.maximum(mean * repeated, 1e-12), LEAST_WEIGHT, MOST_WEIGHT)


def repetition(white: Samples, period: int | None) -> float:
    """By how much more power than noise the mean of the last periods of a whitened residual (n,) has; at least 1.

    ``period`` is in rows, None where the drive does not repeat.

    What a model misses on a periodic drive comes back in every period and is the same evidence each time: without
    this, thirty periods of one fault would count thirtyfold.
    """
    if period is None or len(white) < 2 * period:
        return 1.0
    count = len(white) // period
    folded = white[len(white) - count * period :].reshape(count, period)
    power = float(np.mean(folded**2))
    return max(1.0, count * float(np.mean(folded.mean(axis=0) ** 2)) / power) if power > 0 else 1.0


def noise_of(modelled_runs: Sequence[ModelledRun], errors: Sequence[Samples]) -> Noise:
    """The noise model fitted to the residuals (n,) of some runs, driven and idle."""
    pairs = list(zip(modelled_runs, errors, strict=True))
    driven = [(e, t.run.u_V[t.run.rows]) for t, e in pairs if not t.run.idle]
    return fit_noise(driven, [e for t, e in pairs if t.run.idle], modelled_runs[0].run.step_s)


@dataclass(frozen=True)
class Regressors:
    """The regressors of some runs in their metric, and their moments. They stay the same while a search goes on.

    Columns that change (the residual, tangents of what was named) are multiplied against them when they are asked for.
    """

    metric: Metric
    layout: Layout
    projected: tuple[NDArray[np.floating], ...]
    """Per run (n, l): the columns at ``live``, whitened, weighted, nuisances projected out."""
    live: Index
    """(l,) the columns that are not 0 in every run."""
    fixed: Samples
    """Moments (blocks, k, k) of all columns."""

    @property
    def size(self) -> int:
        """How many columns there are, k."""
        return int(self.fixed.shape[-1])

    def restricted(self, index: Index) -> Regressors:
        """The same with the columns at ``index`` only; its layout no longer holds."""
        live = np.flatnonzero(np.isin(index, self.live))
        kept = np.searchsorted(self.live, index[live])
        projected = tuple(np.ascontiguousarray(p[:, kept], dtype=np.float64) for p in self.projected)
        return replace(self, projected=projected, live=live, fixed=self.fixed[:, index[:, None], index])

    def with_columns(self, fresh: Sequence[Samples]) -> Samples:
        """Moments (blocks, k + q, k + q) with further columns in um, (n, q) per run, appended."""
        q, k = fresh[0].shape[1], self.size
        moments = np.zeros((len(self.fixed), k + q, k + q))
        moments[:, :k, :k] = self.fixed
        block = 0
        for i, columns in enumerate(fresh):
            new = self.metric.project(i, columns)
            edges = self.metric.edges[i]
            for start, stop in pairwise(edges):
                part = new[start:stop]
                cross = part.T @ np.asarray(self.projected[i][start:stop], dtype=np.float64)
                moments[block, k:, self.live] = moments[block, self.live, k:] = cross.T
                moments[block, k:, k:] = part.T @ part
                block += 1
        return moments

    def total_with_columns(self, fresh: Sequence[Samples]) -> Samples:
        """The same summed over all blocks, (k + q, k + q); quicker than ``with_columns``."""
        q, k = fresh[0].shape[1], self.size
        cross = np.zeros((q, len(self.live)))
        total = np.zeros((k + q, k + q))
        total[:k, :k] = self.fixed_total
        for i, columns in enumerate(fresh):
            # An offset so large that it would cost digits below is a nuisance anyway.
            white = self.metric.whitened(i, columns - columns.mean(axis=0))
            own = self.metric.nuisances[i].T @ white
            cross += white.T @ np.asarray(self.projected[i], dtype=np.float64) - own.T @ self._shared[i][0]
            total[k:, k:] += white.T @ white - own.T @ (2 * own - self._shared[i][1] @ own)
        total[k:, self.live], total[self.live, k:] = cross, cross.T
        return total

    @cached_property
    def _shared(self) -> list[tuple[Samples, Samples]]:
        """Per run the products of its own nuisances with the live columns (m, l) and each other (m, m)."""
        pairs = zip(self.projected, self.metric.nuisances, strict=True)
        return [(own.T @ np.asarray(p, dtype=np.float64), own.T @ own) for p, own in pairs]

    @cached_property
    def fixed_total(self) -> Samples:
        """Moments (k, k) of the regressors summed over all blocks."""
        return np.asarray(self.fixed.sum(axis=0))

    def reweighted(self, weights: Sequence[Samples]) -> Regressors:
        """The same with other weights, (blocks,) per run. Shrunk nuisances move a little with them: ignored."""
        old = self.metric
        projected, ratios = [], []
        for i, (new, columns) in enumerate(zip(weights, self.projected, strict=True)):
            ratio = new / old.weights[i]
            rows = np.sqrt(np.repeat(ratio, np.diff(old.edges[i])))[:, None]
            projected.append((columns * rows).astype(columns.dtype))
            ratios.append(ratio)
        fixed = self.fixed * np.concatenate(ratios)[:, None, None]
        return replace(self, metric=old.weighted(weights), projected=tuple(projected), fixed=fixed)

    def unweighted(self, per_block: Samples) -> list[Samples]:
        """Weighted squares (blocks,) of all blocks as unweighted ones, per run."""
        edges = self.metric.edges
        parts = np.split(per_block, np.cumsum([len(e) - 1 for e in edges])[:-1])
        return [part / w for part, w in zip(parts, self.metric.weights, strict=True)]


def whitened_regressors(metric: Metric, layout: Layout, simulated: Sequence[SimulatedRegressors]) -> Regressors:
    """Whiten and multiply the simulated regressors of the runs of ``metric``, one of each in the same order."""
    size = simulated[0].columns.shape[1]
    live = np.flatnonzero(np.any([r.columns.any(axis=0) for r in simulated], axis=0))
    projected = [metric.project(i, r.columns[:, live].astype(np.float64)) for i, r in enumerate(simulated)]
    moments = metric.moments(projected)
    fixed = np.zeros((len(moments), size, size))
    fixed[:, live[:, None], live] = moments
    return Regressors(metric, layout, tuple(p.astype(np.float32) for p in projected), live, fixed)


def conditional_on(moment: Samples, nuisances: Index, precision: Samples | None = None) -> Samples:
    """The moment (k, k) of columns conditional on the columns ``nuisances``: after these were fitted to every column,
    under a prior of precision (m, m) where one is given (a Schur complement)."""
    if not len(nuisances):
        return moment
    gains = cho_solve(nuisance_factor(moment, nuisances, precision), moment[nuisances])
    return np.asarray(moment - moment[:, nuisances] @ gains)


def nuisance_factor(moment: Samples, nuisances: Index, precision: Samples | None = None) -> tuple[Samples, bool]:
    """Cholesky factor of the nuisances' part of a moment (k, k) plus their prior precision, for ``cho_solve``."""
    inner = moment[np.ix_(nuisances, nuisances)]
    if precision is not None:
        inner += precision
    inner += 1e-10 * (np.trace(inner) / len(inner) + 1e-300) * np.eye(len(inner))
    factor: tuple[Samples, bool] = cho_factor(inner)
    return factor
