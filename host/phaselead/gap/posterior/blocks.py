"""Records in blocks: what a column or a residual is in each octave of frequency.

A record becomes its cosine coefficients, which have no jump at its ends, and these are gathered by octave. Within an
octave only the mean power counts, so that nothing is asked of the shape of what a model misses, only how large it is.
In front of the octaves stands the record's level, the mean of the rows that count: by itself it says nothing, since the
zero of a session is anywhere, but from record to record it says how the zero moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.fft import dct, next_fast_len

from phaselead.gap.history import Stood, amounts_stood, before_record, with_stood
from phaselead.gap.parameters import SizedEffect, fresh_columns, parameters_of
from phaselead.gap.posterior.moments import Integers
from phaselead.gap.records import GapRun, taken_at_once
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
FEWEST_LEVELS = 3
"""Driven reference records from which it can be told how their levels scatter."""
OF_LEVEL = -99
"""In place of its octave, the block of a record's level."""


@dataclass(frozen=True)
class Simulated:
    """What a set of effects does in one record, as coefficients; in a reference record they do nothing."""

    columns: Samples
    """(n, p + b + 1) tangents of all p parameters, b things that slow effects had done before the record began, one
    prior deviation each, and the residual. Of a reference record the residual alone."""
    tangents: int
    """p, of a reference record 0."""
    power: Samples
    """(entries, blocks) mean power of what each effect adds beside the others. A level counts as it is, not about the
    mean of its session."""
    first: Samples
    """(entries,) first coefficient of the same, the level if that is one."""
    of_effects: tuple[int, ...]
    """(b,) The entry that had done each of the b things before."""
    moved_before: Samples
    """(blocks,) mean power of how what had stood off as a voltage moves the stage, spread."""

    @property
    def before(self) -> Samples:
        """(n, b) of the columns."""
        return self.columns[:, self.tangents : -1]

    def of_tangents(self, p: int) -> Samples:
        """(n, p) of all parameters; of a reference record zeros."""
        return self.columns[:, :p] if self.tangents else np.zeros((len(self.columns), p))


