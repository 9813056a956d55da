"""Paths one after another while a device runs, in the user's units: queue, hold, where (docs/firmware.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from phaselead.device import wire
from phaselead.device.device import Device, axis_index
from phaselead.device.quantities import TICK_HZ, to_i32
from phaselead.device.status import name_of
from phaselead.device.stream import AXES, mask_of
from phaselead.errors import BadInput
from phaselead.result import Result, Table
from phaselead.waveforms import PEAK_SPEED

FINE = 2.0**40
"""Of a micrometre: the unit of the device's limits of motion."""
JOIN_MOST = 65535
LOOKS_AHEAD = (wire.Mode.INVERSE, wire.Mode.INVERSE_PID)
NOTHING = wire.Segment(wire.PathKind.HOLD, 0, 0, 0, 0, 0, 0, 0)


@dataclass(frozen=True)
class MotionLimits:
    """How fast a reference may go; 0 is no limit."""

    velocity_um_per_s: float = 0.0
    acceleration_um_per_s2: float = 0.0
    jerk_um_per_s3: float = 0.0

    def shortest_s(self, way_um: float) -> float:
        """The shortest least-jerk move by so much, a whole number of ticks, at least one."""
        way, ways = abs(way_um), [1 / TICK_HZ]
        if self.velocity_um_per_s:
            ways.append(PEAK_SPEED * way / self.velocity_um_per_s)
        if self.acceleration_um_per_s2:
            ways.append((10 / 3**0.5 * way / self.acceleration_um_per_s2) ** (1 / 2))
        if self.jerk_um_per_s3:
            ways.append((60 * way / self.jerk_um_per_s3) ** (1 / 3))
        return float(np.ceil(max(ways) * TICK_HZ * (1 + 1e-3)) / TICK_HZ)


@dataclass(frozen=True)
class AxisWhere:
    """Where one axis is, and where it goes."""

    x_um: float
    u_V: float
    reference_um: float
    target_um: float
    """Where the last path of its queue ends."""
    held: bool
    """It follows a path, or holds where one ended."""
    on_target: bool
    moving: bool
    queued: int
    dry: bool
    """Its queue ran dry: a path that was to be followed by another was not. It holds."""
    near_ticks: int
    """In a row within the window."""

    def in_words(self, resting: str) -> str:
        """What it does; ``resting`` where it is not held."""
        said = "on target" if self.on_target else "moving" if self.moving else "off target" if self.held else resting
        return f"{said}, its queue ran dry" if self.dry else said


@dataclass(frozen=True)
class Where(Result):
    """Where the axes are; prints as a table. ``x``, ``y``, ``z`` are the axes."""

    tick: int
    state: str
    fault: str
    axes: Mapping[str, AxisWhere]

    def __getattr__(self, name: str) -> AxisWhere:
        try:
            return self.__dict__["axes"][name]  # type: ignore[no-any-return]
        except KeyError:
            raise AttributeError(name) from None

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead where --json`` writes it: figures by axis. An axis that is not held has no target (None)."""
        names = ("x_um", "u_V", "reference_um", "target_um", "held", "on_target", "moving", "queued", "dry")
        found = {axis: {name: getattr(one, name) for name in names} for axis, one in self.axes.items()}
        for axis, one in self.axes.items():
            if not one.held:
                found[axis] |= {"reference_um": None, "target_um": None}
        return {"tick": self.tick, "state": self.state, "fault": self.fault, "axes": found}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row an axis."""
        rows = [{"axis": axis, **figures} for axis, figures in self.as_dict()["axes"].items()]
        return {name: [row[name] for row in rows] for name in rows[0]}

    def tables(self) -> list[Table | str]:
        resting = "not held" if self.state == "running" else self.state
        rows = tuple(
            (
                axis,
                f"{one.x_um:.3f}",
                f"{one.u_V:.4f}",
                f"{one.target_um:.3f}" if one.held else "-",
                one.in_words(resting),
            )
            for axis, one in self.axes.items()
        )
        return [Table(("axis", "position (µm)", "output (V)", "target (µm)", ""), rows)]


def where(device: Device) -> Where:
    """Where every axis is; also feeds the host timeout."""
    calibration = device.converters()
    found = device.session.request(wire.WhereRequest())

    def axis(index: int, name: str) -> AxisWhere:
        code = np.array([found.adc_codes[index]], np.uint16)
        bit = 1 << index
        return AxisWhere(
            x_um=float(calibration[name].x_um(code)[0]),
            u_V=found.u_q24[index] / 2**24,
            reference_um=found.reference[index] / 2**16,
            target_um=found.end[index] / 2**16,
            held=bool(found.driven & bit),
            on_target=bool(found.on_target & bit),
            moving=bool(found.moving & bit),
            queued=found.queued[index],
            dry=bool(found.dry & bit),
            near_ticks=found.near_ticks[index],
        )

    return Where(
        found.tick,
        name_of(wire.State, found.state),
        name_of(wire.Fault, found.fault),
        {name: axis(index, name) for index, name in enumerate(AXES)},
    )


