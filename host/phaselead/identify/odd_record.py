"""A record among others that is not of their stage, or not in their units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.errors import BadInput, more_like_it
from phaselead.identify.modal import FittedModes, fit_together, shares_left_by
from phaselead.identify.operator import OperatorFit
from phaselead.identify.runs import AxisRun, turned, white_noise_rms
from phaselead.model import out_of_scale
from phaselead.quantity import digits
from phaselead.record import factors_moved, gains_moved, in_another_unit, unit_remedy

ABOUT_AS_SLOW = 3.0
"""Times the frequency of the slowest record up to which others must follow their voltage alike. Of faster ones a mode
may make more, or turn them round."""
OF_ONE_STAGE = 0.01
"""Of its range: an operator with modes leaves less of each record of one stage. Of simulated stages it leaves 0.02 to
0.4 %, of the measured records in the docs 0.2 and 0.4 %."""
MUCH_BETTER = 4.0
"""Times less of the others where one record is left out: what a model misses differs by no more between records of one
stage, as ``gap`` takes it too."""
MOST_TRIED = 6
"""Records that are left out in turn: a budget of time, each costs a fit of the others."""
FEWEST = 3
"""Records of which one can be told from the others."""


def refuse_unlike_others(runs: Sequence[AxisRun]) -> None:
    """Refuse records that move beside their voltage as if a column were in another unit than in most. Raises
    BadInput."""
    gains = factors_moved([(run.u_V, run.x_um) for run in runs], [run.step_s for run in runs])
    apart = {i: [j for j in gains if in_another_unit(gains[j] / gains[i])] for i in gains}
    most = min(apart, key=lambda i: len(apart[i]), default=None)
    if most is None or not apart[most]:
        return
    odd, *more = apart[most]
    raise BadInput(
        f"{runs[odd].source}: axis {runs[odd].axis} moves {gains[odd]:.3g} um/V{more_like_it(len(more))}, but "
        f"{gains[most]:.3g} um/V in {runs[most].source}; {unit_remedy(gains[odd] / gains[most], of_all=False)}, or fit "
        "them apart"
    )


def refuse_turned_round(runs: Sequence[AxisRun]) -> None:
    """Of records that cannot be fitted together refuse those that fall with their voltage where others rise, about as
    slowly, if all are of one stage once these are turned round. Raises BadInput."""
    gains = gains_moved([(run.u_V, run.x_um) for run in runs], [run.step_s for run in runs], ABOUT_AS_SLOW)
    rising, falling = ([i for i in gains if rises == (gains[i] > 0)] for rises in (True, False))
    usual, unlike = (rising, falling) if len(rising) >= len(falling) else (falling, rising)
    if not unlike:
        return
    # Sensors that all count backwards are fitted turned round, as `fit` does.
    there = [turned(run) if (i in unlike) == (usual is rising) else run for i, run in enumerate(runs)]
    try:
        mended = max(shares_left_by(*fit_together(there), there))
    except BadInput:
        return
    if mended > OF_ONE_STAGE:
        return
    odd, *more = unlike
    raise BadInput(
        f"{runs[odd].source}: axis {runs[odd].axis} moves {digits(gains[odd], 3)} um/V{more_like_it(len(more))}, but "
        f"{digits(gains[usual[0]], 3)} um/V in {runs[usual[0]].source}, and turned round it is of the same stage: turn "
        "the sign of its position (or voltage) round, or fit them apart"
    )


def about_scale(axis: str, runs: Sequence[AxisRun]) -> list[str]:
    """What to say of slow records that follow their voltage as no change of a stage makes them, beside most others."""
    gains = gains_moved([(run.u_V, run.x_um) for run in runs], [run.step_s for run in runs], ABOUT_AS_SLOW)
    unlike = {i: [j for j in gains if out_of_scale(gains[j] / gains[i]) or out_of_scale(gains[i] / gains[j])]
              for i in gains}  # fmt: skip
    usual = min(unlike, key=lambda i: len(unlike[i]), default=None)
    if usual is None or not unlike[usual]:
        return []
    odd, *more = unlike[usual]
    return [
        f"axis {axis}: {runs[odd].source} moves {digits(gains[odd], 3)} um/V{more_like_it(len(more))}, "
        f"{runs[usual].source} {digits(gains[usual], 3)} um/V, about as slowly: are units, signs and columns right?"
    ]


def about_unlike_record(axis: str, runs: Sequence[AxisRun], found: OperatorFit, modes: FittedModes | None) -> list[str]:
    """What to say of the record without which the others are described far better, and otherwise of one of which more
    is left than of any stage."""
    shares = shares_left_by(found, modes, runs)
    if max(shares) <= OF_ONE_STAGE:
        return []
    odd = _unlike_others(axis, runs, shares)
    noise = [white_noise_rms(run.x_um[run.scored]) / run.range_um for run in runs]
    beyond = [i for i, share in enumerate(shares) if share > max(OF_ONE_STAGE, MUCH_BETTER * noise[i])]
    if odd or not beyond:
        return odd
    most = max(beyond, key=shares.__getitem__)
    return [
        f"axis {axis}: the fit leaves {digits(100 * shares[most], 2)} % of the range of {runs[most].source}, "
        f"of one stage less than {100 * OF_ONE_STAGE:g} %: does this voltage drive this position, and are the rows in "
        "order of time?"
    ]


def _unlike_others(axis: str, runs: Sequence[AxisRun], shares: Sequence[float]) -> list[str]:
    """The record without which the others are described far better. It is looked for among those that the fit of all
    leaves most of, since that bends to it, and others may look worse. Each costs a fit."""
    if len(runs) < FEWEST:
        return []
    for odd in np.argsort(shares)[::-1][:MOST_TRIED].tolist():
        with_it = max(share for i, share in enumerate(shares) if i != odd)
        without = _left_without(odd, runs)
        if without <= OF_ONE_STAGE and with_it > MUCH_BETTER * without:
            return [
                f"axis {axis}: beside {runs[odd].source} the fit leaves up to {digits(100 * with_it, 2)} % of the "
                f"range of another record, without it {digits(100 * without, 2)} %: is it of this stage, and are its "
                "units, signs and columns right? Leave it out, or fit it apart"
            ]
    return []


def _left_without(odd: int, runs: Sequence[AxisRun]) -> float:
    """The largest share left of the other runs by a fit of them alone; infinite where they cannot be fitted."""
    others = [run for i, run in enumerate(runs) if i != odd]
    try:
        return max(shares_left_by(*fit_together(others), others))
    except BadInput:
        return float("inf")
