"""Every tick of the axes as it comes, in units, whatever the device does meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.device import Device, axis_index
from phaselead.device.quantities import TICK_HZ, Converters
from phaselead.device.session import SHORTEST_REPLY
from phaselead.device.stream import ALL_CHANNELS, HEAD, mask_of, tick_dtype
from phaselead.errors import BadInput

Values = NDArray[np.float32]
MOST_BEHIND_S = 0.25
"""A virtual device that is further behind our clock, or ahead of it, takes the difference as given."""
FEED_S = 0.25
"""A quarter of the device's host timeout."""
Q11, Q16 = np.float32(2.0**-11), np.float32(2.0**-16)


@dataclass(frozen=True)
class LiveAxis:
    """One axis of a few ticks, shape (n,) each; ``r_um`` is NaN where the axis follows no position."""

    r_um: Values
    x_um: Values
    u_V: Values
    ff_V: Values
    fb_V: Values


@dataclass(frozen=True)
class LiveSamples:
    """A few ticks in a row. ``missing`` were to come before ``first_tick`` and did not: dropped or lost."""

    first_tick: int
    ticks: int
    axes: Mapping[str, LiveAxis]
    missing: int = 0

    def without_reference(self) -> LiveSamples:
        """The same of axes that follow nothing."""
        nothing = np.full(self.ticks, np.nan, np.float32)
        return replace(self, axes={axis: replace(one, r_um=nothing) for axis, one in self.axes.items()})


class Live:
    """A stream that goes on until it is closed; ``read`` gives what has come since.

    Samples of other captures on the same device, of ``track`` or ``identify``, come through too; they end the stream,
    and ``start`` begins it again. ``before_each``, when set, is called after every read of the port, also during
    captures: what it raises ends what is under way, as Ctrl-C does.

    >>> import phaselead as pl
    >>> with pl.connect() as dev, dev.live("x") as live:
    ...     dev.play("sine:20um@5Hz", mode="pid")
    ...     samples = [part for _ in range(10) for part in live.read(0.02)]
    >>> samples[-1].axes["x"].x_um.dtype, sum(part.missing for part in samples)
    (dtype('float32'), 0)
    """

    def __init__(self, device: Device, axes: str) -> None:
        """Of these axes; ``start`` begins it."""
        if not axes or len(set(axes)) != len(axes):
            raise BadInput(f"a stream of axes {axes!r}: at least one, each once")
        for axis in axes:
            axis_index(axis)
        self._device, self.axes = device, axes
        self.before_each: Callable[[], None] | None = None
        self._calibration: Mapping[str, Converters] = {}
        self._came: list[LiveSamples] = []
        self._next_tick: int | None = None
        self._sequence = -1
        self._anchor_s = (0.0, 0.0)
        """Of our clock and the device's, when they last agreed."""
        self._fed_s = -FEED_S

    def __enter__(self) -> Live:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Begins the stream, or begins it again after another capture, or after the model has changed.

        Raises DeviceRefused when the line is too slow for so many axes.
        """
        session = self._device.session
        with session.lock:
            self._calibration = self._device.converters()
            session.request(wire.StreamStartRequest(ALL_CHANNELS, mask_of(self.axes), 1))
            session.tap = self._take

    def pause(self) -> None:
        """Ends the stream until ``start``."""
        session = self._device.session
        with session.lock:
            session.request(wire.StreamStopRequest())
            session.samples = []

    def close(self) -> None:
        """Ends it for good."""
        self._device.session.tap = self.before_each = None
        self.pause()

    def read(self, seconds: float = 0.02) -> list[LiveSamples]:
        """Waits for what comes within about so long, and gives all that has come since the last call.

        A virtual device is let run at the pace of our clock. Raises LinkError when the port has gone away.
        """
        session = self._device.session
        with session.lock:
            if not session.virtual:
                size = tick_dtype(ALL_CHANNELS, mask_of(self.axes)).itemsize * round(TICK_HZ * seconds)
                session.pump(max(size, session.in_waiting(), SHORTEST_REPLY))
                session.samples = []
        if session.virtual:
            self._keep_pace(seconds)
        return self.take()

    def take(self) -> list[LiveSamples]:
        """What has come since the last call, without reading; within ``before_each``."""
        came, self._came = self._came, []
        return came

    def _keep_pace(self, seconds: float) -> None:
        session, now_s = self._device.session, time.monotonic()
        behind_s = (now_s - self._anchor_s[0]) - (session.now_s() - self._anchor_s[1])
        if abs(behind_s) > MOST_BEHIND_S:
            self._anchor_s, behind_s = (now_s, session.now_s()), 0.0
            self._fed_s = -FEED_S
        if behind_s < seconds:
            time.sleep(seconds - behind_s)
            behind_s = seconds
        timeout_s, session.port.timeout = session.port.timeout, max(behind_s, 1 / TICK_HZ)
        try:
            with session.lock:
                session.pump(1 << 20)
                if session.now_s() - self._fed_s >= FEED_S:  # nobody else does in virtual time
                    session.request(wire.StatusRequest())
                    self._fed_s = session.now_s()
                session.samples = []
        finally:
            session.port.timeout = timeout_s

    def _take(self, bodies: list[bytes]) -> None:
        """What the session has read; called by whoever reads."""
        for body in bodies:
            self._came.append(self._decoded(body))
        if self.before_each is not None:
            self.before_each()

    def _decoded(self, body: bytes) -> LiveSamples:
        head = np.frombuffer(body, HEAD, 1)[0]
        first, sequence = int(head["first_tick"]), int(head["sequence"])
        layout = tick_dtype(int(head["channels"]), int(head["axis_mask"]))
        rows = np.frombuffer(body, layout, offset=HEAD.itemsize)
        expected = self._next_tick
        missing = max(first - expected, 0) if expected is not None and sequence > self._sequence else 0
        self._next_tick, self._sequence = first + len(rows), sequence
        axes = {axis: self._axis(axis, rows[axis]) for axis in layout.names or ()}
        return LiveSamples(first, len(rows), axes, missing)

    def _axis(self, axis: str, rows: NDArray[np.void]) -> LiveAxis:
        nothing = np.full(len(rows), np.nan, np.float32)
        has = rows.dtype.names or ()
        converter = self._calibration[axis]
        follows = "reference" in has and self._device.mode(axis) not in (None, wire.Mode.OPEN, wire.Mode.IDLE)
        return LiveAxis(
            r_um=rows["reference"] * Q16 if follows else nothing,
            x_um=converter.x_um(rows["adc"]).astype(np.float32) if "adc" in has else nothing,
            u_V=converter.u_V(rows["dac"]).astype(np.float32) if "dac" in has else nothing,
            ff_V=rows["feedforward"] * Q11 if "feedforward" in has else nothing,
            fb_V=rows["feedback"] * Q11 if "feedback" in has else nothing,
        )
