"""Which position follows a path: where the stage truly is, or what its sensor shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np

from phaselead.control.rounding import rounding_s
from phaselead.device import TICK_HZ, Capture, Device
from phaselead.errors import BadInput
from phaselead.model import Stage, sensor_lag_s
from phaselead.record import Recording, Samples
from phaselead.waveforms import Repeated, RepeatedAsSensed, Replaced, Rounded, Streamed, Waveform


@runtime_checkable
class TracedPort(Protocol):
    """A port with a virtual stage at its end."""

    def trace_true_positions(self, ticks: int) -> None: ...
    def true_positions(self) -> tuple[int, Samples]: ...


Follows = Literal["true", "measured"]
FOLLOWS: tuple[Follows, ...] = get_args(Follows)
SPARE_TICKS = 5 * TICK_HZ
"""Kept besides a run: what passes before it starts and while it parks."""


def followed(
    waveforms: Mapping[str, Waveform], stage: Stage | None, follows: Follows, mode: str
) -> dict[str, Waveform]:
    """The paths as the device is asked for them. ``"true"``: where the model says by how much the sensor is late,
    a periodic path in micrometres is as late, so that the stage itself is where it was asked to be. Corners that the
    output is too slow for in this mode are rounded. Raises BadInput for another word in ``follows``."""
    if follows not in FOLLOWS:
        raise BadInput(f"follows {follows!r} is no position; give {' or '.join(map(repr, FOLLOWS))}")
    found = dict(waveforms)
    for axis, waveform in waveforms.items():
        lag_s = _lag_s(stage, axis, waveform) if follows == "true" else 0.0
        model = None if stage is None else stage.axes.get(axis)
        rounded_s = 0.0 if model is None else rounding_s(model, waveform, mode)
        if lag_s > 0 or rounded_s > 0:
            found[axis] = _played(waveform, lag_s, rounded_s)
    return found


def _played(waveform: Waveform, lag_s: float, rounded_s: float) -> Waveform:
    if isinstance(waveform, Repeated):
        return RepeatedAsSensed.of(waveform, lag_s, rounded_s)
    if isinstance(waveform, Streamed):
        return Rounded.of(waveform, rounded_s)
    return Replaced.as_sensed(waveform, lag_s, rounded_s)


def _lag_s(stage: Stage | None, axis: str, waveform: Waveform) -> float:
    """0 also for a path that is replaced already, and for a move, whose end is the same."""
    known = stage is not None and axis in stage.axes and waveform.unit == "um" and waveform.periodic
    return sensor_lag_s(stage.axes[axis]) if stage is not None and known and waveform.as_asked is waveform else 0.0


class TruePositions:
    """Where a virtual stage truly is during a run; on a real port nothing."""

    def __init__(self, device: Device, ticks: int) -> None:
        port = device.session.port
        self._port = port if isinstance(port, TracedPort) else None
        if self._port is not None:
            self._port.trace_true_positions(ticks + SPARE_TICKS)

    def of(self, recording: Recording, capture: Capture) -> dict[str, Samples] | None:
        """By axis, shape (n,), at the rows of the recording; None where they are not known. Ends the trace."""
        if self._port is None:
            return None
        first, positions_um = self._port.true_positions()
        self._port.trace_true_positions(0)
        rows = capture.recorded_from - first + np.rint(recording.t_s * TICK_HZ).astype(int)
        if not len(rows) or rows[0] < 0 or rows[-1] >= len(positions_um):
            return None
        return {axis: positions_um[rows, "xyz".index(axis)].copy() for axis in recording.axes}
