"""95 % intervals of parameters: from the covariance of the posterior, widened by how far the adopted values lie from
its most likely ones, and ending where the range of the catalogue ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.findings import TWO_SIDED_95, Estimate
from phaselead.gap.parameters import SizedEffect, from_internal, internal, is_logarithmic, parameters_of
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.model import Effect
from phaselead.record import Samples


def intervals(
    entries: Sequence[SizedEffect], covariance: Samples, chosen: Sequence[SizedEffect] | None = None
) -> list[dict[str, Estimate]]:
    """Value, unit and interval of every parameter of every effect, from the covariance (parameters, parameters) in
    internal units about ``entries``. An interval ends where the catalogue does. The values are those of ``chosen``, by
    default the same; by how much two ways to weigh the same records differ, either may be off to either side.

    An effect of no size has no shape: whether a size is clear of nothing is asked at the shapes that were found. One
    that is, but whose interval would hold nothing, has one that reaches as far in its logarithm."""
    values = entries if chosen is None else chosen
    at, middle = internal(values), internal(entries)
    reach = TWO_SIDED_95 * np.sqrt(np.maximum(np.diag(covariance), 0.0)) + np.abs(at - middle)
    nearest = TWO_SIDED_95 * _at_given_shapes(entries, covariance) + np.abs(at - middle)
    found: list[dict[str, Estimate]] = [{} for _ in entries]
    for k, (i, p) in enumerate(parameters_of(entries)):
        value = float(values[i][1][p.name])
        if p.role == "size" and not is_logarithmic(p) and nearest[k] < abs(at[k]) <= reach[k]:
            ends = at[k] * np.exp(np.array([-1, 1]) * reach[k] / abs(at[k]))
        else:
            ends = at[k] + np.array([-1, 1]) * reach[k]
        low, high = sorted(from_internal(p, float(end)) for end in ends)
        found[i][p.name] = (value, p.unit, (min(low, value), max(high, value)))
    return found


def _at_given_shapes(entries: Sequence[SizedEffect], covariance: Samples) -> Samples:
    """Deviations (parameters,) in internal units, of an effect's sizes at its shapes as they are."""
    of = parameters_of(entries)
    precision, found = np.linalg.inv(covariance), np.zeros(len(of))
    for i in range(len(entries)):
        kept = np.array([j != i or p.role == "size" for j, p in of])
        mine = np.array([j == i and p.role == "size" for j, p in of])
        variances = np.diag(np.linalg.inv(precision[np.ix_(kept, kept)]))
        found[mine] = np.sqrt(np.maximum(variances[mine[kept]], 0.0))
    return found


def intervals_alone(likelihood: Likelihood, entries: Sequence[SizedEffect]) -> list[dict[str, Estimate]]:
    """``intervals`` of effects that were fitted outside a contest."""
    return intervals(entries, likelihood.fit(entries, steps=0).covariance)


def shows_itself(effect: Effect, found: Mapping[str, Estimate]) -> bool:
    """Whether the interval of a size by which an effect bears its name is clear of nothing; an effect without sizes
    does."""
    sizes = [p for p in effect.sizes if not p.nameless]
    return not sizes or any(low > 0 or high < 0 for _, _, (low, high) in (found[p.name] for p in sizes))
