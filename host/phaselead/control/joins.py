"""How long a path is entered from where the axis stands, and left where it ends (docs/firmware.md)."""

from __future__ import annotations

from phaselead.control.motion_limits import first_mode_Hz, motion_limits, usual_duration_s
from phaselead.device import LARGEST_STEP_V, Standing
from phaselead.model import AxisModel
from phaselead.waveforms import PEAK_SPEED, Waveform

MODE_PERIODS = 6
"""Of a join: the spectrum of a least-jerk change of T seconds falls with the third power of f T, and is below 1e-4 of
the change from f T = 6 on."""
UNKNOWN_MODE_S = 0.05
"""A join where no model tells the first mode: six periods of 120 Hz."""
GENTLY = 2.0
"""Times the usual duration of a move of this way: the path goes its own way meanwhile."""


def quiet_s(model: AxisModel | None) -> float:
    """A join that does not ring the first mode."""
    f_Hz = None if model is None else first_mode_Hz(model)
    return UNKNOWN_MODE_S if f_Hz is None else MODE_PERIODS / f_Hz


Span = tuple[float, float]
"""The lowest and the highest place of what an axis follows, um; of one that is held twice the same."""


def enter_from_s(waveform: Waveform, span: Span, mode: str, model: AxisModel | None) -> float:
    """Of the join to the path from anywhere between these places, in closed loop."""
    return max(enter_s(waveform, Standing(0.0, um), mode, model) for um in span)


def enter_s(waveform: Waveform, standing: Standing, mode: str, model: AxisModel | None) -> float:
    """Of the join from where the axis stands to the path. In mode open only where the path begins elsewhere."""
    first = float(waveform.value(0.0))
    if mode == "open":
        way_V = abs(first - standing.u_V)
        ramp_V_per_s = (model or AxisModel()).limits.ramp_V_per_s
        return 0.0 if way_V <= LARGEST_STEP_V else max(quiet_s(model), PEAK_SPEED * way_V / ramp_V_per_s)
    way_um = abs(first - standing.x_um)
    return max(quiet_s(model), GENTLY * usual_duration_s(way_um, motion_limits(model), model, mode))
