"""Whether the records are of the model's stage and in its units: how far they move beside what the model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.records import GapRun
from phaselead.model import Chain, Stage, catalogue
from phaselead.record import slow_gain

_GAIN = catalogue()["gain_change"].parameters[0]
LEAST_GAIN, MOST_GAIN = 1 + _GAIN.low, 1 + _GAIN.high
"""What a change of the scale may come to; beyond it units, signs or columns are other ones."""
ROLES = {"train": "training", "holdout": "held-out", "reference": "reference"}


def scale_doubts(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> tuple[str, ...]:
    """One line for each axis whose records move as no change of the stage makes them: out of scale, or backwards."""
    return tuple(line for axis, of_axis in runs.items() for line in _doubt(stage, axis, of_axis))


def _doubt(stage: Stage, axis: str, runs: Sequence[GapRun]) -> list[str]:
    gains = {role: _gain(stage, [run for run in runs if run.role == role and run.driven]) for role in ROLES}
    known = {role: gain for role, gain in gains.items() if gain is not None}
    off = {role: gain for role, gain in known.items() if not LEAST_GAIN <= gain <= MOST_GAIN}
    if not off:
        return []
    roles = " and ".join(ROLES[role] for role in off)
    which = "records" if len(off) == len(known) else f"{roles} records"
    gains_off = " and ".join(dict.fromkeys(f"{gain:#.2g}" for gain in off.values()))
    return [
        f"{axis}: the {which} move {gains_off} times as far as the model says: check units, signs and columns, or give "
        "--map; or the model is of another stage"
    ]


def _gain(stage: Stage, runs: Sequence[GapRun]) -> float | None:
    """By how much the model's answer is to be multiplied to give the records, slowly; None where it does not tell."""
    model = stage.axes
    pairs = [(Chain(model[r.axis], r.t_s, r.u_V).run()[r.rows], r.x_um[r.rows]) for r in runs]
    return slow_gain([(p, x) for p, x in pairs if np.ptp(p) > 0])
