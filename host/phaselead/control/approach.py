"""The way to a written offset before a path begins: at what rate the output may take it."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.device import LARGEST_STEP
from phaselead.errors import BadInput
from phaselead.model import Stage, small_signal
from phaselead.waveforms import Waveform

ROOM = 2.0
"""Times the steepest voltage of the path itself: feedback is not to meet the limit while it follows."""
LONGEST_S = 0.1
"""Of an approach: ``tracking_error`` is a fault once the position has been far off for so long (``limits.error_s``)."""


def jumps(waveform: Waveform) -> bool:
    """Whether the path begins at an offset that the output has to go to first."""
    return waveform.goes_to_start and abs(waveform.offset) > LARGEST_STEP[waveform.unit]


def with_gentle_approach(stage: Stage, waveforms: Mapping[str, Waveform]) -> Stage:
    """The stage with the slew limit of its axes lowered for this run, where a sine in micrometres begins at an offset:
    to what the sine needs twice over, and no less than parking does. Other paths have corners that need all of it."""
    axes = {axis: approach_slew_V_per_s(stage, axis, waveform) for axis, waveform in waveforms.items()}
    slower = {
        axis: stage.axes[axis].model_copy(
            update={"limits": stage.axes[axis].limits.model_copy(update={"slew_V_per_s": rate})}
        )
        for axis, rate in axes.items()
        if rate is not None
    }
    return stage.model_copy(update={"axes": {**stage.axes, **slower}}) if slower else stage


def approach_slew_V_per_s(stage: Stage | None, axis: str, waveform: Waveform) -> float | None:
    """The rate of the approach, V/s; None where the stage's slew limit stays."""
    if stage is None or axis not in stage.axes or not jumps(waveform) or waveform.has_corners:
        return None
    limits = stage.axes[axis].limits
    try:
        flattest = small_signal(stage.axes[axis]).gain_um_per_V[0]
    except BadInput:
        return None
    if waveform.unit != "um" or flattest <= 0:
        return None
    needed = max(
        ROOM * waveform.steepest() / flattest, abs(waveform.offset) / flattest / LONGEST_S, limits.ramp_V_per_s
    )
    return needed if needed < limits.slew_V_per_s else None
