"""What begins paths: the start of a device that is parked, or a queue behind what its axes do, at once or at an edge of
the trigger input. All paths of a run begin in the same tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phaselead.control.feeding import send_points
from phaselead.device import TICK_HZ, Device, PointFeeder, QueuedPaths, motion
from phaselead.errors import BadInput
from phaselead.model import Gains
from phaselead.waveforms import Waveform


@dataclass(frozen=True)
class PathsToBegin:
    """Paths of a device that is to have them, each as it begins where its axis stands."""

    waveforms: Mapping[str, Waveform]
    mode: str
    gains: Mapping[str, Gains]
    """By axis; of axes that are held those that they have."""
    ticks: int
    """How long those last that have no length of their own; 0: until told otherwise."""
    enter_s: Mapping[str, float]
    """Of the join into each."""
    leave_s: Mapping[str, float]
    feeder: PointFeeder | None = None
    """Sends the points of paths that are longer than the device's memory."""

    def played(self, axis: str) -> dict[str, Any]:
        """The path of this axis, in the words of ``Device.set_path`` and ``Device.path_segment``."""
        one = self.waveforms[axis]
        if self.feeder is not None and axis in self.feeder.points:
            own = {"kind": "wave", "f_Hz": self.feeder.period_Hz, "ticks": 0}
        else:
            length = self.ticks if one.path_s is None else round(one.path_s * TICK_HZ)
            own = {"kind": one.played_as, "f_Hz": one.f_Hz, "ticks": length}
        return {"swing": one.swing, "offset": one.offset, **own}


def give(
    device: Device, paths: PathsToBegin, *, held: bool = False, edge_within_s: float | None = None
) -> QueuedPaths | None:
    """Gives a device all that its paths need: what is to be queued then, None where they begin with a start.

    ``held``: the axes are held, or follow paths, which those of before give way to, in the mode and with the gains that
    they have. ``edge_within_s``: they begin at an edge of the trigger input, which is waited for so long; axes that are
    not held yet are started first, to hold where they stand.

    Raises BadInput for moves beside periodic paths that are queued, Refused where the device does not take a path.
    """
    queued = held or edge_within_s is not None
    if queued:
        refuse_moves_beside_others(paths.waveforms)
    for axis, waveform in paths.waveforms.items():
        if not held:
            own = paths.gains.get(axis)
            device.set_axis(axis, paths.mode, **(own.sent() if own is not None else {}))
        send_points(device, axis, waveform)
        if not queued:
            device.set_path(axis, **paths.played(axis))
            leaves = waveform.periodic or waveform.played_as == "points"
            motion.join_from_start(device, axis, paths.enter_s[axis], paths.leave_s[axis] if leaves else 0.0)
    return _queued(device, paths, held=held, within_s=edge_within_s) if queued else None


def refuse_moves_beside_others(waveforms: Mapping[str, Waveform]) -> None:
    """Raises BadInput for moves beside other paths that are all to be queued."""
    if len({waveform.played_as == "move" for waveform in waveforms.values()}) > 1:
        raise BadInput(
            "a move begins at once, another path after its join: out of a hold they cannot begin in the same tick; "
            "give one after the other"
        )


def _queued(device: Device, paths: PathsToBegin, *, held: bool, within_s: float | None) -> QueuedPaths:
    """All are entered in the same time, so that they begin together."""
    enter_s = max(paths.enter_s.values())
    enter, leave = motion.join_ticks(enter_s), motion.join_ticks(max(paths.leave_s.values()))
    if not held:
        for axis in paths.waveforms:
            motion.hold_from_start(device, axis, enter_s)
    segments = {
        axis: device.path_segment(axis, **paths.played(axis), enter_ticks=enter, leave_ticks=leave)
        for axis in paths.waveforms
    }
    joined = max(one.enter_ticks for one in segments.values()) + motion.look_ahead_ticks(device, "".join(segments))
    request = motion.queue_request(segments, at_once=held, at_trigger=within_s is not None)
    return QueuedPaths(request, joined, None if held else 2 * enter, within_s)
