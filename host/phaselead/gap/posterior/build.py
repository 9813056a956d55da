"""The space of one axis, made of its regression problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.metric import Regressors
from phaselead.gap.posterior.misfit import as_fault, base_misfit
from phaselead.gap.posterior.space import Space, SpaceRecord, compact, likeliest_spread
from phaselead.gap.problem import Problem
from phaselead.gap.refit import SizedEffect
from phaselead.gap.regressors import simulated_regressors
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

NEGLIGIBLE = 0.05
"""Whitened squares that a base column may have in all records together and still be left out: no log evidence changes
by more than half of it."""

BASE_GROUPS = ("gain", "operator", "own parameters")
"""Names of the columns of the base's own parameters."""
UNTOLD_OWN = 0.2
"""Of what the base misses, by how much it differs from record to record where no reference record tells."""


def space_of(problem: Problem, faults: Sequence[Sequence[SizedEffect]] = ()) -> Space:
    """The space of all records of a problem.

    In the space the base may miss, by what the reference records make likely: anything of the catalogue at a few
    shapes, its own parameters, shares of its own signals, what fades since before a record, a mode anywhere, and the
    effects ``faults`` as they are. Without reference records it may miss by their prior deviations its own parameters,
    shares of its own signals and what fades.
    """
    parts = [part for part in (problem.train_common, problem.holdout, problem.reference) if part is not None]
    records, names = [], _known_names(problem)
    for part in parts:
        for i, modelled in enumerate(part.metric.modelled_runs):
            more, more_names = _columns(problem, modelled, faults)
            white = part.metric.project(i, more)
            records.append(SpaceRecord(modelled, part.metric, i, np.concatenate([_known(part, i), white], axis=1)))
    names += more_names
    shared, own = _spread(records, names, problem)
    return compact(records, shared, own, NEGLIGIBLE)


def missed_columns(problem: Problem, modelled: ModelledRun, faults: Sequence[Sequence[SizedEffect]]) -> Samples:
    """Columns (n, p) in um over the scored rows of one run of what the base may miss, those of ``space_of`` in its
    order before they are joined."""
    known = simulated_regressors(modelled, problem.layout.coarser().groups, problem.freedom).columns
    return np.concatenate([known, _columns(problem, modelled, faults)[0]], axis=1)


def _spread(records: Sequence[SpaceRecord], names: Sequence[str], problem: Problem) -> tuple[Samples, Samples]:
    """Deviations (k,) of the amounts of the columns of these names that all records share, and of each one's own."""
    reference = [record for record in records if not record.changed]
    if reference:
        errors = [r.metric.project(r.index, r.modelled.error()[:, None])[:, 0] for r in reference]
        groups = {name: i for i, name in enumerate(dict.fromkeys(names))}
        return likeliest_spread(reference, errors, np.array([groups[name] for name in names]))
    own_fault = {*BASE_GROUPS, *base_misfit(records[0].modelled)[1]}
    shared = np.array([float(name in own_fault and not problem.frozen) for name in names])
    return shared, UNTOLD_OWN * shared


def _columns(
    problem: Problem, modelled: ModelledRun, faults: Sequence[Sequence[SizedEffect]]
) -> tuple[Samples, list[str]]:
    """Columns (n, k) in um beyond those that the problem has already, and the group of each."""
    bends, names = base_misfit(modelled)
    answer = modelled.answer()
    modes = [
        modelled.answer([(group.effect, group.params([1.0]))]) - answer
        for group in problem.layout.groups
        if group.effect.peak is not None
    ]
    parts = [bends, *(mode[:, None] for mode in modes)]
    names = [*names, *["mode"] * len(modes)]
    for entries in faults:
        parts.append(as_fault(modelled, entries))
        names += [f"{entries[0][0].name} as it is"] * parts[-1].shape[1]
    return np.concatenate(parts, axis=1), names


def _known(part: Regressors, index: int) -> Samples:
    """Common columns (n, k) of one run, whitened."""
    columns = np.zeros((len(part.projected[index]), part.size))
    columns[:, part.live] = part.projected[index]
    return columns


def _known_names(problem: Problem) -> list[str]:
    """Per common column its group: an effect, or a part of the base's own."""
    coarse, effects = problem.layout.coarser(), problem.axis.effects
    names = [group.effect.name for group in coarse.groups for _ in group.steps]
    numbers = [v if isinstance(v, tuple) else (v,) for e in effects for v in e.params.values()]
    own = 1 + sum(isinstance(number, float) for several in numbers for number in several)
    if not problem.freedom.learned:
        own = 0
    gain, operator, others = BASE_GROUPS
    return [*names, gain, *[operator] * (coarse.n_base - 1 - own), *[others] * own]
