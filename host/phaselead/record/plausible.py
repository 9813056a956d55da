"""Whether the columns of a foreign file are what they were mapped to."""

from __future__ import annotations

import math

import numpy as np

from phaselead.record.axis_record import Samples
from phaselead.record.guess import METRES_BELOW, roughness
from phaselead.record.recording import Recording

MOST_TRAVEL_um = 1e4
"""Five times what the longest flexure stages of piezo makers move (PI P-629: 1.8 mm)."""
MOST_SPAN_V = 3e3
"""Three times what high-voltage stacks take (0..1000 V)."""

ROUGHER = 1.5
"""Times, in fourth differences, of which slow motion has next to nothing: of a multisine both columns have alike, the
voltage up to a tenth more, which the mechanics take off. Chosen, not measured: five times
that tenth."""
NEARLY = 0.01
"""Largest relative difference between two rates that count as one."""
SLOWLY = 0.01
"""Roughness of a sine of forty rows a period. Of what is driven faster the mechanics may keep the smoother part."""
ONE_LEVEL = 1e-9
"""Of the range: levels closer than this are one, written in another way."""
OF_STEPS = 0.67 * math.sqrt(70)
"""Median fourth difference of noise whose rms is one step: the weights 1, -4, 6, -4, 1. A sensor is read in steps finer
than its noise; what is no rougher than its steps is taken for a coarse converter's voltage, though a coarse sensor may
be so too."""


TIME_UNITS = {"ms": 1e-3, "us": 1e-6}
"""Of times that are taken for seconds."""


def times_in(rate_Hz: float, expected_Hz: float) -> str:
    """Where a rate is lower than expected by what takes times from one unit to another: the question whether they are
    in that unit, and the map that mends it. Otherwise empty."""
    for unit, seconds in TIME_UNITS.items():
        if abs(rate_Hz / (seconds * expected_Hz) - 1) < NEARLY:
            return f"are its times in {unit}? Map them with their factor, e.g. --map t_s=1*{seconds:g},u_V=2,x_um=3"
    return ""


def doubts_about(recording: Recording) -> list[str]:
    """One line for each axis whose columns are probably exchanged, or in another unit.

    A slowly commanded voltage is smoother than what a sensor saw of it, against its own span; that of a loop is not,
    and a device's own recording is in no doubt.
    """
    if "target" in recording.meta:
        return []
    found = []
    for axis, record in recording.axes.items():
        u_V, x_um = record.u_V, record.x_um
        if x_um is not None and (travel_um := float(np.ptp(x_um))) > MOST_TRAVEL_um:
            found.append(
                f"{recording.source}: axis {axis} moves by {travel_um:.3g} um, which no piezo stage does: is the "
                "factor of its column right?"
            )
        elif x_um is not None and u_V is not None and 0 < travel_um < METRES_BELOW < float(np.ptp(u_V)):
            found.append(
                f"{recording.source}: axis {axis} moves by {travel_um:.3g} um, less than a nanometre: is it in metres? "
                "Map it with its factor, x_um=COLUMN*1e6"
            )
        if u_V is not None and (span_V := float(np.ptp(u_V))) > MOST_SPAN_V:
            found.append(
                f"{recording.source}: axis {axis} is driven over {span_V:.4g} V, which no piezo stage stands: is it in "
                "millivolts? Map it with its factor, u_V=COLUMN*1e-3"
            )
        if u_V is not None and x_um is not None and record.r_um is None and seem_exchanged(u_V, x_um):
            found.append(
                f"{recording.source}: the voltage of axis {axis} is rougher than its position: are the columns "
                "exchanged? In a closed loop it may be so"
            )
    return found


def seem_exchanged(u_V: Samples, x_um: Samples) -> bool:
    """Whether the voltage (n,) of a slow drive is rougher than the position, as only a sensor's column is. In a closed
    loop it may be so. What a coarse converter's steps make rough is no sensor's noise."""
    if len(u_V) < 5 or not np.ptp(u_V) > 0:
        return False
    noisier = roughness(u_V, 4) > ROUGHER * roughness(x_um, 4)
    return bool(noisier and SLOWLY > roughness(u_V) > roughness(x_um)) and not _is_of_steps(u_V)


def _is_of_steps(values: Samples) -> bool:
    """Whether (n,) are no rougher than the step between them."""
    between = np.diff(np.unique(values))
    step = float(np.min(between[between > ONE_LEVEL * np.ptp(values)]))
    return float(np.median(np.abs(np.diff(values, 4)))) <= OF_STEPS * step
