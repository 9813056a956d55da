"""Joint nonlinear refit of effects in the metric: steps of Levenberg and Marquardt on moments.

The residual and its tangents are simulated exactly; each record's nuisances and what the base may absorb are projected
out in every step (variable projection, Golub and Pereyra 1973), so the parameters come out as if all had been fitted
together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve

from phaselead.gap.discrepancy import Discrepancy
from phaselead.gap.metric import Regressors
from phaselead.gap.regressors import HIGHEST_OF_RATE
from phaselead.gap.residual import ModelledRun
from phaselead.identify import descend
from phaselead.model import Effect, Parameter
from phaselead.record import Samples

SizedEffect = tuple[Effect, Mapping[str, float]]
"""An effect and its parameters, each a single number."""

MOST_REFIT_STEPS = 12
"""Of a refit, unless it ends before by LEAST_STEP_GAIN."""
DIFFERENCE = 0.01
"""Finite difference for a tangent, in internal units."""
LEAST_STEP_GAIN = 0.05
"""A step that gains less than this in whitened squares ends the fit."""
DAMPINGS, FIRST_DAMPING, LEAST_DAMPING = 5, 1e-3, 1e-8
"""How many are tried in one step, and their values as a share of the normal matrix's diagonal: the first, the least."""
CALMER, CALMED_FROM, BOLDER = 8, 1e-4, 5
"""Factors by which the damping grows, from the second at least, after a step that gained nothing, and by which it falls
after one that did."""


@dataclass(frozen=True)
class Fitted:
    """Effects whose parameters were fitted together."""

    entries: tuple[SizedEffect, ...]
    squares: float
    """Whitened squares that they leave of the training runs."""

    @property
    def free(self) -> list[tuple[int, Parameter]]:
        """Every parameter, each after the number of the entry that it belongs to."""
        return parameters_of(self.entries)


def refit(
    regressors: Regressors, discrepancy: Discrepancy, start: Sequence[SizedEffect], steps: int = MOST_REFIT_STEPS
) -> Fitted:
    """The effects ``start`` at the parameters, all free, that leave least, found in ``steps`` at most from where they
    are.

    ``regressors`` and ``discrepancy`` are of the common columns. A frequency stays below what the sampling can show.
    """
    highest_Hz = HIGHEST_OF_RATE / regressors.metric.modelled_runs[0].run.step_s
    start = [(_sampled(effect, highest_Hz), params) for effect, params in start]
    conditional = _Conditional(regressors, discrepancy)
    first = _Damped(Fitted(tuple(start), conditional.squares_left(start)), FIRST_DAMPING)
    found = descend(
        first,
        lambda at: _trials(regressors, conditional, at),
        lambda at: at.fitted.squares,
        steps if first.fitted.free else 0,
        least_saved=LEAST_STEP_GAIN,
    )
    return found.fitted


@dataclass(frozen=True)
class _Damped:
    """A point of the search and the damping of the next step."""

    fitted: Fitted
    damping: float


def _trials(regressors: Regressors, conditional: _Conditional, at: _Damped) -> Iterator[_Damped]:
    """Effects a damped Gauss-Newton step away, ever more damped."""
    left = conditional.moments(_total(regressors, at.fitted))
    normal, right = left[:-1, :-1], left[:-1, -1]
    damping = at.damping
    for _ in range(DAMPINGS):
        step: Samples = np.asarray(np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), right))
        moved = _moved(at.fitted, step)
        yield _Damped(Fitted(tuple(moved), conditional.squares_left(moved)), max(damping / BOLDER, LEAST_DAMPING))
        damping = max(damping, CALMED_FROM) * CALMER


def _sampled(effect: Effect, highest_Hz: float) -> Effect:
    """The effect with its frequencies bounded by ``highest_Hz``, those that would have no room left as they are."""
    if not any(p.unit == "Hz" and p.high > highest_Hz > p.low for p in effect.parameters):
        return effect
    limited = (replace(p, high=highest_Hz) if p.unit == "Hz" and p.high > highest_Hz else p for p in effect.parameters)
    return replace(effect, parameters=tuple(limited))


class _Conditional:
    """Moments of fresh columns conditional on the common columns, whose own moments stay the same."""

    def __init__(self, regressors: Regressors, discrepancy: Discrepancy) -> None:
        self._regressors, self._discrepancy = regressors, discrepancy
        self._factor = discrepancy.factor(regressors.fixed_total)

    def moments(self, total: Samples) -> Samples:
        """Moments (q, q) of the fresh columns, the residual last, from the sum (k + q, k + q) of all."""
        k = self._regressors.size
        shifted = self._discrepancy.mean_removed(total, len(total) - 1)
        taken = shifted[self._discrepancy.index, k:]
        return np.asarray(shifted[k:, k:] - taken.T @ cho_solve(self._factor, taken, check_finite=False))

    def squares_left(self, entries: Sequence[SizedEffect]) -> float:
        """Whitened squares that the effects leave of the runs."""
        residuals = [modelled.error(entries)[:, None] for modelled in self._regressors.metric.modelled_runs]
        return float(self.moments(self._regressors.total_with_columns(residuals))[-1, -1])


