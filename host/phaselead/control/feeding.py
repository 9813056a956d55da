"""Points of paths: of those that the device's memory holds before, of longer ones while it plays them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from phaselead.control.modes import USES_TABLES
from phaselead.device import TICK_HZ, Device, PointFeeder
from phaselead.errors import BadInput
from phaselead.waveforms import Replaced, Streamed, Waveform

LONGEST_PREVIEW_TICKS = 1024
"""What the device looks ahead at most."""


def refuse_without_period(axis: str, waveform: Waveform, mode: str) -> None:
    """Tables look up a swing and a frequency, which a path of points lacks. Raises BadInput."""
    if isinstance(waveform, Streamed) and mode in USES_TABLES:
        inverse = "inverse+pid" if mode.endswith("pid") else "inverse"
        raise BadInput(
            f"{axis}: mode {mode} looks up swing and frequency, of which path: has none; use --mode {inverse} or pid"
        )


def refuse_endless(waveforms: Mapping[str, Waveform]) -> None:
    """Raises BadInput for a path of points, which needs somebody who sends them."""
    for axis, waveform in waveforms.items():
        if isinstance(waveform, Streamed):
            raise BadInput(f"{axis}: path: is sent by `track` while it is played; to leave one running use file:")


def point_feeder(
    device: Device,
    waveforms: Mapping[str, Waveform],
    ticks: int,
    entered_s: Mapping[str, float],
    left_s: Mapping[str, float],
) -> PointFeeder | None:
    """What sends the points of these paths, as far as they are played from points; None when none is."""
    fed = {axis: one for axis, one in waveforms.items() if isinstance(one, Streamed)}
    if not fed:
        return None
    log2 = min(one.log2 for one in fed.values())
    point_s = 2**log2 / TICK_HZ
    ends = {axis: round(one.path_s * TICK_HZ) for axis, one in fed.items() if one.path_s is not None}
    if len(set(ends.values())) > 1 or 0 < len(ends) < len(fed):
        said = ", ".join(f"{axis} {ticks / TICK_HZ:g} s" for axis, ticks in ends.items())
        raise BadInput(f"paths of points must end together ({said}); give the files the same length")
    return PointFeeder(
        device.session,
        {axis: partial(one.points_of, log2=log2) for axis, one in fed.items()},
        log2,
        {axis: one.steepest_share * one.f_Hz * point_s for axis, one in fed.items()},
        enter_ticks=max(round(entered_s[axis] * TICK_HZ) for axis in fed),
        length_ticks=min([ticks, *ends.values()]),
        tail_ticks=max(round(left_s[axis] * TICK_HZ) for axis in fed) + 2 * LONGEST_PREVIEW_TICKS,
    )


def send_points(device: Device, axis: str, waveform: Waveform) -> None:
    """The points of an axis whose path is a waveform; what was learned goes with what it was learned for."""
    if waveform.points is None:
        return
    if isinstance(waveform, Replaced) and waveform.learned:
        device.upload_learned(axis, waveform.points, swing=waveform.swing, offset=waveform.offset, f_Hz=waveform.f_Hz)
    else:
        device.upload_wave(axis, waveform.points)
