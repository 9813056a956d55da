"""How fast and how far an axis may be moved, from its model: what its output, its first mode and its sensor allow."""

from __future__ import annotations

import math
from collections.abc import Mapping

from phaselead.control.gains import UNSEEN_MODE
from phaselead.control.modes import INVERTS
from phaselead.device import Limits, MotionLimits
from phaselead.errors import BadInput
from phaselead.model import AxisModel, SmallSignal, compensation, respond, rest_plays, small_signal
from phaselead.waveforms import PEAK_SPEED

UNKNOWN_um_per_s = 1000.0
"""Without a model: about what parking at 50 V/s does on a stage of 20 um/V."""
PATH_ROOM = 7 / 8
"""Of the slew limit, for a path; tuned loops leave the rest to noise, and what is cut off rings."""
SIGMAS = 5.0
"""Of the sensor's noise: a sample beyond them once in 1.7 million, 6 minutes at 5 kHz."""
WINDOW_S = 0.01
"""On target is who stays within the window for so long: two periods of a mode of 200 Hz."""


def motion_limits(model: AxisModel | None) -> MotionLimits:
    """Limits of a reference: those at which the output would need its whole slew limit, or its whole range.

    A mode of frequency f needs x + x''/(2 pi f)^2 of static position (Devasia, Eleftheriou and Moheimani 2007, IEEE
    Trans. Control Syst. Technol. 15, 802: inversion feed-forward), so its output goes at x' + x'''/(2 pi f)^2 over the
    gain; a least-jerk move has its largest velocity where its jerk slows the output down. The gain is that between the
    flattest and the steepest of the hysteresis loop.
    """
    plant = None if model is None else _plant(model)
    if model is None or plant is None:
        return MotionLimits(velocity_um_per_s=UNKNOWN_um_per_s)
    limits, gain = model.limits, sum(plant.gain_um_per_V) / 2
    velocity = limits.slew_V_per_s * gain
    f_Hz = first_mode_Hz(model)
    if f_Hz is None:
        return MotionLimits(velocity_um_per_s=velocity)
    squared = (2 * math.pi * f_Hz) ** 2
    return MotionLimits(velocity, (limits.u_max_V - limits.u_min_V) * gain * squared, velocity * squared)


def first_mode_Hz(model: AxisModel) -> float | None:
    """Of the modes that feedback meets the lowest, Hz; None where the model shows none."""
    plant = _plant(model)
    return None if plant is None else min((f_Hz for _, f_Hz, _ in plant.modes), default=None)


def tells_small_signal(model: AxisModel) -> bool:
    """Whether limits come from the model itself."""
    return _plant(model) is not None


def _plant(model: AxisModel) -> SmallSignal | None:
    """None where the model does not tell."""
    try:
        return small_signal(model)
    except BadInput:
        return None


def usual_duration_s(way_um: float, limits: MotionLimits, model: AxisModel | None, mode: str) -> float:
    """Of a move that nobody gave a duration: the shortest and, where the mode is not undone, two of its periods: a
    least-jerk move of that length has next to no power there. Where no mode is known, none is undone: two periods of
    the slowest that gains are designed for."""
    shortest_s = limits.shortest_s(way_um)
    f_Hz = None if model is None else first_mode_Hz(model)
    if f_Hz is not None and mode in INVERTS:
        return shortest_s
    return max(shortest_s, 2 / (f_Hz or UNSEEN_MODE[1]))


def refuse_too_fast(axis: str, way_um: float, duration_s: float, model: AxisModel | None) -> None:
    """Raises BadInput for a move that the limits do not allow, naming the shortest that they do."""
    if not duration_s > 0:
        raise BadInput(f"{axis}: a duration of {duration_s:g} s: give one above 0")
    shortest_s = motion_limits(model).shortest_s(way_um)
    if duration_s >= shortest_s * (1 - 1e-9):
        return
    guessed = model is None or _plant(model) is None
    raise BadInput(
        f"{axis}: a move of {abs(way_um):.4g} um in {duration_s * 1e3:.3g} ms is faster than "
        + (f"{UNKNOWN_um_per_s:g} um/s, assumed for want of a model" if guessed else "the stage's limits allow")
        + f"; the shortest is {shortest_s * 1e3:.4g} ms, at {PEAK_SPEED * abs(way_um) / shortest_s:.4g} um/s"
        + ("; --model STAGE.toml tells what the stage can do" if guessed else "")
    )


def refuse_beyond_hard_limits(hard: Limits, targets_um: Mapping[str, float]) -> None:
    """Raises BadInput for a target that the device's own limits leave out, whatever the model."""
    for axis, target_um in targets_um.items():
        low, high = hard[axis].x_min_um, hard[axis].x_max_um
        if (low is not None and target_um < low) or (high is not None and target_um > high):
            span = f"{'' if low is None else f'{low:.6g}'}..{'' if high is None else f'{high:.6g}'} um"
            raise BadInput(
                f"{axis}: {target_um:.6g} um is beyond the hard limits of the device ({span}); choose a place inside; "
                "`phaselead limits` shows and changes them"
            )


def window_um(model: AxisModel | None) -> float:
    """How far off target noise alone takes a reading: five sigmas and half a code."""
    sensor = (model or AxisModel()).sensor
    code_um = (sensor.x_max_um - sensor.x_min_um) / 2**sensor.bits
    return float(SIGMAS * sensor.noise_um_rms + code_um / 2)


def reach_um(mode: str | None, model: AxisModel) -> tuple[float, float]:
    """The lowest and the highest target that the sensor and the model allow in this mode; None: in any."""
    low, high = model.sensor.x_min_um, model.sensor.x_max_um
    if model.table is not None:
        high = min(high, model.table.range_um[1])
    if mode in INVERTS:
        lowest, highest = compensation(model).reach_um
        low, high = max(low, lowest), min(high, highest)
    return low, high


def rests_unseen(model: AxisModel) -> str | None:
    """In words where the model rests beyond the rails of its sensor, so that no path and no gains work."""
    view, sensor, rest_V = model.time, model.sensor, model.limits.u_park_V
    assert view is not None
    at_um = float(respond(view, [rest_V], rest_plays(view))[0][0])
    if sensor.x_min_um < at_um < sensor.x_max_um:
        return None
    return (
        f"it rests at {at_um:.4g} um at {rest_V:g} V, outside what its sensor sees "
        f"({sensor.x_min_um:g}..{sensor.x_max_um:g} um); if the recordings were not zeroed as the sensor is, take that "
        "off their positions and fit again, else write what the sensor sees into the stage file (x_min_um, x_max_um)"
    )
