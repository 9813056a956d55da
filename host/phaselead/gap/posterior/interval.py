"""95 % intervals of parameters: from the covariance of the posterior, widened by how far the adopted values lie from
its most likely ones, and ending where the range of the catalogue ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import chi2

from phaselead.gap.error_rates import SURE, TWO_SIDED_95
from phaselead.gap.findings import Estimate, Posterior
from phaselead.gap.parameters import (
    AT_END,
    SizedEffect,
    entries_at,
    from_internal,
    internal,
    is_logarithmic,
    parameters_of,
)
from phaselead.gap.posterior.contest import likelihood_of
from phaselead.gap.posterior.moments import Integers
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.residual import ModelledRun
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


def _sizes_at_their_shapes(entries: Sequence[SizedEffect], covariance: Samples) -> list[tuple[Integers, Samples]]:
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


def deviation_of(quantity: Callable[[Sequence[SizedEffect]], float], fit: Fit) -> float:
    """Standard deviation, to first order, of a quantity that follows from the parameters of a set; infinite where it is
    none right beside them."""
    at = internal(fit.entries)
    ends = [[quantity(entries_at(fit.entries, at + way * step)) for way in (1, -1)] for step in NUDGE * np.eye(len(at))]
    if not np.isfinite(ends).all():
        return math.inf
    slopes = np.array([(above - below) / (2 * NUDGE) for above, below in ends])
    return math.sqrt(max(float(slopes @ fit.covariance @ slopes), 0.0))


def intervals_alone(runs: Sequence[ModelledRun], entry: SizedEffect) -> dict[str, Estimate]:
    """``intervals`` of one effect that was fitted to some runs outside a contest."""
    return intervals([entry], likelihood_of(runs).fit([entry], steps=0).covariance)[0]


def shows_itself(
    entries: Sequence[SizedEffect], covariance: Samples, chosen: Sequence[SizedEffect] | None = None
) -> list[bool]:
    """For each effect, with the same arguments as ``intervals``, whether the sizes by which it bears its name are as
    surely not 0 as a name has to be; an effect without sizes shows itself.

    Of several sizes each may be 0 where all of them cannot: records that tell a bow from an S badly may tell both from
    a straight line. So they are asked together, at the shapes that were found. As far as two ways to weigh the records
    differ, they may be off to either side."""
    sized = _sizes_at_their_shapes(entries, covariance)
    return _shown(entries, sized, internal(entries if chosen is None else chosen), internal(entries))


def _shown(
    entries: Sequence[SizedEffect], sized: Sequence[tuple[Integers, Samples]], at: Samples, middle: Samples
) -> list[bool]:
    """``shows_itself`` for parameters ``at`` in internal units, whose covariances are about ``middle``."""
    of, found = parameters_of(entries), []
    for sizes, variances in sized:
        bearing = np.array([not of[k][1].by_itself for k in sizes], dtype=bool)
        names, among = sizes[bearing], variances[np.ix_(bearing, bearing)]
        found.append(not len(names) or _are_there(at[names], (at - middle)[names], among))
    return found


def names_borne(fit: Fit) -> frozenset[str]:
    """The names of a set of effects. One that does not show itself, but surely has a size that is another effect by
    itself, bears that one's name: a loop that does not open and yet takes travel off is a change of gain."""
    entries, of, found = fit.entries, parameters_of(fit.entries), list[str]()
    if not any(p.by_itself for _, p in of):
        return frozenset(fit.names)
    at, sized = internal(entries), _sizes_at_their_shapes(entries, fit.covariance)
    for (effect, _), shown, (sizes, variances) in zip(entries, _shown(entries, sized, at, at), sized, strict=True):
        others = {
            of[k][1].by_itself
            for k, variance in zip(sizes, np.diag(variances), strict=True)
            if of[k][1].by_itself and _are_there(at[[k]], np.zeros(1), np.array([[variance]]))
        }
        found += [effect.name] if shown or not others else sorted(others)
    return frozenset(found)


def _are_there(value: Samples, off: Samples, covariance: Samples) -> bool:
    """Whether some sizes (k,) are surely not all 0, wherever between ``value - off`` and ``value + off`` their middle
    is: the ellipsoid that holds them with the probability ``SURE`` does not hold 0 then."""
    if np.linalg.eigvalsh(covariance).min() <= 0:
        return False
    towards, along = np.linalg.solve(covariance, off), 0.0
    if off @ towards > 0:
        along = float(np.clip(value @ towards / (off @ towards), -1.0, 1.0))
    nearest = value - along * off
    return float(nearest @ np.linalg.solve(covariance, nearest)) > float(chi2.ppf(SURE, len(value)))
