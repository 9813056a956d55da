"""How many plays and segments the records of an axis carry, decided on data left out."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.linalg import block_diag

from phaselead.identify.operator.leaving_out import SIMPLER, folds_of, left_out
from phaselead.identify.operator.records import Records
from phaselead.identify.operator.regressors import Basis
from phaselead.identify.operator.result import Choice
from phaselead.identify.operator.solution import PART_PAYS, Solution, centred, moments
from phaselead.record import Samples

FINEST = (48, 20)
"""Plays and segments of the richest size; the others are every 2nd, 4th ... of it."""
PLAY_STRIDES, SEGMENT_MERGES = (1, 2, 4, 8, 0), (1, 2, 4, 10, 20)


def choose_basis(
    records: Records, found: Solution, *, leave_out_ends: bool = False
) -> tuple[Basis, tuple[Choice, ...]]:
    """A basis for the records, all else as found, and all that were tried.

    With fading plays where the best basis with them leaves less than ``PART_PAYS`` of the squares of left-out data that
    the best without them leaves; of those the simplest that predicts as well as any. ``leave_out_ends``: see
    ``folds_of``.
    """
    fine = records.basis(*FINEST, fading=True)
    of_groups = centred(moments(records.fits, fine, found.delay_s, found.rest_fraction, found.modes))
    folds = folds_of(records.fits, leave_out_ends=leave_out_ends)
    choices, bases = [], []
    for stride, merge, fading in product(PLAY_STRIDES, SEGMENT_MERGES, (False, True)):
        if fading and not stride:  # plays tell where a record began
            continue
        shrink, basis = _coarser(fine, stride, merge, fading=fading)
        error = left_out(shrink.T @ of_groups @ shrink, basis.n_segments, folds)
        choices.append(Choice(basis.n_plays, basis.n_segments, error, len(basis.fading_r_V)))
        bases.append(basis)
    with_fading = min((c.left_out for c in choices if c.n_fading), default=np.inf)
    without = min(c.left_out for c in choices if not c.n_fading)
    fades = with_fading**2 < PART_PAYS * without**2
    enough = SIMPLER * (with_fading if fades else without)
    good = [i for i, c in enumerate(choices) if bool(c.n_fading) == fades and c.left_out <= enough]
    best = min(good, key=lambda i: (choices[i].size, choices[i].left_out))
    return bases[best], tuple(replace(c, chosen=i == best) for i, c in enumerate(choices))


def _coarser(fine: Basis, stride: int, merge: int, *, fading: bool) -> tuple[Samples, Basis]:
    """Every ``stride``-th play (0: none), ``merge`` segments in one, and the fading plays or none of them; and the
    matrix that shrinks the moments."""
    joined = np.kron(np.eye(fine.n_segments // merge), np.ones((merge, 1)))
    kept = np.eye(fine.n_plays)[:, stride - 1 :: stride] if stride else np.zeros((fine.n_plays, 0))
    faded = np.eye(len(fine.fading_r_V))[:, : None if fading else 0]
    shrink = block_diag(joined, kept, faded, np.eye(2))
    coarser = replace(
        fine, play_r_V=fine.play_r_V @ kept, knots_V=fine.knots_V[::merge], fading_r_V=fine.fading_r_V @ faded
    )
    return shrink, coarser