@dataclass(frozen=True)
class BlockedRun:
    """A run under its base, in octaves."""

    modelled: ModelledRun
    usual_um: float
    """Deviation of what the base leaves: how surely a record tells where its plays stood."""
    levelled: bool = False
    """Whether its level says something: then it is the first block."""
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

    @property
    def first_octave(self) -> int:
        """The block behind the level, if that is one."""
        return 1 if self.levelled else 0

    @cached_property
    def _octave_edges(self) -> Integers:
        """Frequencies, in half periods of the record, at which the octaves begin, and the number of rows."""
        return np.array([*(2**i for i in range(int(np.log2(self.rows - 1)) + 1)), self.rows], dtype=np.intp)

    @cached_property
    def edges(self) -> Integers:
        """Coefficients at which the blocks begin, and their number."""
        return np.array([0, *self._octave_edges]) if self.levelled else self._octave_edges - 1

    @cached_property
    def sizes(self) -> Integers:
        """Coefficients (blocks,) of each octave."""
        return np.asarray(np.diff(self.edges))

    @cached_property
    def octaves(self) -> Integers:
        """Octave (blocks,) above 1 Hz of each block, a whole number, or ``OF_LEVEL``."""
        edges = self._octave_edges
        middle_Hz = (edges[:-1] + edges[1:] - 1) / (4 * self.rows * self.modelled.run.step_s)
        return np.array([*[OF_LEVEL] * self.first_octave, *np.round(np.log2(middle_Hz))], dtype=np.intp)

    def coefficients(self, columns: Samples) -> Samples:
        """Cosine coefficients of columns (n + skipped, k) in um over the scored rows, without the record's own offset,
        the start of its plays and what the base's own lags and modes still carry from before it; in front of them the
        mean in um as it is, if ``levelled``: where plays stood is told by what the record looks like, and what looks a
        little like it would move the mean as well. (n, k)"""
        kept = columns[self.skipped :].T  # a column in one piece of memory is transformed in half the time
        level = kept.mean(axis=1, keepdims=True)
        centred = kept - level
        started, root = self._started
        if started.shape[1]:
            centred -= centred @ started @ root @ started.T
        found = dct(centred, axis=1, norm="ortho", overwrite_x=True)
        if not self.levelled:
            return np.asarray(found[:, 1:].T)
        found[:, :1] = level
        return np.asarray(found.T)

    @cached_property
    def _started(self) -> tuple[Samples, Samples]:
        """Columns (n, k) of where the base may have stood when the record began, and (k, k) to project them out."""
        columns = np.concatenate([self.modelled.nuisances[self.skipped :, 1:], self._carried], axis=1)
        columns = columns - columns.mean(axis=0)
        normal = columns.T @ columns + self.usual_um**2 * np.eye(columns.shape[1])
        return columns, np.linalg.inv(normal)

    @cached_property
    def _carried(self) -> Samples:
        """Columns (n, k) in um of what the base's own lags and modes may still carry from before the record, one
        deviation each."""
        before = before_record(self.modelled, base_entries(self.modelled.axis))
        none = np.zeros((self.rows, 0))
        return np.concatenate([none, *(one[self.skipped :] for one in before)], axis=1)

    @property
    def level_carried_um2(self) -> float:
        """Variance of the level by that."""
        return float(np.sum(self._carried.mean(axis=0) ** 2))

    def products(self, left: Samples, right: Samples) -> Samples:
        """Mean products (blocks, k, q) within each block of coefficients (n, k) and (n, q)."""
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
        """Mean power (blocks,) in um^2 of the base's answer, spread over the octaves beside its own. That of
        the level is what its lowest octave brings to a mean, since where the base stands is no motion."""
        found = self.spread(self.power(self.modelled.answer()))
        if self.levelled:
            found[0] = found[1] / self.rows
        return found

    @cached_property
    def base_error(self) -> Samples:
        """Coefficients (n, 1) of what the base leaves."""
        return self.coefficients(self.modelled.error()[:, None])

    @cached_property
    def base_left_um2(self) -> Samples:
        """Mean power (blocks,) of what the base leaves."""
        return self.products(self.base_error, self.base_error)[:, 0, 0]

    def simulated(self, entries: Sequence[SizedEffect], stood: Stood | None = None) -> Simulated:
        """What a set of effects does in the record, beside what it had done before it as a voltage."""
        stood = stood or {}
        parts = [(id(effect), *(params[p.name] for p in effect.parameters)) for effect, params in entries]
        key = (*parts, *stood.items())
        if key in self._known:
            self._known[key] = self._known.pop(key)  # the most recent is the last
            return self._known[key]
        found = self._known[key] = self._simulated(tuple(entries), stood)
        while len(self._known) > 1 and sum(one.columns.shape[1] for one in self._known.values()) > REMEMBERED:
            del self._known[next(iter(self._known))]
        return found

    def error(self, entries: Sequence[SizedEffect], stood: Stood) -> Samples:
        """Coefficients (n, 1) of what is left beside some effects and what had stood off."""
        if not self.changed:
            return self.base_error
        return self.coefficients(self.modelled.error(with_stood(entries, stood))[:, None])

    def _simulated(self, entries: tuple[SizedEffect, ...], stood: Stood) -> Simulated:
        if not self.changed:
            none = np.zeros(len(self.sizes))
            return Simulated(self.base_error, 0, np.tile(none, (len(entries), 1)), np.zeros(len(entries)), (), none)

        def answer_of(some: Sequence[SizedEffect]) -> Samples:
            return self.modelled.answer(with_stood(some, stood))

        answer, e, p = answer_of(entries), len(entries), len(parameters_of(entries))
        # What had stood off is no part of what an effect adds: as an amount it is known apart.
        others = [with_stood([*entries[:i], *entries[i + 1 :]], stood, entries) for i in range(e)]
        added = [answer - self.modelled.answer(some) for some in others]
        fresh = fresh_columns(self.modelled.run, answer_of, entries)
        before = before_record(self.modelled, entries, entries, stood)
        of = tuple(i for i, part in enumerate(before) for _ in range(part.shape[1]))
        # All that had stood off is an amount of its columns, not only what differs from that beside which they are.
        there = np.concatenate([np.zeros((len(answer), 0)), *before], axis=1) @ amounts_stood(entries, of, stood)
        each = [np.array(added).reshape(e, len(answer)), fresh.T[:-1], *(one.T for one in before), fresh.T[-1:] + there]
        columns = self.coefficients(np.concatenate(each).T)
        squares = np.add.reduceat(columns[:, :e] ** 2, self.edges[:-1], axis=0).T
        stands = answer - self.modelled.answer(entries) if there.any() else np.zeros(len(answer))
        moved = self.spread(self.power(stands))
        return Simulated(columns[:, e:].copy(order="K"), p, squares / self.sizes, columns[0, :e].copy(), of, moved)

    def power(self, column: Samples) -> Samples:
        """Mean power (blocks,) in um^2 of a column (n + skipped,) in um."""
        c = self.coefficients(column[:, None])
        return self.products(c, c)[:, 0, 0]

    def spread(self, power: Samples) -> Samples:
        """The same power (..., blocks), spread over the octaves beside its own; that of a level stays."""
        apart = np.abs(np.arange(len(self.sizes))[:, None] - np.arange(len(self.sizes)))
        level = self.octaves == OF_LEVEL
        share = np.where(level[:, None] == level, FALLS_BY ** -apart.astype(float), 0.0)
        return np.asarray((power * self.sizes) @ (share / share.sum(axis=0)).T / self.sizes)


def blocked(runs: Sequence[ModelledRun]) -> list[BlockedRun]:
    """The runs in octaves, behind their levels where these say something: of driven ones, since at rest a stage stands
    where its plays stood, which nobody knows; where reference records tell how they scatter; and where the records of
    every session came one after the other."""
    references = [m for m in runs if m.run.role == "reference"]
    usual_um = max(float(np.sqrt(np.mean([np.var(m.error()) for m in references or runs]))), 1e-12)
    say = levels_say([m.run for m in runs])
    return [BlockedRun(m, usual_um, say and m.run.driven) for m in runs]


def levels_say(runs: Sequence[GapRun]) -> bool:
    """Whether the levels of the driven ones of some runs say something."""
    told = sum(run.driven for run in runs if run.role == "reference") >= FEWEST_LEVELS
    return told and not taken_at_once(runs)
