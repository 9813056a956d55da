"""A hysteresis operator for a base that has none: symmetric plays behind the base's own delay, fitted to the training
records.

Asymmetry, more delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.gap.records import GapRun
from phaselead.identify import fit_plays
from phaselead.model import AxisModel
from phaselead.record import Samples


def with_operator(axis: AxisModel, runs: Sequence[GapRun], beyond_um: Sequence[Samples] | None = None) -> AxisModel:
    """The axis with plays, fitted to the runs, in place of its line. Raises BadInput where no run is driven.

    ``beyond_um``: per run what effects add to the operator, (n,) over the scored rows, taken out before the fit.
    """
    if beyond_um is not None:
        runs = [_without(run, beyond) for run, beyond in zip(runs, beyond_um, strict=True)]
    driven = [r.as_fitted for r in runs if r.driven]
    if not driven:
        raise BadInput("no training record is driven; nothing can be learned about its memory")
    return axis.model_copy(update={"time": fit_plays(driven, axis.time.delay_s if axis.time is not None else 0.0)})


def _without(run: GapRun, beyond_um: Samples) -> GapRun:
    """The run with (n,) taken out of its position over the scored rows."""
    x = run.x_um.copy()
    x[run.rows] -= beyond_um
    return replace(run, x_um=x)