def _total(regressors: Regressors, fitted: Fitted) -> Samples:
    """Sum (k, k) of the moments of [common columns, tangents, residual]."""
    return regressors.total_with_columns(
        [fresh_columns(t, fitted.entries, fitted.free) for t in regressors.metric.modelled_runs]
    )


def fresh_columns(
    modelled: ModelledRun, entries: Sequence[SizedEffect], free: Sequence[tuple[int, Parameter]]
) -> Samples:
    """Columns (n, tangents + 1) in um over the scored rows of one run: what one internal unit of each free parameter
    does, by finite differences, and the residual last."""
    answer = modelled.answer(entries)
    columns = [(modelled.answer(_changed(entries, i, p, d)) - answer) / d for i, p, d in _differences(entries, free)]
    return np.stack([*columns, modelled.run.x_um[modelled.run.rows] - answer], axis=1)


def squares_left(regressors: Regressors, discrepancy: Discrepancy, entries: Sequence[SizedEffect]) -> float:
    """Whitened squares that the effects leave, common columns projected out."""
    return _Conditional(regressors, discrepancy).squares_left(entries)


def conditional_moments(regressors: Regressors, discrepancy: Discrepancy, fresh: Sequence[Samples]) -> Samples:
    """Moments (q, q) of fresh columns, (n, q) in um per run and the residual last, conditional on the common
    columns."""
    return _Conditional(regressors, discrepancy).moments(regressors.total_with_columns(fresh))


def parameters_of(entries: Sequence[SizedEffect]) -> list[tuple[int, Parameter]]:
    """Every parameter, after the number of the entry it belongs to."""
    return [(i, p) for i, (effect, _) in enumerate(entries) for p in effect.parameters]


def bounded(effect: Effect, params: Mapping[str, float]) -> dict[str, float]:
    """The parameters, those out of their bounds moved to the nearest."""
    return {p.name: float(np.clip(params[p.name], p.low, p.high)) for p in effect.parameters}


def _differences(
    entries: Sequence[SizedEffect], free: Sequence[tuple[int, Parameter]]
) -> list[tuple[int, Parameter, float]]:
    """A finite difference in internal units for each free parameter, towards the inside of its bounds."""
    found = []
    for i, p in free:
        at = to_internal(p, entries[i][1][p.name])
        inside = at + DIFFERENCE < to_internal(p, p.high)
        found.append((i, p, DIFFERENCE if inside else -DIFFERENCE))
    return found


def _changed(entries: Sequence[SizedEffect], index: int, p: Parameter, change: float) -> list[SizedEffect]:
    """The entries with one parameter of one of them changed, in internal units."""
    changed = list(entries)
    effect, params = entries[index]
    changed[index] = (effect, {**params, p.name: from_internal(p, to_internal(p, params[p.name]) + change)})
    return changed


def _moved(fitted: Fitted, step: Samples) -> list[SizedEffect]:
    """The entries after a step (tangents,) in internal units, at most a factor e in what is logarithmic."""
    moved = [(effect, dict(params)) for effect, params in fitted.entries]
    for (i, p), change in zip(fitted.free, step, strict=True):
        limited = float(np.clip(change, -1.0, 1.0)) if is_logarithmic(p) else float(change)
        moved[i][1][p.name] = from_internal(p, to_internal(p, moved[i][1][p.name]) + limited)
    return list(moved)


def to_internal(p: Parameter, value: float) -> float:
    """A value in internal units: its logarithm where the parameter is logarithmic, in typical values otherwise."""
    return float(np.log(value)) if is_logarithmic(p) else value / internal_unit(p)


def from_internal(p: Parameter, value: float) -> float:
    """Back from the internal unit, within the bounds."""
    with np.errstate(over="ignore"):  # an overflow is clipped to the bound
        return float(np.clip(np.exp(value) if is_logarithmic(p) else value * internal_unit(p), p.low, p.high))


def is_logarithmic(p: Parameter) -> bool:
    """Whether it is fitted as its logarithm: what has a logarithmic scale and cannot be 0, as a size must be able
    to."""
    return p.log and p.low > 0


def internal(entries: Sequence[SizedEffect]) -> Samples:
    """All parameters in internal units, (parameters,)."""
    return np.array([to_internal(p, entries[i][1][p.name]) for i, p in parameters_of(entries)])


def internal_unit(p: Parameter) -> float:
    """One internal unit of a parameter that is not logarithmic."""
    return abs(p.typical) if p.typical else (p.high - p.low) / 10
