"""Paths that begin at an edge of the trigger input: until then the axes hold where they stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from phaselead.control.feeding import send_points
from phaselead.device import AXES, TICK_HZ, Device, EdgeWait, PointFeeder, motion, path_request, wire
from phaselead.errors import BadInput
from phaselead.model import Gains
from phaselead.waveforms import Waveform


def start_at_edge(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str,
    gains: Mapping[str, Gains],
    *,
    ticks: int,
    enter_s: float,
    leave_s: float,
    feeder: PointFeeder | None,
    within_s: float,
) -> EdgeWait:
    """Gives the device holds to start, and what is then queued. All paths are entered in the same time, so that they
    begin together.

    Raises BadInput for moves beside periodic paths, Refused by a device of before revision 4 of the wire.
    """
    if len({waveform.played_as == "move" for waveform in waveforms.values()}) > 1:
        raise BadInput("a move begins at the edge, another path after its join: they cannot begin at the same one")
    enter_ticks, leave_ticks = motion.join_ticks(enter_s), motion.join_ticks(leave_s)
    segments = {}
    for axis, waveform in waveforms.items():
        own = gains.get(axis)
        device.set_axis(axis, mode, **(own.sent() if own is not None else {}))
        send_points(device, axis, waveform)
        path = _path(AXES.index(axis), waveform, ticks, feeder, mode == "open")
        motion.hold_from_start(device, axis, enter_s, wire.PathKind(path.path))
        if waveform.played_as == "move":
            target = replace(path, swing=path.swing + path.offset, offset=0)
            segments[axis] = replace(motion.path_segment(target, 0, 0), flags=wire.PathFlag.FROM_HERE)
        else:
            segments[axis] = motion.path_segment(path, enter_ticks, leave_ticks)
    three = tuple(segments.get(axis, motion.NOTHING) for axis in AXES)
    mask = sum(1 << AXES.index(axis) for axis in segments)
    return EdgeWait(wire.QueueRequest(mask, 0, 0, three, 1), 2 * enter_ticks, within_s)


def _path(axis: int, waveform: Waveform, ticks: int, feeder: PointFeeder | None, volts: bool) -> wire.SetPathRequest:
    swing, offset = waveform.swing, waveform.offset
    if waveform.played_as == "points":
        assert feeder is not None
        return path_request(axis, wire.PathKind.WAVE, swing, offset, feeder.period_Hz, 0, volts)
    length = ticks if waveform.path_s is None else round(waveform.path_s * TICK_HZ)
    return path_request(axis, wire.PathKind[waveform.played_as.upper()], swing, offset, waveform.f_Hz, length, volts)
