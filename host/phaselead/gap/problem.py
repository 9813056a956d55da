"""The regression problem of one axis under one base model: metric, whitened regressors, model discrepancy, noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.discrepancy import (
    Discrepancy,
    discrepancy_prior,
    flexible_residual,
    inflation_by_reference,
    reference_discrepancy,
)
from phaselead.gap.metric import Regressors, fair_weights, metric_of, noise_of, repetition, whitened_regressors
from phaselead.gap.noise import Noise, as_idle
from phaselead.gap.records import GapRun, Role
from phaselead.gap.regressors import (
    Freedom,
    Layout,
    SimulatedRegressors,
    base_columns,
    regressor_groups,
    rich_columns,
    simulated_regressors,
)
from phaselead.gap.residual import ModelledRun, modelled_run
from phaselead.model import AxisModel, Effect
from phaselead.record import Samples

NOISE_ROUNDS = 2
"""In which the noise and what is left for it are found in turn."""
WEIGHT_ROUNDS = 2
"""In which the weights of blocks and what is left of them are found in turn."""


@dataclass(frozen=True)
class Problem:
    """One axis under one base model, ready to be searched. What a search does not ask for is not simulated."""

    axis: AxisModel
    layout: Layout
    modelled_runs: tuple[ModelledRun, ...]
    """Of every role, under the base model."""
    reference: Regressors | None
    """The common columns on the reference runs, where there are any."""
    discrepancy: Discrepancy
    """Of the common columns: those that say what the base misses."""
    noise: Noise
    freedom: Freedom
    frozen: bool
    """Whether nothing may be wrong with the base."""
    of_train: Sequence[SimulatedRegressors] = ()
    """All regressors on the training runs, where the noise was learned from them."""

    @property
    def open_plays(self) -> bool:
        """Whether the base's plays were fitted to the training records."""
        return self.freedom.open_plays

    @property
    def common(self) -> Discrepancy:
        """The discrepancy placed in the full layout."""
        return self.discrepancy.at(self.layout.common())

    def runs(self, role: Role) -> tuple[ModelledRun, ...]:
        """Those of one role."""
        return tuple(m for m in self.modelled_runs if m.run.role == role)

    @cached_property
    def train(self) -> Regressors:
        """All regressors on the training runs."""
        simulated = self.of_train or _simulated(self.runs("train"), self.layout, self.freedom)
        metric = metric_of([one.modelled for one in simulated], self.noise)
        return _weighed(whitened_regressors(metric, self.layout, simulated), simulated, self.common)

    @cached_property
    def train_common(self) -> Regressors:
        """The common columns on the training runs."""
        return self.train.restricted(self.layout.common())

    @cached_property
    def reference_inflation(self) -> Mapping[str, float]:
        """By effect, at least 1: by how much its gains are overstated, as its gains on reference runs say."""
        if self.reference is None:
            return {}
        whole = _simulated(self.runs("reference"), self.layout, self.freedom)
        return inflation_by_reference(
            whitened_regressors(self.reference.metric, self.layout, whole), self.layout, _errors(whole)
        )


def make_problem(
    axis: AxisModel,
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    frozen: bool,
    open_plays: bool = False,
    unwhitened: bool = False,
) -> Problem:
    """The regression problem of ``effects``, which must respond to voltage or time.

    ``frozen``: without reference runs, whether nothing may be wrong with the base. ``open_plays``: its plays were
    fitted to the training runs and move with every effect that is added. ``unwhitened``: squares of micrometres count
    alike at every frequency, as for finding memory that a base lacks; the metric that expects the slow misfit of a
    memory model would forgive just that.
    """
    modelled_runs = tuple(modelled_run(axis, run) for run in runs)
    train, held, reference = (
        [m for m in modelled_runs if m.run.role == role] for role in ("train", "holdout", "reference")
    )
    freedom = Freedom(open_plays, learned=bool(reference))
    longest = max(m.run.t_s[-1] - m.run.t_s[0] for m in train)
    groups = regressor_groups(effects, train[0].run.step_s, float(longest))
    n_base = base_columns(train[0], freedom).shape[1]
    layout = Layout(tuple(groups), n_base)
    on_reference: Regressors | None = None
    of_train: Sequence[SimulatedRegressors] = ()
    if reference:
        noise, on_reference, discrepancy = _from_reference(_simulated(reference, layout.coarser(), freedom), layout)
        noise = as_idle(noise, [m.error() for m in [*train, *held] if m.run.idle])
    else:
        discrepancy = discrepancy_prior(layout.coarser(), frozen)
        of_train = _simulated(train, layout, freedom)
        noise = _from_training(of_train, layout, discrepancy)
    if unwhitened:
        noise = Noise(np.ones(1), noise.level_um, 0.0, 1.0, 0.0, np.ones(1))
    return Problem(axis, layout, modelled_runs, on_reference, discrepancy, noise, freedom, frozen, of_train)