def set_motion(device: Device, axis: str, limits: MotionLimits, window_um: float, window_s: float) -> None:
    """Limits of what is queued from now on, and what counts as on target. Raises BadInput."""
    asked = (limits.velocity_um_per_s, limits.acceleration_um_per_s2, limits.jerk_um_per_s3)
    velocity, acceleration, jerk = (round(value * FINE / TICK_HZ**order) for order, value in enumerate(asked, 1))
    window_q16 = to_i32(window_um, 16, "window", "um")
    window_ticks = max(1, round(window_s * TICK_HZ))
    device.session.request(wire.MotionRequest(axis_index(axis), velocity, acceleration, jerk, window_q16, window_ticks))


def hold_from_start(device: Device, axis: str, join_s: float) -> None:
    """The path of an axis: to hold where it stands when it is started, passed to within ``join_s``."""
    device.set_path(axis, wire.PathKind.HOLD)
    device.session.request(wire.SetJoinsRequest(axis_index(axis), wire.PathFlag.FROM_HERE, join_ticks(join_s), 0))


def join_from_start(device: Device, axis: str, enter_s: float, leave_s: float) -> None:
    """How the path that was set is entered from where the axis stands, and left when it ends."""
    request = wire.SetJoinsRequest(axis_index(axis), 0, join_ticks(enter_s), join_ticks(leave_s))
    device.session.request(request)


def join_ticks(seconds: float) -> int:
    """Ticks of a join. Raises BadInput beyond 13.1 s."""
    ticks = round(seconds * TICK_HZ)
    if not 0 <= ticks <= JOIN_MOST:
        raise BadInput(f"a join of {seconds:g} s: at most {JOIN_MOST / TICK_HZ:g} s")
    return ticks


def move_segment(target_um: float, duration_s: float, *, enter_s: float = 0.0, more: bool = False) -> wire.Segment:
    """A least-jerk move from where the path before ends to ``target_um``."""
    ticks = max(1, round(duration_s * TICK_HZ))
    flags = wire.PathFlag.FROM_HERE | (wire.PathFlag.MORE if more else 0)
    step = min(-(-(2**64) // ticks), 2**63 - 1)
    return wire.Segment(
        wire.PathKind.MOVE, flags, to_i32(target_um, 16, "target", "um"), 0, step, 0, join_ticks(enter_s), 0
    )


def look_ahead_ticks(device: Device, axes: str) -> int:
    """How much later the paths of these axes begin than they are due: by the longest preview of those whose mode looks
    ahead."""
    ahead = [axis_index(axis) for axis in axes if (device.mode(axis) or 0) in LOOKS_AHEAD]
    blob = device.read_model() if ahead else None
    if blob is None:
        return 0
    models = wire.Model.unpack(blob).axes
    return max(-(-models[index].preview_ticks_q16 >> 16) for index in ahead)


def hold_segment(enter_s: float) -> wire.Segment:
    """To stop where the axis is half a join from now."""
    return wire.Segment(wire.PathKind.HOLD, wire.PathFlag.FROM_HERE, 0, 0, 0, 0, join_ticks(enter_s), 0)


def queue_request(
    segments: Mapping[str, wire.Segment], *, at_once: bool = False, begin_tick: int = 0, at_trigger: bool = False
) -> wire.QueueRequest:
    """What ``queue`` sends. Raises BadInput."""
    for axis in segments:
        axis_index(axis)
    three = tuple(segments.get(axis, NOTHING) for axis in AXES)
    return wire.QueueRequest(mask_of("".join(segments)), int(at_once), begin_tick, three, int(at_trigger))


def queue(
    device: Device,
    segments: Mapping[str, wire.Segment],
    *,
    at_once: bool = False,
    begin_tick: int = 0,
    at_trigger: bool = False,
) -> int:
    """Puts a path behind those under way, for each axis; all begin in the same tick, with ``at_trigger`` not before an
    edge of the trigger input. Returns the device's tick.

    Raises Refused, in the words of protocol/schema.toml.
    """
    request = queue_request(segments, at_once=at_once, begin_tick=begin_tick, at_trigger=at_trigger)
    return device.session.request(request).tick
