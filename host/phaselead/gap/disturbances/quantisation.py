"""Quantisation: all measured positions are multiples of one step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Residuals
from phaselead.gap.findings import Estimate
from phaselead.gap.residual import RunResidual
from phaselead.record import Samples

FEWEST_GAPS = 3
"""Fewest gaps between the values of a record from which its step is taken."""
OFF_GRID = 0.05
"""Of a step, by which rounding may move a value off it."""
PLACES = 8
"""Positions between two steps at which a record is rounded, to find the one where that adds most."""


def find_grid(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """A grid on which all positions lie, as the effect ``name``; None unless it is coarser than the reference's, and
    where all that the reference shows may lie on it too."""
    steps, again, known = (_steps(part) for part in (train, holdout, reference))
    if not steps or not again:
        return None
    lsb = float(np.median(steps))
    new, before = ([_lie_on(_gaps(one.run.x_um), lsb) for one in part] for part in ([*train, *holdout], reference))
    if not all(new) or all(before) or lsb < NEW_FROM * max(known, default=0.0):
        return None
    params: dict[str, Estimate] = {"lsb_um": (lsb, "um", (0.999 * lsb, 1.001 * lsb))}
    return Disturbance(name, params, lsb**2 / 12, f"every position is a multiple of {1e3 * lsb:.4g} nm")


def rounded(part: Residuals, lsb_um: float) -> list[RunResidual]:
    """Residuals as a sensor with such steps would have shown them, had it rested where these round off most: half way
    between two steps a record at rest jumps to and fro, on one of them it shows nothing."""
    found = []
    for residual in part:
        tried = [_rounded(residual, lsb_um, shift * lsb_um) for shift in np.arange(PLACES) / PLACES]
        found.append(max(tried, key=lambda one: float(one.error_um @ one.error_um)))
    return found


def _rounded(residual: RunResidual, lsb_um: float, shift_um: float) -> RunResidual:
    """A residual with positions rounded to steps, once they are shifted."""
    x_um = residual.run.x_um + shift_um
    run = replace(residual.run, x_um=lsb_um * np.round(x_um / lsb_um))
    off_um = (run.x_um - x_um)[run.rows]
    return replace(residual, run=run, error_um=residual.error_um + off_um - off_um.mean())


def _steps(part: Residuals) -> list[float]:
    """The step of every record that has one."""
    steps = (grid_step(residual.run.x_um) for residual in part)
    return [step for step in steps if step is not None]


def grid_step(x_um: Samples) -> float | None:
    """The step (um) of the grid on which all values (n,) lie; None where there is none above rounding, or where they
    are too few to say: of a sensor with coarse steps a record at rest has one or two."""
    gaps = _gaps(x_um)
    if len(gaps) < FEWEST_GAPS:
        return None
    step = float(gaps.min())
    if step < 1e-6 * max(float(np.ptp(x_um)), 1e-9):
        return None
    step = float(np.median(gaps / np.maximum(np.round(gaps / step), 1.0)))
    return step if _lie_on(gaps, step) else None


def _gaps(x_um: Samples) -> Samples:
    """Differences (m,) between neighbours of the values (n,), without those of rounding."""
    gaps = np.diff(np.unique(x_um))
    return np.asarray(gaps[gaps > 1e-9 * max(float(np.abs(x_um).max()), 1.0)])


def _lie_on(gaps: Samples, step: float) -> bool:
    """Whether all gaps (m,) are multiples of a step; none are of any."""
    return bool((np.abs(gaps / step - np.round(gaps / step)) < OFF_GRID).all())
