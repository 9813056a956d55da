"""Records in blocks: what a column or a residual is in each octave of frequency.

A record becomes its cosine coefficients, which have no jump at its ends, and these are gathered by octave. Within an
octave only the mean power counts, so that nothing is asked of the shape of what a model misses, only how large it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, next_fast_len

from phaselead.gap.parameters import SizedEffect, fresh_columns, parameters_of
from phaselead.gap.posterior.before import before_record
from phaselead.gap.residual import ModelledRun, base_entries
from phaselead.record import Samples

FALLS_BY = 4.0
"""By which the power of what a model misses falls an octave away from the signal that it misses: its harmonics, and
what a jump leaves, fall as the inverse of the frequency."""
CARRIED_OVER_s = 0.005
"""At the beginning of a record in which a dead time or a lag still carries what went before: those of amplifiers,
sensors and buses have ended by then."""
REMEMBERED = 128
"""Columns of a record that are kept, those of the sets of effects that were asked for last."""

Counts = NDArray[np.intp]
"""Whole numbers, (k,)."""


@dataclass(frozen=True)
class Simulated:
    """What a set of effects does in one record, as coefficients; in a reference record they do nothing."""

    columns: Samples
    """(n - 1, p + b + 1) tangents of all p parameters, b things that slow effects had done before the record began, one
    prior deviation each, and the residual. Of a reference record the residual alone."""
    tangents: int
    """p, of a reference record 0."""
    power: Samples
    """(entries, blocks) mean power of what each effect adds to the others."""
    of_effects: tuple[int, ...]
    """(b,) The entry that had done each of the b things before."""

    @property
    def before(self) -> Samples:
        """(n - 1, b) of the columns."""
        return self.columns[:, self.tangents : -1]

    def of_tangents(self, p: int) -> Samples:
        """(n - 1, p) of all parameters; of a reference record zeros."""
        return self.columns[:, :p] if self.tangents else np.zeros((len(self.columns), p))


@dataclass(frozen=True)
class BlockedRun:
    """A run under its base, in octaves."""

    modelled: ModelledRun
    usual_um: float
    """Deviation of what the base leaves: how surely a record tells where its plays stood."""
    _known: dict[tuple[object, ...], Simulated] = field(default_factory=dict, compare=False)
    """What was simulated last, by effects and parameters."""

    @property
    def skipped(self) -> int:
        """Rows at its beginning that do not count."""
        run = self.modelled.run
        return run.stop - run.start - self.rows

    @cached_property
    def rows(self) -> int:
        """How many count, n, of small prime factors: the transform of a number with large ones takes ten times as
        long. Of a thousand rows and more at most 2.2 % are lost."""
        run = self.modelled.run
        scored = run.stop - run.start
        most = scored - min(round(CARRIED_OVER_s / run.step_s), scored // 2)
        return next(n for n in range(most, 0, -1) if next_fast_len(n) == n)

    @cached_property
    def edges(self) -> Counts:
        """Coefficients at which the octaves begin, and their number."""
        n = self.rows
        return np.array([*(2**i for i in range(int(np.log2(n - 1)) + 1)), n], dtype=np.intp) - 1

    @cached_property
    def sizes(self) -> Counts:
        """Coefficients (blocks,) of each octave."""
        return np.asarray(np.diff(self.edges))

    @cached_property
    def octaves(self) -> Counts:
        """Octave (blocks,) above 1 Hz of each block, a whole number."""
        middle_Hz = (self.edges[:-1] + self.edges[1:] + 1) / (4 * self.rows * self.modelled.run.step_s)
        return np.round(np.log2(middle_Hz)).astype(np.intp)

    def coefficients(self, columns: Samples) -> Samples:
        """Cosine coefficients (n - 1, k) of columns (n + skipped, k) in um over the scored rows, without the record's
        own offset, the start of its plays and what the base's own lags and modes still carry from before it."""
        kept = columns[self.skipped :].T  # a column in one piece of memory is transformed in half the time
        centred = kept - kept.mean(axis=1, keepdims=True)
        started, root = self._started
        if started.shape[1]:
            centred -= centred @ started @ root @ started.T
        return np.asarray(dct(centred, axis=1, norm="ortho", overwrite_x=True)[:, 1:].T)

    @cached_property
    def _started(self) -> tuple[Samples, Samples]:
        """Columns (n, k) of where the base may have stood when the record began, and (k, k) to project them out."""
        before = before_record(self.modelled, base_entries(self.modelled.axis))
        columns = np.concatenate([self.modelled.nuisances[:, 1:], *before], axis=1)[self.skipped :]
        columns = columns - columns.mean(axis=0)
        normal = columns.T @ columns + self.usual_um**2 * np.eye(columns.shape[1])
        return columns, np.linalg.inv(normal)

    def products(self, left: Samples, right: Samples) -> Samples:
        """Mean products (blocks, k, q) within each octave of coefficients (n - 1, k) and (n - 1, q)."""
        found: Samples = np.empty((len(self.sizes), left.shape[1], right.shape[1]))
        for one, (a, b) in zip(found, pairwise(self.edges.tolist()), strict=True):
            np.matmul(left[a:b].T, right[a:b], out=one)
        return found / self.sizes[:, None, None]

    @property
    def changed(self) -> bool:
        """Whether effects may act in it: it is no reference."""
        return self.modelled.run.role != "reference"

    @cached_property
    def motion(self) -> Samples:
        """Mean power (blocks,) in um^2 of the base's answer, spread over the octaves beside its own."""
        return self.spread(self.power(self.modelled.answer()))

    @cached_property
    def base_error(self) -> Samples:
        """Coefficients (n - 1, 1) of what the base leaves."""
        return self.coefficients(self.modelled.error()[:, None])

    @cached_property
    def base_left_um2(self) -> Samples:
        """Mean power (blocks,) of what the base leaves."""
        return self.products(self.base_error, self.base_error)[:, 0, 0]

    def simulated(self, entries: Sequence[SizedEffect]) -> Simulated:
        """What a set of effects does in the record."""
        key = tuple((id(effect), *(params[p.name] for p in effect.parameters)) for effect, params in entries)
        if key in self._known:
            self._known[key] = self._known.pop(key)  # the most recent is the last
            return self._known[key]
        found = self._known[key] = self._simulated(tuple(entries))
        while len(self._known) > 1 and sum(one.columns.shape[1] for one in self._known.values()) > REMEMBERED:
            del self._known[next(iter(self._known))]
        return found

    def _simulated(self, entries: tuple[SizedEffect, ...]) -> Simulated:
        if not self.changed:
            return Simulated(self.base_error, 0, np.zeros((len(entries), len(self.sizes))), ())
        answer, e, p = self.modelled.answer(entries), len(entries), len(parameters_of(entries))
        added = [answer - self.modelled.answer([*entries[:i], *entries[i + 1 :]]) for i in range(e)]
        fresh = fresh_columns(self.modelled, entries)
        before = before_record(self.modelled, entries)
        each = [np.array(added).reshape(e, len(answer)), fresh.T[:-1], *(one.T for one in before), fresh.T[-1:]]
        columns = self.coefficients(np.concatenate(each).T)
        squares = np.add.reduceat(columns[:, :e] ** 2, self.edges[:-1], axis=0).T
        of = tuple(i for i, part in enumerate(before) for _ in range(part.shape[1]))
        return Simulated(columns[:, e:].copy(order="K"), p, squares / self.sizes, of)

    def power(self, column: Samples) -> Samples:
        """Mean power (blocks,) in um^2 of a column (n + skipped,) in um."""
        c = self.coefficients(column[:, None])
        return self.products(c, c)[:, 0, 0]

    def spread(self, power: Samples) -> Samples:
        """The same power (..., blocks), spread over the octaves beside its own."""
        apart = np.abs(np.arange(len(self.sizes))[:, None] - np.arange(len(self.sizes)))
        share = FALLS_BY ** -apart.astype(float)
        return np.asarray((power * self.sizes) @ (share / share.sum(axis=0)).T / self.sizes)


def blocked(runs: Sequence[ModelledRun]) -> list[BlockedRun]:
    """The runs in octaves."""
    references = [m for m in runs if m.run.role == "reference"]
    usual_um = float(np.sqrt(np.mean([np.var(m.error()) for m in references or runs])))
    return [BlockedRun(m, max(usual_um, 1e-12)) for m in runs]
