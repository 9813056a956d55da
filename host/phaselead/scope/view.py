"""What one tab is sent: columns of the traces as they come, the spectrum, the loop; as bytes (docs/scope.md)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.scope.samples import KEPT_S, TRACES, Samples
from phaselead.scope.trigger import Trigger

HEAD = struct.Struct("<BBBBIIIddd")
"""Kind, whether what was sent before is void, axes, traces; columns, ticks a column, dropped in all; the first tick,
the tick of the trigger (NaN: none), ticks that have come."""
COLUMNS, SPECTRUM, LOOP = 1, 2, 3
MOST_COLUMNS, LEAST_COLUMNS = 4000, 16
SPECTRUM_TICKS, SPECTRUM_COLUMNS = 8192, 400
LOOP_TICKS = TICK_HZ
LOOPS = {"x/u": ("u_V", "x_um"), "x/r": ("r_um", "x_um"), "e/r": ("r_um", "e_um")}
"""Across and up, by name; ``y/x`` is of two axes."""


@dataclass
class View:
    """What one tab wants to see."""

    window_s: float = 2.0
    columns: int = 800
    spectrum: str = ""
    loop: str = ""

    def __post_init__(self) -> None:
        if not 0.01 <= self.window_s <= KEPT_S:
            raise BadInput(f"a window of {self.window_s:g} s: from 0.01 to {KEPT_S:g} s")
        if self.spectrum not in ("", *TRACES) or self.loop not in ("", "y/x", *LOOPS):
            raise BadInput(f"spectrum of {', '.join(TRACES)}; loop {', '.join(LOOPS)} or y/x")
        self.columns = min(max(int(self.columns), LEAST_COLUMNS), MOST_COLUMNS)
        self.ticks = max(1, math.ceil(self.window_s * TICK_HZ / self.columns))
        self._next: int | None = None
        self._shot = 0

    @classmethod
    def of(cls, wanted: dict[str, Any]) -> View:
        """As a tab asks for it. Raises BadInput."""
        try:
            return cls(
                float(wanted.get("window_s", cls.window_s)),
                int(wanted.get("columns", cls.columns)),
                str(wanted.get("spectrum", "")),
                str(wanted.get("loop", "")),
            )
        except (TypeError, ValueError, OverflowError):
            raise BadInput("a view is a window in seconds and a number of columns") from None

    def next(self, samples: Samples, trigger: Trigger) -> bytes | None:
        """The columns that have become whole since the last call, or a whole new shot of the trigger."""
        if trigger.run != "off":
            self._next = None
            return self._triggered(samples, trigger)
        self._shot = 0
        with samples.lock:
            end = samples.end // self.ticks * self.ticks
            first = max(end - self.columns * self.ticks, samples.begin // self.ticks * self.ticks)
            anew = self._next is None or self._next > end or self._next < first
            start = first if anew or self._next is None else self._next
            if start >= end and not anew:
                return None
            self._next = end
            return self._columns(samples, start, (end - start) // self.ticks, self.ticks, anew, math.nan)

    def _triggered(self, samples: Samples, trigger: Trigger) -> bytes | None:
        shot = trigger.shot
        if shot is None or shot.number == self._shot:
            return None
        self._shot = shot.number
        ticks = max(1, math.ceil(shot.ticks / self.columns))
        return self._columns(samples, shot.first_tick, shot.ticks // ticks, ticks, True, shot.trigger_tick)

    def _columns(self, samples: Samples, first: int, columns: int, ticks: int, anew: bool, trigger: float) -> bytes:
        low, high = samples.envelope(first, columns, ticks)
        flags = samples.dropped_in(first, columns, ticks)
        head = _head(COLUMNS, samples, anew, columns, ticks, first, trigger)
        return head + low.tobytes() + (high.tobytes() if ticks > 1 else b"") + flags.tobytes()

    def spectrum_frame(self, samples: Samples) -> bytes | None:
        """Frequencies and amplitudes of the last 1.6 s, shape (1 + axes, columns)."""
        if not self.spectrum:
            return None
        rows = samples.rows(samples.end - SPECTRUM_TICKS, SPECTRUM_TICKS)[:, TRACES.index(self.spectrum)]
        f_Hz, amplitude = spectrum(rows)
        head = _head(SPECTRUM, samples, True, len(f_Hz), 1, samples.end, math.nan)
        return head + f_Hz.tobytes() + amplitude.tobytes()

    def loop_frame(self, samples: Samples) -> bytes | None:
        """Across and up of every tick of the window, at most 1 s; shape (axes, 2, ticks)."""
        if not self.loop:
            return None
        ticks = min(round(self.window_s * TICK_HZ), LOOP_TICKS)
        rows = samples.rows(samples.end - ticks, ticks)
        if self.loop == "y/x":
            place = TRACES.index("x_um")
            pairs = rows[None, :2, place] if len(rows) > 1 else rows[:1, [place, place]]
        else:
            pairs = rows[:, [TRACES.index(name) for name in LOOPS[self.loop]]]
        head = _head(LOOP, samples, True, ticks, 1, samples.end - ticks, math.nan, len(pairs))
        return head + np.ascontiguousarray(pairs, np.float32).tobytes()


def _head(
    kind: int, samples: Samples, anew: bool, columns: int, ticks: int, first: int, trigger: float, axes: int = 0
) -> bytes:
    return HEAD.pack(
        kind,
        anew,
        axes or len(samples.axes),
        len(TRACES),
        columns,
        ticks,
        samples.dropped % 2**32,
        first,
        trigger,
        samples.end,
    )


def spectrum(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Amplitudes (0 to peak, Hann window, mean removed) of rows (axes, n), at most 400 columns with equal ratios
    between them, each its largest line: f_Hz (m,), amplitude (axes, m); NaN for an axis that lacks ticks."""
    n = rows.shape[-1]
    window = np.hanning(n)
    centred = rows - rows.mean(axis=-1, keepdims=True)
    lines = np.abs(np.fft.rfft(centred * window))[:, 1:] * (2 / window.sum())
    f_Hz = np.fft.rfftfreq(n, 1 / TICK_HZ)[1:]
    edges = np.unique(np.searchsorted(f_Hz, np.geomspace(f_Hz[0], f_Hz[-1], SPECTRUM_COLUMNS)))
    largest = np.maximum.reduceat(lines, edges, axis=-1)
    return f_Hz[edges].astype(np.float32), largest.astype(np.float32)
