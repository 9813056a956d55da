"""Whether the records are of the model's stage and in its units: how far they move beside what the model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.gap.records import GapRun, Role
from phaselead.model import Chain, Stage, out_of_scale, scale_doubt
from phaselead.record import Samples, factors_moved, in_another_unit, slow_gain, unit_remedy

ROLES: dict[Role, str] = {"train": "training", "holdout": "held-out", "reference": "reference"}


def refuse_unlike_model(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> None:
    """Refuse records that move beside what the model says as if a column were in another unit. Raises BadInput, one
    line."""
    for axis, of_axis in runs.items():
        driven = [run for run in of_axis if run.driven_well]
        found = factors_moved([_expected(stage, run) for run in driven], [run.step_s for run in driven])
        off = {i: factor for i, factor in found.items() if in_another_unit(factor)}
        if off:
            (first, factor), *more = off.items()
            others = f" ({len(more)} more like it)" if more else ""
            instead = "fit the model to this stage" if len(off) == len(found) else "leave the record out"
            raise BadInput(
                f"{driven[first].name}: axis {axis} moves {factor:.2g} times as far as the model says{others}; "
                f"{unit_remedy(factor)}, or {instead}"
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
    pairs = [_expected(stage, run) for run in runs]
    return slow_gain([(p, x) for p, x in pairs if np.ptp(p) > 0])


def _expected(stage: Stage, run: GapRun) -> tuple[Samples, Samples]:
    """What the model says of a record, by its own voltage alone, and its position, (n,) in um over the scored rows."""
    return Chain(stage.axes[run.axis], run.t_s, run.u_V).run()[run.rows], run.x_um[run.rows]
