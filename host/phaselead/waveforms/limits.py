"""What of a waveform an axis can do."""

from __future__ import annotations

import math

from phaselead.errors import BadInput
from phaselead.model import AxisModel
from phaselead.waveforms.goto import Goto
from phaselead.waveforms.waveform import Waveform


def refuse_out_of_range(wave: Waveform, axis: AxisModel, *, table: bool = False) -> None:
    """Refuse a waveform that leaves what the axis can do; ``table``: also what table feed-forward covers.

    Volts must stay inside the limits and below the slew limit; positions inside what the sensor sees, and the
    measured range if there is one. The line does not say whose path it is: the caller knows the axis.
    """
    if wave.unit == "V":
        limits = axis.limits
        _inside(wave, limits.u_min_V, limits.u_max_V, "the limits of the output")
        rate = wave.steepest()
        if rate > limits.slew_V_per_s:
            slower = wave.f_Hz * limits.slew_V_per_s / rate
            raise BadInput(
                f"it needs {rate:.4g} V/s, the slew limit is {limits.slew_V_per_s:g} V/s; "
                f"stay below {slower:.3g} Hz or lower the swing"
            )
        return
    sensor = axis.sensor
    _inside(wave, sensor.x_min_um, sensor.x_max_um, "what the sensor sees")
    if axis.table is not None:
        _inside(wave, -math.inf, axis.table.range_um[1], "what the stage reaches")
        if table and wave.periodic:
            axis.table.phase_deg(axis.table.swing_for_range(wave.swing), wave.f_Hz)


def _inside(wave: Waveform, lowest: float, highest: float, what: str) -> None:
    if lowest <= wave.lowest <= wave.highest <= highest:
        return
    allowed = f"{lowest:.6g}..{highest:.6g}" if math.isfinite(lowest) else f"up to {highest:.6g}"
    target = wave.offset + wave.swing
    if isinstance(wave, Goto) and not lowest <= target <= highest:
        asked, other = f"{target:g}", "a place inside"
    else:
        asked, other = f"{wave.lowest:g}..{wave.highest:g}", "a smaller swing or another offset"
    raise BadInput(f"{asked} {wave.unit} is outside {what} ({allowed} {wave.unit}); choose {other}")
