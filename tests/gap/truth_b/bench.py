"""A bench: the parts of one stage in their order, driven record by record; all history is carried on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from scipy import signal

from phaselead.record.axis_record import AxisRecord
from phaselead.record.recording import Recording

from .ceramic import Electrostriction, Kohlrausch
from .electronics import Amplifier
from .memory import draw_loop
from .parts import Modes, Part, Samples
from .readout import Jitter, Room
from .stage import Traits

STATIONS = ("converter", "amplifier", "ceramic", "slow", "mechanics", "sensor", "grid")
"""Volts up to the amplifier, shares of the travel up to the mechanics, then um. Parts of the ceramic add up; the others
follow each other."""


class Attachable(Protocol):
    """Something that can be mounted on a bench."""

    def attach(self, bench: Bench) -> None: ...


class Bench:
    """One stage through one long session. The same seed gives the same noise whatever is mounted."""

    def __init__(self, traits: Traits, seed: list[int]) -> None:
        self.traits, self.seed = traits, seed
        self.time_s, self.records = 0.0, 0
        self.voltage_V = 0.0
        self.left_s = 0.0
        """Seconds of the session still to come, for what is measured over it."""
        self.dead_time_s = traits.dead_time_s
        self.jitter: Jitter | None = None
        self.room: list[Room] = []
        self.parts: dict[str, list[Part]] = {station: [] for station in STATIONS}
        s = self.drive(0.0)
        rng = np.random.default_rng([*seed, 0])
        self.amplifier = Amplifier(traits.amplifier_tau_s, traits.dt_s, 0.0)
        loop = draw_loop(rng, traits.loop, s)
        self.slope = 0.5 * (1 + traits.loop)
        self.zero = float(self.slope * s + loop.run(np.array([s]))[0])
        """Position at 0 V before anything has moved, from the middle, in shares of the travel."""
        for part in (self.amplifier, loop, *([Electrostriction(traits.bend, 0.1, s)] if traits.bend else [])):
            part.attach(self)
        if traits.creep:
            Kohlrausch(traits.creep, 20.0, 0.35, traits.dt_s, self.zero).attach(self)
        self.modes = Modes(traits.modes, traits.dt_s, self.zero)
        self.modes.attach(self)
        self.level = self.zero
        """Where the ceramic has brought the mechanics, in shares of the travel."""

    def drive(self, volts: float) -> float:
        """In -1..1 over the voltages of the lab."""
        return (volts - self.traits.middle_V) / (0.5 * self.traits.swing_V)

    def mount(self, found: Iterable[Attachable]) -> None:
        """Switch something on, from now."""
        for part in found:
            part.attach(self)

    def pause(self, seconds: float) -> None:
        """Nothing moves for a while; what is slow goes on, ever slower."""
        for part_s in np.diff(np.concatenate([[0.0], np.geomspace(0.01 * seconds, seconds, 12)])):
            self._stand_still(float(part_s))

    def _stand_still(self, seconds: float) -> None:
        level = self.voltage_V
        for part in [*self.parts["converter"], *self.parts["amplifier"]]:
            level = part.pause(level, seconds)
        s = self.drive(level)
        level = self.slope * s + sum(part.pause(s, seconds) for part in self.parts["ceramic"])
        for part in self.parts["slow"]:
            level = part.pause(level, seconds)
        self.level = level
        for part in self.parts["mechanics"]:
            level = part.pause(level, seconds)
        level = self.um(level)
        for part in self.parts["sensor"]:
            level = part.pause(level, seconds)
        self.time_s += seconds

    def warm_up(self) -> None:
        """The morning before the session: the stage is run in over random corners and the full range, then parked."""
        traits, rng = self.traits, np.random.default_rng([*self.seed, 2])
        park = self.drive(traits.park_V)
        corners = [self.drive(0.0), *rng.uniform(-1, 1, 4), 1.0, -1.0, 1.0, -1.0, park]
        path = np.interp(np.arange(1, 2001) / 2000, np.linspace(0, 1, len(corners)), corners)
        self.motion(traits.on_codes(traits.volts(path)))
        self.time_s += len(path) / traits.rate_Hz
        self.pause(float(rng.uniform(60, 300)))

    def record(self, name: str, volts: Samples) -> Recording:
        """Drive it with ``volts`` (n,) at the rate of the lab, and measure."""
        traits = self.traits
        asked = traits.on_codes(volts)
        t_s = self.time_s + np.arange(len(asked)) / traits.rate_Hz
        fine_um = self.motion(asked)
        x_um = self._sampled(fine_um, len(asked))
        x_um = x_um + sum(room.at(t_s) for room in self.room) + self._noise(len(asked))
        for part in self.parts["grid"]:
            x_um = part.run(x_um)
        self.records += 1
        self.time_s = float(t_s[-1]) + 1 / traits.rate_Hz
        digest = hashlib.sha256(t_s.tobytes() + asked.tobytes() + x_um.tobytes()).hexdigest()
        return Recording(t_s, {"x": AxisRecord(asked, x_um)}, source=name, sha256=digest)

    def motion(self, asked: Samples) -> Samples:
        """What the sensor's electronics give (um) on the fine grid, from the first row to the last."""
        sent = asked
        for part in self.parts["converter"]:
            sent = part.run(sent)
        signal_V = self._late(sent, self.voltage_V)
        self.voltage_V = float(asked[-1])
        for part in self.parts["amplifier"]:
            signal_V = part.run(signal_V)
        s = (signal_V - self.traits.middle_V) / (0.5 * self.traits.swing_V)
        x = self.slope * s + sum(part.run(s) for part in self.parts["ceramic"])
        for part in self.parts["slow"]:
            x = part.run(x)
        self.level = float(x[-1])
        for part in self.parts["mechanics"]:
            x = part.run(x)
        x_um = self.um(x)
        for part in self.parts["sensor"]:
            x_um = part.run(x_um)
        return x_um

    def um(self, share: Samples | float) -> Samples:
        """What the sensor of the bare stage reads, of shares of the travel from the middle."""
        return self.traits.zero_um + self.traits.sign * self.traits.travel_um * (share - self.zero)

    def _late(self, sent: Samples, before_V: float) -> Samples:
        """The generator's voltage on the fine grid after the dead time: held between rows, or in straight lines."""
        traits = self.traits
        first = float(sent[0]) if before_V == sent[0] else before_V
        n_fine = (len(sent) - 1) * traits.finer + 1
        at = np.arange(n_fine) * traits.dt_s - self.dead_time_s
        rows_s = np.arange(len(sent)) / traits.rate_Hz
        if not traits.held:
            return np.interp(at, rows_s, sent, left=first)
        area = np.concatenate([[0.0], np.cumsum(sent) / traits.rate_Hz])
        ends_s = np.concatenate([rows_s, [len(sent) / traits.rate_Hz]])

        def up_to(when: Samples) -> Samples:
            return np.where(when < 0, first * when, np.interp(when, ends_s, area))

        return (up_to(at) - up_to(at - traits.dt_s)) / traits.dt_s

    def _sampled(self, fine_um: Samples, n: int) -> Samples:
        if self.jitter is None:
            return fine_um[:: self.traits.finer]
        fine_s = np.arange(len(fine_um)) * self.traits.dt_s
        return np.interp(np.arange(n) / self.traits.rate_Hz + self.jitter.errors_s(n), fine_s, fine_um)

    def _noise(self, n: int) -> Samples:
        """White, and a share of it below a corner; its own seed for each record."""
        rng = np.random.default_rng([*self.seed, 1, self.records])
        white, slow = rng.standard_normal((2, n))
        pole = np.exp(-2 * np.pi * self.traits.corner_Hz / self.traits.rate_Hz)
        coloured = signal.lfilter([np.sqrt(1 - pole**2)], [1, -pole], slow)
        return self.traits.noise_um * (white + self.traits.coloured * coloured)