def _simulated(runs: Sequence[ModelledRun], layout: Layout, freedom: Freedom) -> list[SimulatedRegressors]:
    """The regressors of a layout on some runs."""
    return [simulated_regressors(m, layout.groups, freedom) for m in runs]


def _errors(simulated: Sequence[SimulatedRegressors]) -> list[Samples]:
    """Measured minus modelled position (n,) in um per run."""
    return [np.asarray(r.modelled.run.x_um[r.modelled.run.rows] - r.base_um) for r in simulated]


def _from_reference(common: Sequence[SimulatedRegressors], layout: Layout) -> tuple[Noise, Regressors, Discrepancy]:
    """What the reference runs tell: noise, their common columns in its metric, the base's discrepancy.

    The noise is what the catalogue cannot describe of the base's misfit.
    """
    runs, errors = [r.modelled for r in common], _errors(common)
    noise = noise_of(runs, [_detrended(e, r.modelled) for e, r in zip(errors, common, strict=True)])
    for _ in range(NOISE_ROUNDS):
        found = whitened_regressors(metric_of(runs, noise), layout.coarser(), common)
        discrepancy, _ = reference_discrepancy(found, errors)
        rest = [_detrended(e - r.columns @ discrepancy.mean, r.modelled) for e, r in zip(errors, common, strict=True)]
        noise = noise_of(runs, rest)
    found = whitened_regressors(metric_of(runs, noise), layout.coarser(), common)
    discrepancy, weights = reference_discrepancy(found, errors)
    return noise, found.reweighted(weights), discrepancy


def _from_training(simulated: Sequence[SimulatedRegressors], layout: Layout, discrepancy: Discrepancy) -> Noise:
    """Noise without reference runs: what neither a combination of effects nor a rich operator explains of training."""
    richer = [replace(r, columns=np.concatenate([r.columns, _rich(r.modelled)], axis=1)) for r in simulated]
    runs, errors = [r.modelled for r in simulated], _errors(simulated)
    noise = noise_of(runs, [_explained(e, r) for e, r in zip(errors, richer, strict=True)])
    for _ in range(NOISE_ROUNDS):
        found = whitened_regressors(metric_of(runs, noise), layout, richer)
        moments = found.with_columns([e[:, None] for e in errors])
        amounts = flexible_residual(moments, discrepancy.at(layout.common()), np.arange(found.size), found.size)
        rest = [_detrended(e + r.columns @ amounts[:-1], r.modelled) for e, r in zip(errors, richer, strict=True)]
        noise = noise_of(runs, rest)
    return noise


def _rich(modelled: ModelledRun) -> NDArray[np.float32]:
    """Columns (n, k) of a rich operator."""
    return rich_columns(modelled).astype(np.float32)


def _explained(error: Samples, by: SimulatedRegressors) -> Samples:
    """What ordinary least squares with all columns leaves of a residual (n,): a first guess."""
    columns = np.concatenate([by.modelled.nuisances, by.columns], axis=1)
    live = columns[:, np.ptp(columns, axis=0) > 0]
    columns = np.concatenate([np.ones((len(error), 1)), live], axis=1)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    amounts, *_ = np.linalg.lstsq(columns / scale, error, rcond=1e-6)
    return np.asarray(error - (columns / scale) @ amounts)


def _detrended(error: Samples, modelled: ModelledRun) -> Samples:
    """A residual (n,) without what the run's own nuisances explain of it."""
    amounts, *_ = np.linalg.lstsq(modelled.nuisances, error, rcond=1e-8)
    return np.asarray(error - modelled.nuisances @ amounts)


def _weighed(found: Regressors, simulated: Sequence[SimulatedRegressors], discrepancy: Discrepancy) -> Regressors:
    """The same with weights that make what flexible regressors leave of each block as large as the whitener
    promised."""
    errors = _errors(simulated)
    rows = [np.diff(e).astype(np.float64) for e in found.metric.edges]
    for _ in range(WEIGHT_ROUNDS):
        moments = found.with_columns([e[:, None] for e in errors])
        amounts = flexible_residual(moments, discrepancy, np.arange(found.size), found.size)
        left = found.unweighted(np.einsum("i,bij,j->b", amounts, moments, amounts))
        again = [_repeated(found, i, amounts, e) for i, e in enumerate(errors)]
        found = found.reweighted([fair_weights(part, r, n) for part, r, n in zip(left, rows, again, strict=True)])
    return found


def _repeated(found: Regressors, index: int, amounts: Samples, error: Samples) -> float:
    """By how much what flexible regressors leave of a run only repeats itself from period to period."""
    white = found.projected[index] @ amounts[found.live] + found.metric.project(index, error[:, None])[:, 0]
    return repetition(white, found.metric.modelled_runs[index].period_rows)
