"""A stage on its bench: parts in their order, from codes to micrometres, with all history carried on."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from phaselead import Recording
from phaselead.record import AxisRecord

from .amplifier import Converter, Loop
from .ceramic import Creep
from .memory import Memory
from .parts import Modes, Oscillator, Part, Samples
from .readout import Room, noise, quantised
from .session import Piece
from .sliders import LOOP
from .stage import FINE, Traits
from .waves import edge

VOLTS = ("rails", "amplifier", "load", "leak", "dead_band")
MOTION = ("friction", "level", "usual_creep", "creep", "slack", "mode", "modes")
SENSED = ("lag", "short_lag", "sensor", "curve")
KEPT = 24
"""Rows that a delay may look back."""


class Bench:
    """One stage. ``put`` places a part where it belongs, at rest in what it is given there."""

    def __init__(self, traits: Traits) -> None:
        self.traits = traits
        self.fine = FINE[traits.rate_Hz]
        self.dt_s = 1 / (traits.rate_Hz * self.fine)
        self.t_s = 0.0
        self.delay_s = traits.delay_s
        self.gain, self.offset_um, self.step_um, self.jitter_s = 1.0, 0.0, 0.0, 0.0
        self.converter: Converter | None = None
        self.room: list[Room] = []
        self.ahead_s = (0.0, 1.0)
        """Begin and length of the sessions over which a drift has its mean rate."""
        self.last_V = float(traits.volts(np.array([traits.park]))[0])
        self.kept_V = np.full(KEPT, self.last_V)
        self.memory = self._memory()
        self.beside: list[Part] = []
        self.rest_um = float(self.memory.run(np.array([self.last_V]))[0])
        self.parts: dict[str, Part] = {}
        self.given = {**dict.fromkeys(VOLTS, self.last_V), **dict.fromkeys(MOTION, self.rest_um)}
        self.given |= dict.fromkeys(SENSED, 0.0)
        self.put("amplifier", lambda u: Loop(traits.amplifier_s, self.dt_s, u))
        if traits.creep:
            gamma, first_s, last_s = traits.creep
            self.put("usual_creep", lambda x: Creep(gamma, first_s, last_s, self.fine, self.dt_s, self.rest_um, x))
        self.put("modes", lambda x: Modes(traits.modes, self.dt_s, x))
        if traits.sensor_Hz:
            f_Hz = traits.sensor_Hz
            self.put("sensor", lambda y: Oscillator(f_Hz, 0.75, self.dt_s, y))

    def _memory(self) -> Memory:
        t = self.traits
        start_V = float(t.volts(np.array([t.park]))[0])
        return Memory(t.recipe, t.width, t.low_V, t.high_V, t.travel_um, start_V)

    def put(self, place: str, make: Callable[[float], Part]) -> None:
        """``make`` is given the present input of that place."""
        self.parts[place] = make(self.given[place])

    @property
    def here(self) -> float:
        """The last voltage, -1..1 over the working range."""
        return (self.last_V - self.traits.mid_V) / self.traits.half_V

    def range_um(self) -> tuple[float, float]:
        """Ends of the bare slow loop as the sensor has them, its zero at the virgin stage at rest."""
        bare, t = self._memory(), self.traits
        way = np.concatenate([np.linspace(t.park, -1, 400), LOOP, LOOP])
        x = t.sign * (bare.run(t.mid_V + t.half_V * way)[400:] - self.rest_um)
        return float(x.min()), float(x.max())

    def record(self, piece: Piece) -> Recording:
        """After its pause and all that runs before it; times go on."""
        traits, rate_Hz = self.traits, self.traits.rate_Hz
        waits = traits.park if piece.parked else self.here
        home = np.concatenate([_way(self.here, waits, 0.25, rate_Hz), np.full(int(0.1 * rate_Hz), waits)])
        self._drive(home)
        self.t_s += len(home) / rate_Hz
        self.pause(piece.pause_s)
        before = piece.before
        if len(before):
            before = np.concatenate([_way(waits, float(before[0]), 0.2, rate_Hz), before])
        stands = float(before[-1]) if len(before) else waits
        to, first = _way(stands, float(piece.s[0]), 0.25, rate_Hz), np.full(int(0.3 * rate_Hz), piece.s[0])
        rows = np.concatenate([before, to, first, piece.s])
        begin = len(rows) - len(piece.s)
        t_s = (math.ceil(self.t_s * rate_Hz) + np.arange(begin, len(rows))) / rate_Hz
        y = self._read(self._drive(rows), begin, t_s, piece.seed)
        self.t_s = float(t_s[-1]) + 1 / rate_Hz
        return Recording(t_s, {"x": AxisRecord(traits.volts(piece.s), y)}, source=piece.kind)

    def pause(self, seconds: float) -> None:
        """The last voltage stands."""
        if seconds == 0:
            return
        self.t_s += seconds
        x = float(self._asked(np.array([self.last_V]))[0])
        for places in (VOLTS, MOTION, SENSED):
            if places is MOTION:
                v = np.array([x])
                x = float((self.memory.run(v) + sum(part.run(v) for part in self.beside))[0])
            elif places is SENSED:
                x = self._sensed_from(x)
            for place in places:
                self.given[place] = x
                if place in self.parts:
                    x = self.parts[place].rest(seconds, x)

    def _asked(self, u: Samples) -> Samples:
        """What the converter gives, where the lab calls the parked place right."""
        if self.converter is None:
            return u
        rest = self.traits.volts(np.array([self.traits.park]))
        return self.converter.volts(u) - (self.converter.volts(rest) - rest)

    def _sensed_from(self, x: float) -> float:
        return self.traits.sign * self.gain * (x - self.rest_um)

    def _drive(self, s: Samples) -> Samples:
        """(n fine,) what the sensor has of rows s (n,), without zero, noise and room."""
        u = self.traits.volts(s)
        wide = np.concatenate([self.kept_V, u])
        self.kept_V, self.last_V = wide[-KEPT:].copy(), float(u[-1])
        x = self._between(self._asked(wide), len(u))
        for place in VOLTS:
            x = self._through(place, x)
        moved = self.memory.run(x)
        for part in self.beside:
            moved = moved + part.run(x)
        for place in MOTION:
            moved = self._through(place, moved)
        x = self.traits.sign * self.gain * (moved - self.rest_um)
        for place in SENSED:
            x = self._through(place, x)
        return x

    def _through(self, place: str, x: Samples) -> Samples:
        self.given[place] = float(x[-1])
        return self.parts[place].run(x) if place in self.parts else x

    def _between(self, wide: Samples, n: int) -> Samples:
        """Late volts at the fine points: the mean since the last one where the converter holds, else on the line."""
        at = np.arange(n * self.fine + 1) / self.fine + KEPT - self.delay_s * self.traits.rate_Hz
        if not self.traits.held:
            return np.asarray(np.interp(at[1:], np.arange(len(wide)), wide))
        total = np.concatenate([[0.0], np.cumsum(wide - wide[0])])
        return np.asarray(np.diff(np.interp(at, np.arange(len(total)), total)) * self.fine + wide[0])

    def _read(self, x: Samples, begin: int, t_s: Samples, seed: int) -> Samples:
        """Rows are read as their voltage sets in."""
        traits, n = self.traits, len(t_s)
        at = np.arange(begin, begin + n) * self.fine - 1
        y = x[at]
        if self.jitter_s:
            early = np.clip(np.random.default_rng([seed, 2]).standard_normal(n), -4, 4) * self.jitter_s
            y = np.interp(at + early / self.dt_s, np.arange(len(x)), x)
        for i, source in enumerate(self.room):
            y = y + source.um(t_s, seed + 17 + i)
        y = y + traits.noise_um * noise(np.random.default_rng([seed, 1]), n, traits.rate_Hz, traits.pink)
        y = traits.zero_um + y + self.offset_um
        return quantised(y, self.step_um) if self.step_um else y


def _way(here: float, there: float, seconds: float, rate_Hz: float) -> Samples:
    return here + (there - here) * edge(int(seconds * rate_Hz))
