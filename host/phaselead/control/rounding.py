"""The corners of a path, rounded by what the slew limit asks for and no more.

A stage with a mode follows a corner only by a jump of the voltage, which what undoes the mode asks for as fast as it
can. What the slew limit cuts off of that rings the stage. The best path within a rate of the voltage has a jerk of one
size at its corners, up and down: two means over the same time, one after the other.
"""

from __future__ import annotations

from phaselead.control.modes import INVERTS
from phaselead.control.motion_limits import PATH_ROOM, first_mode_Hz
from phaselead.control.voltage_rate import OfPeriod, Spans, VoltageRate, voltage_rate
from phaselead.errors import BadInput
from phaselead.model import AxisModel
from phaselead.waveforms import Curve, Waveform

HALVINGS = 16
"""Of the time, from half a period of the mode on: to 40 ns."""


def rounding_s(model: AxisModel, waveform: Waveform, mode: str) -> float:
    """The time of each of the two means over a path in micrometres, in modes that invert; 0 where it needs none, is a
    move, has no corners, or is played in place of another. 0 too where no rounding helps: that is another path, and a
    rehearsal says so."""
    rate = asked_rate(model, waveform, mode)
    return 0.0 if rate is None else rounding_within(rate, model, waveform)


def rounding_within(rate: VoltageRate, model: AxisModel, waveform: Waveform) -> float:
    """The same of a path, or of parts of it, that asks for this rate."""
    if isinstance(waveform, Curve) or waveform.as_asked is not waveform:
        return 0.0
    first_Hz = first_mode_Hz(model)
    assert first_Hz is not None
    slow_Hz = max(first_Hz, waveform.f_Hz) if isinstance(rate, OfPeriod) else first_Hz
    slew_V_per_s = model.limits.slew_V_per_s
    if isinstance(rate, OfPeriod) and rate.up_to(slow_Hz) > PATH_ROOM * slew_V_per_s:
        return 0.0  # what lies at the first mode and below is too fast: no corner
    found = (_shortest_s(rate, limit, 0.5 / slow_Hz) for limit in (PATH_ROOM * slew_V_per_s, slew_V_per_s))
    return next((s for s in found if s is not None), 0.0)


def asked_rate(model: AxisModel, waveform: Waveform, mode: str, spans_s: Spans | None = None) -> VoltageRate | None:
    """What a path, or of one of rows these parts, asks of the output in modes that invert; None for volts, for moves,
    which have limits of their own, and where no inverse or no mode is known."""
    if mode not in INVERTS or waveform.unit != "um" or waveform.played_as == "move" or first_mode_Hz(model) is None:
        return None
    try:
        return voltage_rate(model, waveform, spans_s)
    except BadInput:
        return None


def _shortest_s(rate: VoltageRate, limit_V_per_s: float, longest_s: float) -> float | None:
    """Time of each mean that keeps every block within the limit; None: none does."""
    found_s = 0.0
    for block in rate.above(limit_V_per_s):
        if rate.within(block, found_s)[0] <= limit_V_per_s:
            continue
        if rate.within(block, longest_s)[0] > limit_V_per_s:
            return None
        low_s, found_s = found_s, longest_s
        for _ in range(HALVINGS):
            middle_s = (low_s + found_s) / 2
            below = rate.within(block, middle_s)[0] <= limit_V_per_s
            low_s, found_s = (low_s, middle_s) if below else (middle_s, found_s)
    return found_s
