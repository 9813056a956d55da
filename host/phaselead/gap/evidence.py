"""The metric in which candidates are compared: whitened, each record's own nuisances removed, in blocks.

Everything after it works on moments of columns (blocks, k, k): a few hundred columns over a few hundred thousand
rows are multiplied out once, and selection, shrinkage, held-out tests and bootstraps are algebra of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from phaselead.gap.noise import Noise, Whitener, block_edges, fit_noise
from phaselead.gap.residual import Track
from phaselead.record import Samples

OFFSET_RIDGE = 1e-9
LEAST_WEIGHT, MOST_WEIGHT = 1e-4, 3.0
STEADY_ROWS = 50
"""Rows of the track's mean that are mixed into each block's."""
BLOCK_s = 0.25
"""Shortest wish for a block; where the drive repeats more slowly, its period is."""


@dataclass(frozen=True)
class Evidence:
    """Tracks with a whitener and blocks each. ``weights``: what the whitened squares of each block count.

    Weights are per block because what a model misses need not be spread over a record: a jump may ring for one block.
    """

    tracks: tuple[Track, ...]
    whiteners: tuple[Whitener, ...]
    edges: tuple[tuple[int, ...], ...]
    weights: tuple[Samples, ...]

    @property
    def rows(self) -> int:
        """Scored rows in all."""
        return sum(edge[-1] for edge in self.edges)

    def project(self, index: int, columns: Samples) -> Samples:
        """Columns (n, k) of one track: whitened, weighted, its own nuisances taken out."""
        white, local = self.whitened(index, columns), self.nuisances[index]
        white -= local @ (local.T @ white)
        return white

    def whitened(self, index: int, columns: Samples) -> Samples:
        """Columns (n, k) of one track: whitened and weighted, a copy."""
        white = self.whiteners[index](columns)
        white *= self._roots[index]
        return white

    @cached_property
    def nuisances(self) -> list[Samples]:
        """Per track (n, m): its own nuisances, whitened, weighted and orthogonal to each other, as far as columns can
        hold of them what their prior leaves free: what is taken out of a column is ``nuisances @ nuisances.T @ it``."""
        found = []
        for i, track in enumerate(self.tracks):
            local = self.whitened(i, track.local)
            normal = local.T @ local
            normal[0, 0] *= 1 + OFFSET_RIDGE
            normal += np.diag([OFFSET_RIDGE, *np.ones(len(normal) - 1)])
            root = cholesky(normal, lower=True)
            found.append(local @ solve_triangular(root, np.eye(len(root)), lower=True).T)
        return found

    @cached_property
    def _roots(self) -> list[Samples]:
        """Per track the roots of the row weights (n, 1)."""
        return [np.sqrt(self.row_weights(i))[:, None] for i in range(len(self.tracks))]

    def moments(self, projected: Sequence[Samples]) -> Samples:
        """Moments (blocks, k, k) of projected columns, track after track."""
        found = []
        for columns, edges in zip(projected, self.edges, strict=True):
            found += [columns[start:stop].T @ columns[start:stop] for start, stop in pairwise(edges)]
        return np.stack(found)

    def row_weights(self, index: int) -> Samples:
        """(n,) of one track."""
        return np.repeat(self.weights[index], np.diff(self.edges[index]))

    def weighted(self, weights: Sequence[Samples]) -> Evidence:
        """The same with other weights."""
        return replace(self, weights=tuple(weights))

    def track_of_block(self) -> list[int]:
        """Which track each block belongs to."""
        return [i for i, edges in enumerate(self.edges) for _ in edges[1:]]


def evidence(tracks: Sequence[Track], noise: Noise) -> Evidence:
    """Tracks with the whitener of their voltage, and blocks of at least a period of their drive where that leaves
    enough."""
    whiteners = [noise.whitener(t.run.u_V[t.run.rows], t.run.step_s) for t in tracks]
    rows = [t.run.stop - t.run.start for t in tracks]
    wanted = max((_block_rows(t) for t in tracks), default=1)
    edges = [tuple(e) for e in block_edges(rows, wanted)]
    return Evidence(tuple(tracks), tuple(whiteners), tuple(edges), tuple(np.ones(len(e) - 1) for e in edges))


def _block_rows(t: Track) -> int:
    """A period of the drive, or BLOCK_s."""
    return max(round(BLOCK_s / t.run.step_s), t.period_rows or 0)


def fair_weights(squares: Samples, rows: Samples, repeated: float = 1.0) -> Samples:
    """(b,) weights of a track's blocks from unweighted whitened squares (b,) and rows (b,): 1 over their mean square,
    drawn a little towards the track's, and over how far the track only repeats itself."""
    overall = float(squares.sum() / rows.sum())
    mean = (squares + STEADY_ROWS * overall) / (rows + STEADY_ROWS)
    return np.clip(1 / np.maximum(mean * repeated, 1e-12), LEAST_WEIGHT, MOST_WEIGHT)


def noise_of(tracks: Sequence[Track], errors: Sequence[Samples]) -> Noise:
    """Noise of the tracks' residuals (n,)."""
    pairs = list(zip(tracks, errors, strict=True))
    driven = [(e, t.run.u_V[t.run.rows]) for t, e in pairs if not t.run.idle]
    return fit_noise(driven, [e for t, e in pairs if t.run.idle], tracks[0].run.step_s)
