"""95 % intervals of parameters: from the covariance of the posterior, widened by how far the adopted values lie from
its most likely ones, and ending where the range of the catalogue ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from phaselead.gap.error_rates import INSIDE, TWO_SIDED_95
from phaselead.gap.findings import Estimate, Posterior
from phaselead.gap.parameters import AT_END, SizedEffect, from_internal, internal, is_logarithmic, parameters_of
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.record import Samples

NUDGE = 1e-4
"""In internal units, for slopes."""


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
    clear = np.zeros(len(at), dtype=bool)
    for sizes, variances in _sizes_at_their_shapes(entries, covariance):
        deviations = np.sqrt(np.maximum(np.diag(variances), 0.0))
        clear[sizes] = (deviations > 0) & (np.abs(at[sizes]) > TWO_SIDED_95 * deviations + off[sizes])
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


def _sizes_at_their_shapes(
    entries: Sequence[SizedEffect], covariance: Samples
) -> list[tuple[NDArray[np.intp], Samples]]:
    """Of each effect which parameters are sizes, (sizes,), and their covariance (sizes, sizes) in internal units at its
    shapes as they are."""
    of, found = parameters_of(entries), []
    for i in range(len(entries)):
        sizes = np.array([k for k, (j, p) in enumerate(of) if j == i and p.role == "size"], dtype=np.intp)
        shapes = np.array([k for k, (j, p) in enumerate(of) if j == i and p.role != "size"], dtype=np.intp)
        across = covariance[np.ix_(shapes, sizes)]
        told = np.linalg.solve(covariance[np.ix_(shapes, shapes)], across)
        found.append((sizes, np.asarray(covariance[np.ix_(sizes, sizes)] - across.T @ told)))
    return found


def posteriors(entries: Sequence[SizedEffect], covariance: Samples) -> list[Posterior]:
    """Of each effect, from the covariance (parameters, parameters) in internal units about ``entries``, to first
    order."""
    of, at = parameters_of(entries), internal(entries)
    ends = [[from_internal(p, float(x) + step) for step in (-NUDGE, NUDGE)] for (_, p), x in zip(of, at, strict=True)]
    slopes = np.array([(high - low) / (2 * NUDGE) for low, high in ends])
    whole, effect = covariance * np.outer(slopes, slopes), np.array([i for i, _ in of])
    return [
        Posterior(
            {p.name: params[p.name] for j, p in of if j == i}, np.asarray(whole[np.ix_(effect == i, effect == i)])
        )
        for i, (_, params) in enumerate(entries)
    ]


def intervals_alone(likelihood: Likelihood, entries: Sequence[SizedEffect]) -> list[dict[str, Estimate]]:
    """``intervals`` of effects that were fitted outside a contest."""
    return intervals(entries, likelihood.fit(entries, steps=0).covariance)


def shows_itself(
    entries: Sequence[SizedEffect], covariance: Samples, chosen: Sequence[SizedEffect] | None = None
) -> list[bool]:
    """For each effect, with the same arguments as ``intervals``, whether the region of 95 % of the sizes by which it
    bears its name does not hold 0; an effect without sizes shows itself.

    Of several sizes each may be 0 where all of them cannot: records that tell a bow from an S badly may tell both from
    a straight line. So they are asked together, at the shapes that were found. As far as two ways to weigh the records
    differ the region may be off to either side. Of one size it is its interval."""
    at, middle = internal(entries if chosen is None else chosen), internal(entries)
    of, found = parameters_of(entries), []
    for sizes, variances in _sizes_at_their_shapes(entries, covariance):
        bearing = np.array([not of[k][1].nameless for k in sizes], dtype=bool)
        names, among = sizes[bearing], variances[np.ix_(bearing, bearing)]
        if not len(names) or np.linalg.eigvalsh(among).min() <= 0:
            found.append(not len(names))
            continue
        value, off = at[names], (at - middle)[names]
        towards, along = np.linalg.solve(among, off), 0.0
        if off @ towards > 0:
            along = float(np.clip(value @ towards / (off @ towards), -1.0, 1.0))
        nearest = value - along * off
        found.append(float(nearest @ np.linalg.solve(among, nearest)) > float(chi2.ppf(INSIDE, len(names))))
    return found
