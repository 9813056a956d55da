"""What a recording that ended in a fault shows of the loop: whether it ran away."""

from __future__ import annotations

import numpy as np

from phaselead.device import DeviceFault, DeviceStatus
from phaselead.record import Recording, Samples

GROWING = 4
"""Swings in a row, each wider than the one before: a stable loop ends in none such, nor does a failing sensor."""
LEAST_SWING = 0.01
"""Of the span of the error: a smaller turn is noise."""

WINDOW_S = 0.1
FAST_TURNS = 5
"""Of a window: a swing of fewer turns is not told from a bend."""
ABOUT = 0.2
"""Of a frequency, up and down: a tenth for the mode that moves with the load (``MODE_SHIFT``), a tenth for bursts."""
GROWN = 16.0
"""In energy, against the first window: two doublings of the swing, as four blocks of twice the energy each are."""
OF_THE_PATH = 36.0
"""In energy: what a loop of the largest peak sensitivity that ``track`` allows, 6, can make of its reference."""


def run_away(recording: Recording, rows: int, *, gains_given: bool = True) -> str | None:
    """How the error of an axis grew over the first ``rows`` rows, until the fault, in words; None where it neither
    swung ever wider nor came to swing at a frequency that the path does not have.

    ``gains_given``: somebody chose the gains, rather than the stage file or the design for its model.
    """
    for axis, record in recording.axes.items():
        if record.r_um is None or record.x_um is None:
            continue
        error_um, step_s = (record.r_um - record.x_um)[:rows], 1 / recording.rate_Hz
        f_Hz = growing_Hz(error_um, step_s)
        how = "its error swung ever wider"
        if f_Hz is None:
            f_Hz, how = swinging_Hz(error_um, record.r_um[:rows], step_s), "its error came to swing"
        if f_Hz is not None:
            return f"the loop of {axis} is unstable: {how} at about {_two_digits(f_Hz):g} Hz; {advice(gains_given)}"
    return None


def tell_of(fault: DeviceFault, recording: Recording, *, gains_given: bool) -> None:
    """Adds to what a fault says what its recording shows of the loop, and what to do about it. Of ``oscillation`` the
    device has seen it, also where the path had not begun."""
    capture = fault.capture
    from_tick, to_tick = np.searchsorted(capture.ticks, [capture.recorded_from, capture.status.fault_tick])
    said = run_away(recording, int(max(to_tick - from_tick, 0)), gains_given=gains_given)
    status = DeviceStatus.of(capture.status)
    if said is None and status.fault == "oscillation":
        said = f"the loop of {status.fault_axis} is unstable; {advice(gains_given)}"
    if said is not None:
        fault.args = (f"{fault}; {said}",)


def advice(gains_given: bool) -> str:
    """What to do about a loop that runs away."""
    if gains_given:
        return "lower the gains, or leave --gains out for those designed for the model"
    return (
        "no --gains were given, and those that were taken, the model's or else the paper's, do not suit this stage: it "
        "may have a mode that its model lacks; `phaselead tune` measures the response and shapes gains on it"
    )


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def growing_Hz(error_um: Samples, step_s: float) -> float | None:
    """Frequency of the swings of ``error_um`` (n,) where the last are each wider than the one before; else None. The
    very last may be cut short."""
    if not len(error_um):
        return None
    turns = turning_rows(error_um)[-GROWING - 2 :]
    swings = np.abs(np.diff(error_um[turns]))
    cut_short = len(swings) > 1 and swings[-1] < swings[-2]
    turns = (turns[:-1] if cut_short else turns)[-GROWING - 1 :]
    swings = np.abs(np.diff(error_um[turns]))
    if len(swings) < GROWING or (np.diff(swings) <= 0).any():
        return None
    return float((len(turns) - 1) / (2 * (turns[-1] - turns[0]) * step_s))


def swinging_Hz(error_um: Samples, r_um: Samples, step_s: float) -> float | None:
    """Frequency at which the end of ``error_um`` (n,) swings, where most of its energy is about there, and more than
    at first and than the reference ``r_um`` (n,) can make; else None. A loop that the slew limit holds back swings
    no wider from turn to turn."""
    rows = round(WINDOW_S / step_s)
    if len(error_um) < 2 * rows:
        return None
    f_Hz = np.fft.rfftfreq(rows, step_s)
    last, before, path = (_power(part) for part in (error_um[-rows:], error_um[:rows], r_um[-rows:]))
    fast = f_Hz >= FAST_TURNS / WINDOW_S
    at_Hz = float(f_Hz[fast][np.argmax(last[fast])])
    about = fast & (np.abs(f_Hz - at_Hz) <= ABOUT * at_Hz)
    if last[about].sum() < last.sum() / 2 or last[about].sum() < GROWN * before[about].sum():
        return None
    return at_Hz if last[about].sum() > OF_THE_PATH * path[about].sum() else None


def _power(values: Samples) -> Samples:
    return np.asarray(np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2)


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
