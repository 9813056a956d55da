"""A stretch that is kept when something happens: trigger, pre-trigger, one shot or one after another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.scope.samples import TRACES, Samples

EDGES = ("rising", "falling")
RUNS = ("off", "normal", "single")
LONGEST_S = 20.0


@dataclass(frozen=True)
class Shot:
    """A stretch around the tick at which the trigger fired."""

    number: int
    trigger_tick: int
    first_tick: int
    ticks: int


@dataclass
class Trigger:
    """Fires where a trace of an axis passes ``level``; the stretch of ``window_s`` around it is then kept, ``before``
    of it earlier."""

    run: str = "off"
    axis: str = "x"
    trace: str = "x_um"
    level: float = 0.0
    edge: str = "rising"
    before: float = 0.25
    window_s: float = 0.5
    shot: Shot | None = None

    def __post_init__(self) -> None:
        if self.run not in RUNS or self.edge not in EDGES or self.trace not in TRACES:
            raise BadInput(f"a trigger is {', '.join(RUNS)}, {' or '.join(EDGES)}, on {', '.join(TRACES)}")
        if not 0 <= self.before <= 1:
            raise BadInput(f"a pre-trigger of {self.before:g}: a share of the window, from 0 to 1")
        if not 1 / TICK_HZ <= self.window_s <= LONGEST_S:
            raise BadInput(f"a window of {self.window_s:g} s: from one tick to {LONGEST_S:g} s")
        self._armed = self.run != "off"
        self._fired: int | None = None
        self._looked: int | None = None
        self._shots = 0

    @property
    def waiting(self) -> bool:
        """Whether it has not fired yet, or its stretch is not over."""
        return self._armed or self._fired is not None

    def look(self, samples: Samples) -> None:
        """At what has come since the last look."""
        ticks = round(self.window_s * TICK_HZ)
        before = round(self.before * ticks)
        if self._looked is None or self._looked > samples.end:
            self._looked = samples.end
        if self._armed and self._fired is None:
            self._fired = self._passed(samples, max(self._looked - 1, samples.begin))
        self._looked = samples.end
        if self._fired is not None and samples.end >= self._fired + ticks - before:
            self._shots += 1
            self.shot = Shot(self._shots, self._fired, self._fired - before, ticks)
            self._fired = None
            self._armed = self.run == "normal"

    def _passed(self, samples: Samples, first: int) -> int | None:
        row = samples.axes.index(self.axis), TRACES.index(self.trace)
        values = samples.rows(first, samples.end - first)[row]
        above = values >= self.level if self.edge == "rising" else values <= self.level
        below = values < self.level if self.edge == "rising" else values > self.level
        found = np.flatnonzero(below[:-1] & above[1:])
        return first + int(found[0]) + 1 if len(found) else None
