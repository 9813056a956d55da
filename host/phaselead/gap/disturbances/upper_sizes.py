"""How large a disturbance may be that was not found: no larger than all that is left of records that it would be in.

These are no fits. What is left holds the sensor's noise and what the model misses as well.
"""

from __future__ import annotations

import math

import numpy as np

from phaselead.gap.disturbances.disturbance import Residuals
from phaselead.gap.residual import power_um2


def largest(train: Residuals, holdout: Residuals) -> dict[str, float]:
    """By ``Effect.seen_as`` the size, in its unit, beyond which the residuals would be larger than they are. What needs
    records at rest, or in motion, is left out where there are none."""
    every = [*train, *holdout]
    at_rest = [r for r in every if r.run.idle]
    moving = [r for r in every if r.run.driven]
    found = {}
    if at_rest:
        found["lines"], found["band"] = math.sqrt(2) * _rms_um(at_rest), _rms_um(at_rest)
    if moving:
        # At rest all rows may lie on one step.
        found["grid"] = math.sqrt(12) * _rms_um(moving)
        speed = math.sqrt(np.mean(np.concatenate([r.speed_um_per_s**2 for r in moving])))
        if speed > 0:
            found["speed"] = _rms_um(moving) / speed
    return found


def _rms_um(residuals: Residuals) -> float:
    return math.sqrt(power_um2([r.error_um - r.error_um.mean() for r in residuals]))
