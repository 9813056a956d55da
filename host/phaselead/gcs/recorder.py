"""The data recorder: tables of what every tick was, begun by a trigger. DRC, DRT, RTR, DRL?, DRR?."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phaselead.device import TICK_HZ
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import whole
from phaselead.scope import TRACES, Samples

TABLES = 8
MOST_POINTS = 32768
"""Of each table."""
NOTHING, ON_WAVES, ON_MOVES, NEXT_COMMAND, AT_ONCE, NEXT_MOVE = 0, 0, 1, 2, 4, 6
OPTIONS = {
    0: ("nothing is recorded", ""),
    1: ("target position of axis", "r_um"),
    2: ("current position of axis", "x_um"),
    3: ("position error of axis", "e_um"),
    7: ("control voltage of axis", "u_V"),
}
"""Of DRC, by PI's numbers: words, and the trace of the stream."""
TRIGGERS = {
    0: "default: WGO",
    1: "every command that changes a target",
    2: "the next command, once",
    4: "at once",
    6: "the next command that changes a target, once",
}
"""Of DRT, by PI's numbers. A WGO begins a recording whatever is set."""
Rows = NDArray[np.float32]


@dataclass
class Recorder:
    """Eight tables that record together, one point each ``rate`` ticks, until they are full. A tick that did not come
    is NaN."""

    samples: Samples
    tables: dict[int, tuple[str, int]] = field(init=False)
    """Source and option."""
    trigger: int = ON_WAVES
    rate: int = 1
    _first_tick: int | None = None
    _rate: int = 1
    """Of the recording there is."""
    _taken: Rows = field(init=False)

    def __post_init__(self) -> None:
        axes = self.samples.axes
        self.tables = {at: (axes[at - 1], 2) if at <= len(axes) else (axes[0], NOTHING) for at in range(1, TABLES + 1)}
        self._taken = self._nothing()

    def _nothing(self) -> Rows:
        return np.empty((len(self.samples.axes), len(TRACES), 0), np.float32)

    def table(self, word: str) -> int:
        """The number of a table. Raises GcsError."""
        value = whole(word)
        if not 1 <= value <= TABLES:
            raise GcsError(Code.INVALID_RECORDER_CHAN, f"record table {value}; there are 1 to {TABLES}")
        return value

    def configure(self, table: int, source: str, option: int) -> None:
        """What a table is to record. Raises GcsError."""
        if option not in OPTIONS:
            raise GcsError(Code.INVALID_RECORDER_SRC_OPT, f"record option {option}; HDR? lists them")
        if source.lower() not in tuple(self.samples.axes):
            raise GcsError(Code.INVALID_RECORDER_SRC_CHAN, f"record source {source[:20]!r}")
        self.tables[table] = (source.lower(), option)

    def set_trigger(self, source: int) -> None:
        """Raises GcsError."""
        if source not in TRIGGERS:
            raise GcsError(Code.PARAM_OUT_OF_RANGE, f"trigger source {source}; HDR? lists them")
        self.trigger = source
        if source == AT_ONCE:
            self.begin()

    def commanded(self, tick: int, *, moves: bool) -> None:
        """A command came at this tick, after DRT; ``moves``: it has changed a target."""
        if self.trigger == NEXT_COMMAND or (moves and self.trigger in (ON_MOVES, NEXT_MOVE)):
            self.begin(tick)
            self.trigger = self.trigger if self.trigger == ON_MOVES else ON_WAVES

    def begin(self, tick: int | None = None) -> None:
        """From this tick on, by default the next that comes."""
        self._first_tick = self.samples.end if tick is None else tick
        self._rate, self._taken = self.rate, self._nothing()

    def collect(self) -> None:
        """Takes what has come since the last call."""
        if self._first_tick is None or self.count >= MOST_POINTS:
            return
        at = self._first_tick + self.count * self._rate
        came = min(-(-(self.samples.end - at) // self._rate), MOST_POINTS - self.count)
        if came > 0:
            rows = self.samples.rows(at, (came - 1) * self._rate + 1)[..., :: self._rate]
            self._taken = np.concatenate([self._taken, rows], axis=-1)

    @property
    def count(self) -> int:
        """Points of each table so far."""
        return int(self._taken.shape[-1])

    @property
    def sample_s(self) -> float:
        return self._rate / TICK_HZ

    def recorded(self, table: int) -> int:
        """Points of a table: none where it records nothing."""
        return self.count if self.tables[table][1] != NOTHING else 0

    def columns(self, tables: list[int], first: int, count: int) -> dict[str, list[float]]:
        """Points ``first`` (from 1) on of these tables, by their names. Raises GcsError where there are not so many."""
        if first < 1 or count < 1:
            raise GcsError(Code.PARAM_OUT_OF_RANGE)
        found = {}
        for table in tables:
            axis, option = self.tables[table]
            words, trace = OPTIONS[option]
            if first + count - 1 > self.recorded(table):
                raise GcsError(Code.NOT_ENOUGH_RECORDED_DATA, f"table {table} has {self.recorded(table)} points")
            row = self._taken[self.samples.axes.index(axis), TRACES.index(trace)]
            found[f"{words} {axis}, table {table}"] = row[first - 1 : first - 1 + count].tolist()
        return found
