"""Where an axis can go: the yardstick for sizes given as a share of the range."""

from __future__ import annotations

from functools import lru_cache

from phaselead.model.axis import AxisModel, TimeView


def range_um(axis: AxisModel) -> float:
    """Quasi-static travel in um over the voltages the time view was fitted on; the sensor's span without a view."""
    low, high = ends_um(axis)
    return abs(high - low) or 1.0


def ends_um(axis: AxisModel) -> tuple[float, float]:
    """Positions in um at the ends of a full, slow loop over the voltages the time view was fitted on."""
    if axis.time is None:
        return axis.sensor.x_min_um, axis.sensor.x_max_um
    return _ends_um(axis.time)


@lru_cache(maxsize=64)
def _ends_um(view: TimeView) -> tuple[float, float]:
    low, high = view.u_range_V
    middle = (low + high) / 2
    at_low = at_high = view.offset_um
    at_low += view.gain_um_per_V * low
    at_high += view.gain_um_per_V * high
    for r, w in zip(view.play_r_V, view.play_w_um_per_V, strict=True):
        at_low += w * min(low + r, middle)
        at_high += w * max(high - r, middle)
    for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True):
        at_low += s * max(low - d, 0.0)
        at_high += s * max(high - d, 0.0)
    return at_low, at_high
