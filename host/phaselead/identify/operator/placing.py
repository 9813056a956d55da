"""Where the thresholds of plays and dead zones are, between those of a grid, and which knots are needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phaselead.identify.operator.leaving_out import SIMPLER, left_out
from phaselead.identify.operator.regressors import Basis, with_weight
from phaselead.identify.operator.result import Choice
from phaselead.record import Samples


def paired_plays(basis: Basis, slopes: Samples) -> Basis:
    """The plays that have weight; two neighbours become one between them.

    A fit without negative weights gives a play whose threshold is between two of the grid to those two, in the shares
    of its distance from them (as in deconvolution: de Castro and Gamboa 2012), and the next one of the grid nothing.
    """
    beside_fading = basis.n_segments + basis.n_plays
    weight = slopes[basis.n_segments : beside_fading]
    kept, _ = with_weight(replace(basis, fading_r_V=np.zeros(0)), slopes[:beside_fading])
    found, i = [], 0
    while i < len(weight):
        pair = slice(i, i + 2 if i + 1 < len(weight) and kept[i + 1] else i + 1)
        if kept[i]:
            found.append(float(np.average(basis.play_r_V[pair], weights=weight[pair])))
        i = pair.stop if kept[i] else i + 1
    return replace(basis, play_r_V=np.array(found))


def fewest_knots(basis: Basis, of_groups: Samples, folds: list[Samples]) -> tuple[Basis, Choice]:
    """The basis with the fewest knots that predicts left-out data as well as any, and its error there.

    One knot after the other is dropped, the one that is missed least; ``of_groups`` are the centred moments (group, k,
    k) of ``basis``.
    """
    knots, error = basis.knots_V, left_out(of_groups, basis.n_segments, folds)
    tried = [(knots, error)]
    while len(knots) > 2:
        fewer = [_without(of_groups, len(knots) - 1, i) for i in range(len(knots) - 2)]
        errors = [left_out(one, len(knots) - 2, folds) for one in fewer]
        least = int(np.argmin(errors))
        of_groups, knots = fewer[least], np.delete(knots, least + 1)
        tried.append((knots, errors[least]))
    enough = SIMPLER * min(error for _, error in tried)
    knots, error = next(one for one in reversed(tried) if one[1] <= enough)
    chosen = replace(basis, knots_V=knots)
    return chosen, Choice(chosen.n_plays, chosen.n_segments, error, len(chosen.fading_r_V), chosen=True)


def _without(of_groups: Samples, n_segments: int, knot: int) -> Samples:
    """Moments with two segments in one, those at both sides of an inner knot."""
    joined = np.delete(np.eye(of_groups.shape[-1]), knot + 1, axis=1)
    joined[knot + 1, knot] = 1.0
    return np.asarray(joined.T @ of_groups @ joined)
