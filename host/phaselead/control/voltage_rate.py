"""How fast the voltage must change for the inverse to follow a path, from the model alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from phaselead.model import TICK_S, AxisModel, Compensation, compensation, small_signal
from phaselead.record import Samples
from phaselead.waveforms import Repeated, RepeatedAsSensed, Rounded, Streamed, Waveform, mean_twice

FINE = 8192
"""Points of a period in which the voltage is worked out: half of the tick rate from 0.6 Hz on."""
BLOCK, WARM_UP = 4096, 1024
"""Ticks of a path of rows that are worked out together, and before them, after which sections have forgotten."""


KEPT = 3
"""Paths whose rates are kept, one an axis: a run asks for them again and again, and a path may be large."""

Spans = Sequence[tuple[float, float]]
"""Parts of a path: begin and end of each, s from its start."""


class VoltageRate(ABC):
    """Rates from tick to tick, V/s, at the gain between that of a turn and that of a long way."""

    def __init__(self, model: AxisModel) -> None:
        """Raises BadInput without an inverse."""
        self._found: Compensation = compensation(model)
        self._per_s = 2 / sum(small_signal(model).gain_um_per_V) / TICK_S
        self._rates: dict[tuple[int, float], tuple[float, float]] = {}

    @property
    @abstractmethod
    def blocks(self) -> Sequence[int]:
        """Numbers of those that the path is worked out in."""

    def within(self, block: int, rounding_s: float) -> tuple[float, float]:
        """The largest rate within a block, and where it is, s from the start of the path, whose corners are rounded by
        two means over so long."""
        key = block, rounding_s
        if key not in self._rates:
            self._rates[key] = self._worked_out(block, rounding_s)
        return self._rates[key]

    @abstractmethod
    def _worked_out(self, block: int, rounding_s: float) -> tuple[float, float]:
        """What ``within`` gives."""

    @cached_property
    def sharp(self) -> dict[int, float]:
        """That of each block as it was written, the fastest first."""
        found = {block: self.within(block, 0.0)[0] for block in self.blocks}
        return dict(sorted(found.items(), key=lambda one: one[1], reverse=True))

    def above(self, limit_V_per_s: float) -> list[int]:
        """Blocks that go beyond a limit as they were written, the fastest first."""
        return [block for block, rate in self.sharp.items() if rate > limit_V_per_s]

    def beyond(self, limit_V_per_s: float, rounding_s: float) -> tuple[float, float] | None:
        """The largest rate of the rounded path and where it is, if that is beyond the limit."""
        found = max((self.within(block, rounding_s) for block in self.above(limit_V_per_s)), default=None)
        return found if found is not None and found[0] > limit_V_per_s else None


_kept: deque[tuple[AxisModel, Waveform, VoltageRate]] = deque(maxlen=KEPT)


def voltage_rate(model: AxisModel, path: Waveform, spans_s: Spans | None = None) -> VoltageRate:
    """Of a path in micrometres, of one of rows within ``spans_s`` alone. Raises BadInput without an inverse.

    Those of whole paths are kept for the next who asks, neither model nor path ever changes.
    """
    if spans_s is not None and isinstance(path, Streamed):
        return OfRows(model, path, spans_s)
    for of_model, of_path, kept in tuple(_kept):
        if of_model is model and of_path is path:
            return kept
    found = OfRows(model, path) if isinstance(path, Streamed) else OfPeriod(model, path)
    _kept.append((model, path, found))
    return found


class OfPeriod(VoltageRate):
    """Of a path that repeats: one block, worked out by its frequencies."""

    blocks = (0,)

    def __init__(self, model: AxisModel, path: Waveform) -> None:
        super().__init__(model)
        self._f_Hz = f_Hz = path.f_Hz * np.arange(FINE // 2 + 1, dtype=np.float64)
        values = np.fft.rfft(path.value(np.arange(FINE) / FINE / path.f_Hz))
        per_tick = (1 - np.exp(-2j * np.pi * f_Hz * TICK_S)) * (f_Hz < 0.5 / TICK_S)
        undone = self._found.shape_response(f_Hz) * self._found.drive.response(f_Hz)
        self._lines = values * per_tick * undone * self._per_s

    def _worked_out(self, block: int, rounding_s: float) -> tuple[float, float]:
        return self._with(lambda f_Hz: mean_twice(f_Hz, rounding_s))

    def up_to(self, highest_Hz: float) -> float:
        """Of what lies at a frequency and below."""
        return self._with(lambda f_Hz: np.where(f_Hz <= highest_Hz, 1.0, 0.0))[0]

    def _with(self, share: Callable[[Samples], Samples]) -> tuple[float, float]:
        rates = np.abs(np.fft.irfft(self._lines * share(self._f_Hz), FINE))
        return float(rates.max()), float(np.argmax(rates) / FINE / self._f_Hz[1])


class OfRows(VoltageRate):
    """Of a path of rows, of any length: tick by tick."""

    def __init__(self, model: AxisModel, path: Streamed, spans_s: Spans | None = None) -> None:
        super().__init__(model)
        self._path, self._spans_s = path, spans_s
        self._sections = (*self._found.shape, self._found.drive)

    @cached_property
    def blocks(self) -> Sequence[int]:
        every = range(_block_at(self._path.duration_s) + 1)
        if self._spans_s is None:
            return every
        spans = (range(_block_at(begin_s), _block_at(end_s) + 1) for begin_s, end_s in self._spans_s)
        return [block for block in sorted(set().union(*spans)) if block in every]

    def _worked_out(self, block: int, rounding_s: float) -> tuple[float, float]:
        from scipy.signal import lfilter  # slow to load, and needed here only

        first = block * BLOCK
        asked_um = self._path.swing * self._played(rounding_s).points_of(first - WARM_UP, WARM_UP + BLOCK + 1, 0)
        asked_um -= asked_um[0]
        for section in self._sections:
            asked_um = lfilter(section.b, (1.0, *section.a), asked_um)
        rates = np.abs(np.diff(asked_um[WARM_UP:])) * self._per_s
        return float(rates.max()), (first + int(np.argmax(rates))) * TICK_S

    def _played(self, rounding_s: float) -> Streamed:
        if rounding_s == 0:
            return self._path
        if isinstance(self._path, Repeated):
            return RepeatedAsSensed.of(self._path, 0.0, rounding_s)
        return Rounded.of(self._path, rounding_s)


def _block_at(at_s: float) -> int:
    return int(at_s / TICK_S) // BLOCK
