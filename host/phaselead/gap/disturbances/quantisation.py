"""Quantisation: all measured positions are multiples of one step."""

from __future__ import annotations

import numpy as np

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Residuals
from phaselead.gap.findings import Estimate
from phaselead.record import Samples


def find_grid(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """A grid on which all positions lie, as the effect ``name``; None unless it is coarser than the reference's."""
    steps = [grid_step(residual.run.x_um) for residual in train]
    again = [grid_step(residual.run.x_um) for residual in holdout]
    if any(s is None for s in [*steps, *again]):
        return None
    lsb = float(np.median([s for s in steps if s is not None]))
    known = [grid_step(residual.run.x_um) for residual in reference]
    before = max((s for s in known if s is not None), default=0.0)
    if lsb < NEW_FROM * before:
        return None
    params: dict[str, Estimate] = {"lsb_um": (lsb, "um", (0.999 * lsb, 1.001 * lsb))}
    return Disturbance(name, params, lsb**2 / 12, f"every position is a multiple of {1e3 * lsb:.4g} nm")


def grid_step(x_um: Samples) -> float | None:
    """The step (um) of the grid on which all values (n,) lie; None where there is none above rounding."""
    gaps = np.diff(np.unique(x_um))
    gaps = gaps[gaps > 1e-9 * max(float(np.abs(x_um).max()), 1.0)]
    if len(gaps) < 3:
        return None
    step = float(gaps.min())
    if step < 1e-6 * max(float(np.ptp(x_um)), 1e-9):
        return None
    multiples = gaps / step
    step = float(np.median(gaps / np.maximum(np.round(multiples), 1.0)))
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if float(off.max()) < 0.05 else None
