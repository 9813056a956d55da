"""Where driven records stand, about their session: what a clock says and where a zero was set are no part of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.record import Samples


def about_their_sessions(runs: Sequence[BlockedRun], coefficients: Sequence[NDArray[np.floating]]) -> list[Samples]:
    """First coefficients (k,) of columns in each run, those that are levels about their mean in each session: what a
    clock says and where a zero was set are no part of them."""
    sessions = [run.modelled.run.role if run.levelled else None for run in runs]
    pairs = list(zip(sessions, coefficients, strict=True))
    means = {of: np.mean([one for session, one in pairs if session == of], axis=0) for of in {*sessions} - {None}}
    return [np.asarray(one - means[session] if session else one, np.float64) for session, one in pairs]


def with_levels_about_their_sessions(
    runs: Sequence[BlockedRun], coefficients: Sequence[NDArray[np.floating]]
) -> list[Samples]:
    """All coefficients (n, k) of columns in each run, the levels among them about their mean in each session."""
    firsts = about_their_sessions(runs, [of_run[0] for of_run in coefficients])
    pairs = zip(coefficients, firsts, strict=True)
    return [np.concatenate([first[None], of_run[1:]]) for of_run, first in pairs]


def zeros_of_sessions(runs: Sequence[BlockedRun]) -> list[Samples]:
    """Per run the coefficients (n, sessions) of a zero of each session that is not the mean of its levels, one
    deviation each: as far as the base leaves any of these from that mean."""
    sessions = sorted({run.modelled.run.role for run in runs if run.levelled})
    levels = about_their_sessions(runs, [run.base_error[0] for run in runs])
    farthest_um = max((abs(float(one[0])) for run, one in zip(runs, levels, strict=True) if run.levelled), default=0.0)
    found = []
    for run in runs:
        zeros = np.zeros((run.edges[-1], len(sessions)))
        if run.levelled:
            zeros[0, sessions.index(run.modelled.run.role)] = farthest_um
        found.append(zeros)
    return found
