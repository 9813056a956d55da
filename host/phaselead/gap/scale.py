"""Whether the records are of the model's stage and in its units: how far they move beside what the model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from phaselead.errors import BadInput
from phaselead.gap.records import GapRun, Role
from phaselead.model import Chain, Stage, out_of_scale, scale_doubt
from phaselead.record import in_another_unit, slow_gain

GIVE_FACTOR = "give the factor of a column, --map x_um=COLUMN*1e6 or u_V=COLUMN*0.001"
ROLES: dict[Role, str] = {"train": "training", "holdout": "held-out", "reference": "reference"}


def refuse_other_units(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> None:
    """Refuse records in another unit than the model's, and records of two scales that no change of one stage gives.
    Raises BadInput, one line."""
    for axis, of_axis in runs.items():
        driven = [run for run in of_axis if run.driven]
        gains = [(run, _gain(stage, [run])) for run in driven]
        off = [(run, gain) for run, gain in gains if gain is not None and in_another_unit(gain)]
        if off:
            run, gain = off[0]
            others = f" ({len(off) - 1} more like it)" if len(off) > 1 else ""
            whose = ", or the model is of another stage" if len(off) == len(driven) else ""
            raise BadInput(
                f"{run.name}: axis {axis} moves {gain:.2g} times as far as the model says{others}: a column is in "
                f"another unit{whose}; {GIVE_FACTOR}, or leave the record out"
            )
        of_roles = _gains_of_roles(stage, driven)
        for (one, gain), (other, beside) in combinations(of_roles.items(), 2):
            if gain / beside > 0 and out_of_scale(gain / beside):
                raise BadInput(
                    f"axis {axis}: the {ROLES[one]} records move {gain:.2g} times as far as the model says, the "
                    f"{ROLES[other]} records {beside:.2g} times: no change of one stage does that; {GIVE_FACTOR}, or "
                    "leave out what is of another stage"
                )


def scale_doubts(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> tuple[str, ...]:
    """One line for each axis whose records move as no change of the stage makes them: out of scale, or backwards."""
    return tuple(line for axis, of_axis in runs.items() for line in _doubt(stage, axis, of_axis))


def _doubt(stage: Stage, axis: str, runs: Sequence[GapRun]) -> list[str]:
    known = _gains_of_roles(stage, [run for run in runs if run.driven])
    off = {role: gain for role, gain in known.items() if out_of_scale(gain)}
    if not off:
        return []
    roles = " and ".join(ROLES[role] for role in off)
    which = "records" if len(off) == len(known) else f"{roles} records"
    gains_off = " and ".join(dict.fromkeys(f"{gain:#.2g}" for gain in off.values()))
    return [f"{axis}: the {which} move {scale_doubt(gains_off)}"]


def _gains_of_roles(stage: Stage, driven: Sequence[GapRun]) -> dict[Role, float]:
    """The factor of each role, where its records tell one."""
    gains = {role: _gain(stage, [run for run in driven if run.role == role]) for role in ROLES}
    return {role: gain for role, gain in gains.items() if gain is not None}


def _gain(stage: Stage, runs: Sequence[GapRun]) -> float | None:
    """By how much the model's answer is to be multiplied to give the records, slowly; None where it does not tell."""
    model = stage.axes
    pairs = [(Chain(model[r.axis], r.t_s, r.u_V).run()[r.rows], r.x_um[r.rows]) for r in runs]
    return slow_gain([(p, x) for p, x in pairs if np.ptp(p) > 0])
