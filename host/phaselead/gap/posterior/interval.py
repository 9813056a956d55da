"""95 % intervals of parameters: from the covariance of the posterior, widened by how far the adopted values lie from
its most likely ones, and ending where the range of the catalogue ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.findings import TWO_SIDED_95, Estimate
from phaselead.gap.parameters import AT_END, SizedEffect, from_internal, internal, is_logarithmic, parameters_of
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.model import Effect
from phaselead.record import Samples


def intervals(
    entries: Sequence[SizedEffect], covariance: Samples, chosen: Sequence[SizedEffect] | None = None
) -> list[dict[str, Estimate]]:
    """Value, unit and interval of every parameter of every effect, from the covariance (parameters, parameters) in
    internal units about ``entries``. An interval ends where the catalogue does. The values are those of ``chosen``, by
    default the same; by how much two ways to weigh the same records differ, either may be off to either side.

    An effect of no size has no shape: whether a size is clear of nothing is asked at the shapes that were found, and
    the interval of one that is ends next to nothing."""
    values = entries if chosen is None else chosen
    at, middle = internal(values), internal(entries)
    off = np.abs(at - middle)
    reach = TWO_SIDED_95 * np.sqrt(np.maximum(np.diag(covariance), 0.0)) + off
    clear = np.abs(at) > TWO_SIDED_95 * _at_given_shapes(entries, covariance) + off
    found: list[dict[str, Estimate]] = [{} for _ in entries]
    for k, (i, p) in enumerate(parameters_of(entries)):
        value = float(values[i][1][p.name])
        ends = [at[k] - reach[k], at[k] + reach[k]]
        if p.role == "size" and not is_logarithmic(p) and clear[k]:
            nearest = 0 if at[k] > 0 else 1
            ends[nearest] = max(ends[nearest] / at[k], AT_END) * at[k]
        low, high = sorted(from_internal(p, float(end)) for end in ends)
        found[i][p.name] = (value, p.unit, (min(low, value), max(high, value)))
    return found


def _at_given_shapes(entries: Sequence[SizedEffect], covariance: Samples) -> Samples:
    """Deviations (parameters,) in internal units, of an effect's sizes at its shapes as they are; of shapes
    infinite."""
    of = parameters_of(entries)
    found: Samples = np.full(len(of), np.inf)
    for i in range(len(entries)):
        sizes = [k for k, (j, p) in enumerate(of) if j == i and p.role == "size"]
        shapes = [k for k, (j, p) in enumerate(of) if j == i and p.role != "size"]
        across = covariance[np.ix_(shapes, sizes)]
        told = np.linalg.solve(covariance[np.ix_(shapes, shapes)], across)
        variances = np.diag(covariance[np.ix_(sizes, sizes)] - across.T @ told)
        found[sizes] = np.where(variances > 0, np.sqrt(np.maximum(variances, 0.0)), np.inf)
    return found


def intervals_alone(likelihood: Likelihood, entries: Sequence[SizedEffect]) -> list[dict[str, Estimate]]:
    """``intervals`` of effects that were fitted outside a contest."""
    return intervals(entries, likelihood.fit(entries, steps=0).covariance)


def shows_itself(effect: Effect, found: Mapping[str, Estimate]) -> bool:
    """Whether the interval of a size by which an effect bears its name is clear of nothing; an effect without sizes
    does."""
    sizes = [p for p in effect.sizes if not p.nameless]
    return not sizes or any(low > 0 or high < 0 for _, _, (low, high) in (found[p.name] for p in sizes))
