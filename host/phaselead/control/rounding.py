"""The corners of a periodic path, rounded by what the slew limit asks for and no more.

A stage with a mode follows a corner only by a jump of the voltage, which what undoes the mode asks for as fast as it
can. What the slew limit cuts off of that rings the stage. The best path within a rate of the voltage has a jerk of one
size at its corners, up and down: two means over the same time, one after the other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phaselead.control.modes import INVERTS
from phaselead.control.motion_limits import PATH_ROOM, first_mode_Hz
from phaselead.errors import BadInput
from phaselead.model import TICK_S, AxisModel, Stage, compensation, small_signal
from phaselead.record import Samples
from phaselead.waveforms import Curve, Waveform, mean_twice

FINE = 8192
"""Points of a period in which the voltage is worked out: half of the tick rate from 0.6 Hz on."""
HALVINGS = 16
"""Of the time, from half a period of the mode on: to 40 ns."""


def rounding_s(stage: Stage | None, axis: str, waveform: Waveform, mode: str) -> float:
    """The time of each of the two means over a path in micrometres, in modes that invert; 0 where it needs none, is no
    period, has no corners, or is played in place of another. 0 too where no rounding helps, since what lies at the
    first mode and below is too fast: that is another path, and a rehearsal says so."""
    played = waveform.periodic and waveform.unit == "um" and waveform.as_asked is waveform
    played = played and not isinstance(waveform, Curve)
    if mode not in INVERTS or not played or stage is None or axis not in stage.axes:
        return 0.0
    model = stage.axes[axis]
    first_Hz = first_mode_Hz(model)
    if first_Hz is None:
        return 0.0
    try:
        rate = _rate_V_per_s(model, waveform)
    except BadInput:
        return 0.0
    slow_Hz, limit = max(first_Hz, waveform.f_Hz), PATH_ROOM * model.limits.slew_V_per_s
    longest_s = 0.5 / slow_Hz

    def rate_of(s: float) -> float:
        return rate(lambda f_Hz: mean_twice(f_Hz, s))

    if rate_of(0.0) <= limit or rate(lambda f_Hz: np.where(f_Hz <= slow_Hz, 1.0, 0.0)) > limit:
        return 0.0
    if rate_of(longest_s) > limit:
        return 0.0
    low_s, high_s = 0.0, longest_s
    for _ in range(HALVINGS):
        middle_s = (low_s + high_s) / 2
        low_s, high_s = (middle_s, high_s) if rate_of(middle_s) > limit else (low_s, middle_s)
    return high_s


def _rate_V_per_s(model: AxisModel, waveform: Waveform) -> Callable[[Callable[[Samples], Samples]], float]:
    """The largest rate from tick to tick that the inverse asks for, of the path with each of its frequencies times a
    share; at the gain between that of a turn and that of a long way. Raises BadInput without an inverse."""
    found, gain = compensation(model), sum(small_signal(model).gain_um_per_V) / 2
    f_Hz = waveform.f_Hz * np.arange(FINE // 2 + 1, dtype=np.float64)
    path = np.fft.rfft(waveform.value(np.arange(FINE) / FINE / waveform.f_Hz))
    per_tick = (1 - np.exp(-2j * np.pi * f_Hz * TICK_S)) * (f_Hz < 0.5 / TICK_S)
    lines = path * per_tick * found.shape_response(f_Hz) * found.drive.response(f_Hz) / (gain * TICK_S)
    return lambda share: float(np.abs(np.fft.irfft(lines * share(f_Hz), FINE)).max())
