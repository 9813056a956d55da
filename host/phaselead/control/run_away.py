"""What a recording that ended in a fault shows of the loop: whether it ran away."""

from __future__ import annotations

import numpy as np

from phaselead.record import Recording, Samples

GROWING = 4
"""Swings in a row, each wider than the one before: a stable loop ends in none such, nor does a failing sensor."""
LEAST_SWING = 0.01
"""Of the span of the error: a smaller turn is noise."""


def run_away(recording: Recording, rows: int) -> str | None:
    """How the error of an axis grew over the first ``rows`` rows, until the fault, in words; None where it did not
    swing ever wider."""
    for axis, record in recording.axes.items():
        if record.r_um is None or record.x_um is None:
            continue
        f_Hz = growing_Hz((record.r_um - record.x_um)[:rows], 1 / recording.rate_Hz)
        if f_Hz is not None:
            return (
                f"the loop of {axis} is unstable: its error swung ever wider at about {_two_digits(f_Hz):g} Hz; lower "
                "the gains, or leave --gains out for those designed for the model"
            )
    return None


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def growing_Hz(error_um: Samples, step_s: float) -> float | None:
    """Frequency of the swings of ``error_um`` (n,) where the last are each wider than the one before; else None. The
    very last may be cut short."""
    turns = turning_rows(error_um)[-GROWING - 2 :]
    swings = np.abs(np.diff(error_um[turns]))
    cut_short = len(swings) > 1 and swings[-1] < swings[-2]
    turns = (turns[:-1] if cut_short else turns)[-GROWING - 1 :]
    swings = np.abs(np.diff(error_um[turns]))
    if len(swings) < GROWING or (np.diff(swings) <= 0).any():
        return None
    return float((len(turns) - 1) / (2 * (turns[-1] - turns[0]) * step_s))


def turning_rows(values: Samples) -> list[int]:
    """Rows of the extremes of ``values`` (n,), the last row among them, turns below ``LEAST_SWING`` passed over."""
    slack = LEAST_SWING * float(np.ptp(values)) if len(values) else 0.0
    rows, best, sign = [0], 0, 0.0
    for row, value in enumerate(values):
        if sign * (value - values[best]) >= 0:
            sign = sign or float(np.sign(value - values[best]))
            best = row
        elif abs(value - values[best]) > slack:
            rows.append(best)
            sign, best = -sign, row
    return [*rows, best]
