"""What the records say of the size of an effect that is not in a set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.metric import Regressors
from phaselead.gap.posterior.evidence import FITTED_AT, Solver
from phaselead.gap.posterior.misfit import equation_misfit
from phaselead.gap.posterior.space import Columns, SpaceRecord, joined
from phaselead.gap.refit import SizedEffect
from phaselead.gap.regressors import RegressorGroup
from phaselead.record import Samples


@dataclass(frozen=True)
class Beside:
    """A set of effects, with all that is uncertain about it integrated out. Held-out records have no part."""

    solver: Solver
    entries: tuple[SizedEffect, ...]
    residual: Columns
    products: Callable[[Columns], Samples]
    """Of columns with each other, (k, k)."""

    def moments(self, train: Regressors) -> Samples:
        """Products (k + 1, k + 1) of all columns of the training records, whose effects stand beside the set, and of
        the residual."""
        wide = []
        for projected in train.projected:
            wide.append(np.zeros((len(projected), train.size)))
            wide[-1][:, train.live] = projected
        rest = [None] * (len(self.solver.space.records) - len(wide))
        return self.products(joined(self.solver.space.from_white([*wide, *rest]), self.residual))

    def own_moments(self, group: RegressorGroup) -> Samples:
        """Products of the columns of one effect at one shape, of what its equation misses of a step of its first size,
        and of the residual."""
        params = group.params([float(i == 0) for i in range(len(group.steps))])
        entries = [*self.entries, (group.effect, params)]

        def of(record: SpaceRecord) -> Samples:
            without = record.modelled.answer(self.entries)
            signal = group.columns(record.modelled, without, self.entries)
            return np.concatenate([signal, equation_misfit(record.modelled, entries, len(entries) - 1)], axis=1)

        return self.products(joined(self.solver.changed_columns(of), self.residual))

    def with_own_misfit(self, moments: Samples, sizes: int, steps: float) -> Samples:
        """From these the products (sizes + 1, sizes + 1) of the effect's columns and the residual, what its equation
        misses of so many steps integrated out."""
        missed = np.arange(sizes, len(moments) - 1)
        kept = np.array([*range(sizes), len(moments) - 1])
        cross = moments[np.ix_(missed, kept)]
        inner = moments[np.ix_(missed, missed)] + np.eye(len(missed)) / (FITTED_AT * max(steps, 1e-9)) ** 2
        return np.asarray(moments[np.ix_(kept, kept)] - cross.T @ cho_solve(cho_factor(inner), cross))


def beside(solver: Solver, entries: Sequence[SizedEffect]) -> Beside:
    """The set of effects ``entries``, which may be empty."""
    return Beside(solver, tuple(entries), solver.residual(entries), solver.products_beside(entries))
