"""Shapes of the effects of a catalogue, and products of what they add to records, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.moments import Integers
from phaselead.gap.regressors import RegressorGroup, typical_sizes
from phaselead.record import Samples

Coefficients = Sequence[NDArray[np.floating]]
"""Per run those (n, k) of k columns."""


@dataclass(frozen=True)
class Shapes:
    """Shapes of the effects of a catalogue."""

    groups: Sequence[RegressorGroup]
    columns: Sequence[NDArray[np.float32]]
    """Per run the coefficients (n, k) of every group, zeros of a reference."""

    def of(self, name: str) -> list[int]:
        """The groups of one effect at typical sizes."""
        named = [(i, group) for i, group in enumerate(self.groups) if group.effect.name == name]
        return [i for i, group in named if group.steps == typical_sizes(group.effect)]

    def some(self, indices: Sequence[int]) -> Shapes:
        """Some of the groups."""
        begin = self._begin
        columns = np.concatenate([np.arange(begin[i], begin[i + 1]) for i in indices])
        return Shapes([self.groups[i] for i in indices], [of_run[:, columns] for of_run in self.columns])

    def first(self, indices: Sequence[int]) -> Coefficients:
        """Coefficients (n, k) of the first sizes of k groups."""
        return [columns[:, self._begin[list(indices)]] for columns in self.columns]

    @property
    def _begin(self) -> Integers:
        """Columns at which the groups begin, and their number."""
        return np.cumsum([0, *(len(group.steps) for group in self.groups)])


@dataclass(frozen=True, eq=False)
class Added:
    """What effects add to all records, k columns, and what it is beside itself and the shared columns."""

    of_runs: Coefficients
    own: Samples
    """(blocks, k, k) mean products."""
    beside_shared: Samples
    """(blocks, shared, k) the same with the shared columns."""

    @property
    def count(self) -> int:
        """k"""
        return int(self.own.shape[1])

    def one(self, which: int) -> Added:
        """One of them."""
        at = slice(which, which + 1)
        return Added([of_run[:, at] for of_run in self.of_runs], self.own[:, at, at], self.beside_shared[:, :, at])


class Products:
    """Mean products, block by block, of what effects add to the records of a likelihood."""

    def __init__(self, likelihood: Likelihood, shapes: Shapes) -> None:
        self.likelihood, self.shapes = likelihood, shapes
        self._shapes_of: dict[str, Added] = {}

    def added(self, of_runs: Coefficients) -> Added:
        """Of some effects, from what they add."""
        return Added(of_runs, self._between(of_runs, of_runs), self._between(self.likelihood.shared, of_runs))

    def shapes_of(self, name: str) -> Added:
        """The first size of every shape of an effect, worked out once."""
        if name not in self._shapes_of:
            self._shapes_of[name] = self.added(self.shapes.first(self.shapes.of(name)))
        return self._shapes_of[name]

    def first(self, name: str, shape: int) -> Added:
        """The first size of one of these."""
        return self.shapes_of(name).one(shape)

    def across(self, left: Added, right: Added) -> Samples:
        """(blocks, k, q) of two."""
        return left.own if left is right else self._between(left.of_runs, right.of_runs)

    def _between(self, left: Coefficients, right: Coefficients) -> Samples:
        parts = zip(self.likelihood.runs, left, right, strict=True)
        return np.concatenate([run.products(np.asarray(a, float), np.asarray(b, float)) for run, a, b in parts])
