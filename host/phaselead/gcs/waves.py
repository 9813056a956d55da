"""Wave tables and wave generators: WAV, WSL, WGC, WOS, WTR, WGO."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from phaselead.device import TICK_HZ
from phaselead.gcs.axes import Axes
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import whole
from phaselead.gcs.wave_shapes import MOST_POINTS, Points, segment
from phaselead.waveforms import Waveform, of_points

TABLES = 8


@dataclass
class Generator:
    """What one of them plays: a table, how often, how fast, and by how much higher."""

    table: int = 0
    """0: none."""
    cycles: int = 0
    """0: until it is stopped."""
    offset_um: float = 0.0
    ticks_per_point: int = 1
    interpolation: int = 1


@dataclass
class Waves:
    """All of one controller. Generator 1 is that of the first axis."""

    axes: Axes
    tables: dict[int, Points] = field(default_factory=dict)
    generators: dict[int, Generator] = field(init=False)

    def __post_init__(self) -> None:
        self.generators = {at: Generator() for at in range(1, len(self.axes.letters) + 1)}

    def table(self, word: str) -> int:
        """The number of a table. Raises GcsError."""
        value = whole(word)
        if not 1 <= value <= TABLES:
            raise GcsError(Code.WAV_INDEX_ERROR, f"wave table {value}; there are 1 to {TABLES}")
        return value

    def generator(self, word: str) -> int:
        """The number of a generator. Raises GcsError."""
        value = whole(word)
        if value not in self.generators:
            raise GcsError(Code.WAV_INDEX_ERROR, f"wave generator {value}; there are 1 to {len(self.generators)}")
        return value

    def axis(self, generator: int) -> str:
        return self.axes.letters[generator - 1]

    def points(self, table: int) -> Points:
        """Of a table, shape (n,). Raises GcsError where it is empty."""
        if table not in self.tables:
            raise GcsError(Code.WAV_NOT_DEFINED, f"wave table {table} is empty")
        return self.tables[table]

    def define(self, words: Sequence[str]) -> None:
        """WAV TABLE X|&|+ KIND ...: a new table, more of it, or added to it. Raises GcsError."""
        if len(words) < 3:
            raise GcsError(Code.MISSING_PARAM)
        table, how = self.table(words[0]), words[1].upper()
        first, values = segment(words[2].upper(), words[3:])
        before = self.tables.get(table, np.empty(0))
        if how == "&":
            made = np.concatenate([before, values])
        elif how == "+":
            made = np.pad(before, (0, max(first + len(values) - len(before), 0)))
            made[first : first + len(values)] += values
        elif how == "X" and first == 0:
            made = values
        else:
            raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, "X begins a table at point 1, & goes on, + adds")
        if len(made) > MOST_POINTS:
            raise GcsError(Code.WAVE_TOO_LARGE, f"{len(made)} points; at most {MOST_POINTS}")
        self._refuse_in_use(table)
        self.tables[table] = made

    def clear(self, tables: Sequence[int]) -> None:
        for table in tables:
            self._refuse_in_use(table)
        for table in tables:
            self.tables.pop(table, None)

    def _refuse_in_use(self, table: int) -> None:
        if any(self.running(at) and one.table == table for at, one in self.generators.items()):
            raise GcsError(Code.WAVE_GENERATOR_ACTIVE, f"wave table {table} is being played")

    def running(self, generator: int) -> bool:
        """Whether its axis has not been seen to end."""
        return self.axis(generator) in self.axes.waving

    def go(self, modes: Mapping[int, int]) -> None:
        """Starts (1) and stops (0) generators. Those that start do so in the same tick. Raises GcsError."""
        for generator, mode in modes.items():
            if mode not in (0, 1):
                raise GcsError(Code.WGO_BIT_NOT_SUPPORTED, f"generator {generator}: 1 starts, 0 stops")
        self.axes.where()
        starting = [at for at, mode in modes.items() if mode and not self.running(at)]
        if any(not mode and self.running(at) for at, mode in modes.items()):
            left = [at for at in self.generators if self.running(at) and modes.get(at) != 0]
            if left:
                raise GcsError(Code.WAVE_GENERATOR_ACTIVE, f"generator {left[0]} would be stopped too: stop it as well")
            self.axes.stop()
        if starting:
            lengths_s = {self._length_s(at) for at in starting}
            if len({None if s is None else round(s * TICK_HZ) for s in lengths_s}) > 1:
                raise GcsError(
                    Code.DIFFERENT_ARRAY_LENGTH,
                    "generators that start together must take the same time (points, WTR, WGC)",
                )
            self.axes.begin({self.axis(at): self._wave(at) for at in starting}, lengths_s.pop())

    def _period_s(self, at: int) -> float:
        return len(self.points(self._selected(at))) * self.generators[at].ticks_per_point / TICK_HZ

    def _length_s(self, at: int) -> float | None:
        cycles = self.generators[at].cycles
        return cycles * self._period_s(at) if cycles else None

    def _selected(self, at: int) -> int:
        if not self.generators[at].table:
            raise GcsError(Code.NO_WAVE_SELECTED, f"generator {at}: WSL {at} TABLE")
        return self.generators[at].table

    def _wave(self, at: int) -> Waveform:
        values = self.points(self._selected(at)) + self.generators[at].offset_um
        if len(values) < 2 or not np.ptp(values):
            raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, "a wave of one value moves nothing; use MOV")
        return of_points(values, "um", 1 / self._period_s(at))
