"""The space of one axis, made of its regression problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.metric import Regressors
from phaselead.gap.posterior.misfit import base_misfit
from phaselead.gap.posterior.space import Space, SpaceRecord, compact, likeliest_spread
from phaselead.gap.problem import Problem
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect
from phaselead.record import Samples
NEGLIGIBLE = 0.05
"""Whitened squares that a base column may have in all records together and still be left out."""


def space_of(problem: Problem, more: Sequence[Sequence[Samples]] = (), names: Sequence[str] = ()) -> Space:
    """The space of all records of a problem, which has reference records.

    ``more``: per record, in the order of training, held-out and reference records, further columns (n,) in um that the
    base may miss, one prior deviation each; ``names`` their groups.
    """
    parts = [problem.train_common, problem.holdout, problem.reference]
    groups = _group_names(problem)
    records: list[SpaceRecord] = []
    for regressors in parts:
        if regressors is None:
            continue
        for i, modelled in enumerate(regressors.metric.modelled_runs):
            known = np.zeros((modelled.run.stop - modelled.run.start, regressors.size))
            known[:, regressors.live] = regressors.projected[i]
            bends, bend_names = base_misfit(modelled)
            modes = _modes(problem, modelled)
            own = more[len(records)] if more else []
            extra = np.column_stack([bends, modes, *own])
            white = regressors.metric.project(i, extra)
            records.append(SpaceRecord(modelled, regressors.metric, i, np.concatenate([known, white], axis=1)))
    labels = [*groups, *bend_names, *["modes"] * modes.shape[1], *names]
    numbered = np.array([list(dict.fromkeys(labels)).index(name) for name in labels])
    reference = [r for r in records if not r.changed]
    errors = [r.metric.project(r.index, r.modelled.error()[:, None])[:, 0] for r in reference]
    shared, own_deviation = likeliest_spread(reference, errors, numbered)
    return compact(records, shared, own_deviation, NEGLIGIBLE)


def _modes(problem: Problem, modelled: ModelledRun) -> Samples:
    """Columns (n, k) in um: a mode of a typical share at each frequency of the catalogue's grid."""
    answer = modelled.answer()
    found = [
        modelled.answer([(group.effect, group.params([1.0]))]) - answer
        for group in problem.layout.groups
        if group.effect.peak is not None
    ]
    return np.stack(found, axis=1) if found else np.zeros((len(answer), 0))


def _group_names(problem: Problem) -> list[str]:
    """Per common column the group that shares its spread: an effect's, or a part of the base's own."""
    coarse = problem.layout.coarser()
    names = [group.effect.name for group in coarse.groups for _ in group.steps]
    axis = problem.axis
    own = 1 + sum(len(v) if isinstance(v, tuple) else 1 for e in axis.effects for v in e.params.values() if isinstance(v, tuple | float))
    return [*names, "gain", *["operator"] * (coarse.n_base - 1 - own), *["own parameters"] * own]
