"""The cases of generator B, by seeds that follow from a case's own name: set/kind/effects/number."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phaselead.record.recording import Recording

from .bench import Attachable, Bench
from .effects import EFFECTS, IN_UM
from .parts import Samples
from .programme import session
from .stage import TRAVEL_UM, Traits, draw
from .strangers import STRANGERS, Stranger, Switch, prepared

SETS = {"tuning": "b-tuning-1", "sealed": "b-sealed-1"}
"""Salt of each set of seeds."""
COUNTS = {"none": 100, "single": 150, "pair": 30, "triple": 20, "removed": 20, "outside": 12}
"""Cases at scale 1."""
KINDS = tuple(COUNTS)
SIZES = (0.03, 3.0)
"""Sizes are drawn evenly in their logarithm between these multiples of the typical one."""
REMOVED_SIZES = (0.5, 3.0)
"""What is left out of the catalogue must be large enough to be missed."""
FAST = {"delay", "amplifier_lowpass", "sensor_lowpass", "resonance", "load_change", "slew_limit", "sampling_jitter"}
SLOW = {"creep", "charge_leakage", "thermal_drift", "softening"}
NOT_TOGETHER = (
    {"amplifier_lowpass", "sensor_lowpass", "delay"},
    {"offset", "thermal_drift"},
    {"resonance", "load_change"},
)
"""At most one of each in a pair or triple: nobody could tell them apart from these records."""
SECONDS = {1000.0: 75.0, 5000.0: 16.0, 20000.0: 4.5}
SLOW_SECONDS = {1000.0: 100.0, 5000.0: 24.0, 20000.0: 4.5}
UM_TRAVEL = (10.0, 200.0)
"""Travel of the stages in which something of a size in um is hidden."""
CONVERTER_BITS = 12
"""Of a converter whose errors can be seen; the others have 16 or 18."""


@dataclass(frozen=True)
class Hidden:
    """One hidden effect: its size as a multiple of the typical, and, signed, as the catalogue would measure it."""

    name: str
    size: float
    value: float
    unit: str
    axis: str | None = None


@dataclass(frozen=True)
class Case:
    """One blind trial."""

    set_name: str
    kind: str
    effects: tuple[str, ...]
    number: int
    shorter: float = 1.0
    """Divides the length of all records, for quick tests."""

    @property
    def name(self) -> str:
        return f"{self.set_name}/{self.kind}/{'+'.join(self.effects) or 'nothing'}/{self.number}"

    @property
    def seed(self) -> int:
        return _hashed(SETS[self.set_name], *self.name.split("/")[1:])

    def _rng(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, purpose])

    @property
    def without(self) -> tuple[str, ...]:
        """Effects to leave out of the catalogue."""
        return self.effects if self.kind == "removed" else ()

    @property
    def allowed(self) -> tuple[str, ...]:
        """Names that are right though the system is outside the catalogue."""
        return STRANGERS[self.effects[0]].allowed if self.kind == "outside" else ()

    @cached_property
    def traits(self) -> Traits:
        """The stage."""
        rng = self._rng(1)
        rates, chances = _rates(self.effects if self.kind != "outside" else ("resonance",))
        rate_Hz = float(rng.choice(rates, p=chances))
        bits = CONVERTER_BITS if "dac_nonlinearity" in self.effects else int(rng.choice([16, 18]))
        found = draw(rng, rate_Hz, bits, UM_TRAVEL if IN_UM & set(self.effects) else TRAVEL_UM)
        if "hysteresis" in self.effects:
            found = replace(found, loop=0.004)
        if self.kind == "outside":
            found = prepared(found)
        return found

    @property
    def bits(self) -> int:
        """Of the output converter, as the lab knows it."""
        return self.traits.bits

    @property
    def output_V(self) -> tuple[float, float]:
        """Voltage of the converter's lowest code, and one past the highest."""
        return self.traits.output_V

    @cached_property
    def hidden(self) -> tuple[Hidden, ...]:
        """The truth; nothing for a system outside the catalogue."""
        if self.kind == "outside":
            return ()
        rng, found = self._rng(2), []
        for name in self.effects:
            effect = EFFECTS[name]
            low, high = REMOVED_SIZES if self.kind == "removed" else SIZES
            size = float(np.exp(rng.uniform(np.log(low), np.log(min(high, effect.largest)))))
            sign = -1 if effect.signed and rng.random() < 0.5 else 1
            found.append(Hidden(name, size, sign * size * effect.typical, effect.unit))
        return tuple(found)

    def records(self, *, hidden: bool = True) -> tuple[list[Recording], list[Recording], list[Recording]]:
        """(reference, train, holdout): the first without what is hidden; with ``hidden`` False all of them are."""
        return self._recorded(hidden)[1]

    def bare_holdout(self) -> list[Recording]:
        """The held-out records with nothing hidden."""
        return self.records(hidden=False)[2]

    def follow_up(self, voltage: Callable[[Samples], Samples], seconds: float, axis: str | None) -> Recording:
        """One more record after the others, driven by ``voltage`` of the time from its start."""
        bench = self._recorded(True)[0]
        bench.pause(20.0)
        t_s = np.arange(round(seconds * self.traits.rate_Hz)) / self.traits.rate_Hz
        return bench.record("more", np.asarray(voltage(t_s), dtype=np.float64))

    def _recorded(self, hidden: bool) -> tuple[Bench, tuple[list[Recording], list[Recording], list[Recording]]]:
        waves, pauses_s = self._plan()
        bench = Bench(self.traits, [self.seed, 3])
        stranger = STRANGERS[self.effects[0]].place(bench) if self.kind == "outside" else None
        bench.mount([stranger] if stranger else [])
        bench.warm_up()
        found: list[list[Recording]] = []
        for wave in waves:
            if len(found) == 1:
                bench.pause(pauses_s[0])
                used = sum(len(volts) for later in waves[1:] for _, volts in later) / self.traits.rate_Hz
                bench.left_s = used + sum(pauses_s[1:])
                if hidden:
                    bench.mount(self._switched(bench, stranger))
            records = []
            for title, volts in wave:
                bench.pause(pauses_s[1 + len(records) + 4 * len(found)])
                records.append(bench.record(title, volts))
            found.append(records)
        reference, train, holdout = found
        return bench, (reference, train, holdout)

    def _switched(self, bench: Bench, stranger: Stranger | None) -> list[Attachable]:
        """What is there from the second session on."""
        if stranger:
            return [Switch(stranger, STRANGERS[self.effects[0]].strength(bench, self._rng(4)))]
        rngs = [np.random.default_rng([self.seed, 5, i]) for i in range(len(self.hidden))]
        return [EFFECTS[h.name].make(h.value, bench, rng) for h, rng in zip(self.hidden, rngs, strict=True)]

    def _plan(self) -> tuple[list[list[tuple[str, Samples]]], list[float]]:
        """Voltages of the three sessions, and the pauses (s) around them; the first is the longest."""
        rng = self._rng(6)
        seconds = (SLOW_SECONDS if SLOW & set(self.effects) else SECONDS)[self.traits.rate_Hz] / self.shorter
        broad = "broad " if self.kind == "outside" else ""
        names = (f"{broad}reference", f"{broad}train", f"{broad}holdout")
        return [session(name, self.traits, seconds, rng) for name in names], [
            rng.uniform(60, 180),
            *rng.uniform(5, 40, 12).tolist(),
        ]


def cases(
    set_name: str, kinds: Sequence[str] = KINDS, sizes: Sequence[float] = SIZES, scale: float = 1.0
) -> list[Case]:
    """The campaign's cases in an order that any beginning of represents. ``scale`` multiplies their numbers.

    ``sizes`` is not used: each case draws its own. Raises ValueError for a set or kind that does not exist.
    """
    if set_name not in SETS:
        raise ValueError(f"no set {set_name!r}; there are {', '.join(SETS)}")
    if wrong := sorted(set(kinds) - set(KINDS)):
        raise ValueError(f"no kind {', '.join(wrong)}; there are {', '.join(KINDS)}")
    found = [
        Case(set_name, kind, _effects(set_name, kind, i), i)
        for kind in kinds
        for i in range(max(1, round(COUNTS[kind] * scale)))
    ]
    return sorted(found, key=lambda case: case.seed)


def case(name: str) -> Case:
    """The case of that name. Raises ValueError."""
    words = name.split("/")
    if len(words) != 4 or words[0] not in SETS or words[1] not in KINDS or not words[3].isdigit():
        raise ValueError(f"no case {name!r}")
    effects = () if words[2] == "nothing" else tuple(words[2].split("+"))
    known = STRANGERS if words[1] == "outside" else EFFECTS
    if set(effects) - set(known):
        raise ValueError(f"no case {name!r}")
    return Case(words[0], words[1], effects, int(words[3]))


def _effects(set_name: str, kind: str, number: int) -> tuple[str, ...]:
    """Single effects take turns, in another order each time; several are drawn."""
    if kind == "none":
        return ()
    known = list(STRANGERS) if kind == "outside" else list(EFFECTS)
    if kind in ("single", "removed", "outside"):
        turn = np.random.default_rng(_hashed(SETS[set_name], kind, "turn", number // len(known)))
        return (str(turn.permutation(known)[number % len(known)]),)
    rng = np.random.default_rng(_hashed(SETS[set_name], kind, "drawn", number))
    found: list[str] = []
    for name in map(str, rng.permutation(known)):
        if not any(name in group and group & set(found) for group in NOT_TOGETHER):
            found.append(name)
        if len(found) == {"pair": 2, "triple": 3}[kind]:
            break
    return tuple(found)


def _rates(effects: Sequence[str]) -> tuple[list[float], list[float]]:
    """Sampling rates at which a lab would look for these, and how often."""
    fast, slow = bool(FAST & set(effects)), bool(SLOW & set(effects))
    if fast:
        return [5000.0, 20000.0], [1.0, 0.0] if slow else [0.6, 0.4]
    if slow:
        return [1000.0, 5000.0], [0.75, 0.25]
    if {"mains_hum", "vibration"} & set(effects):
        return [1000.0, 5000.0], [0.5, 0.5]
    return [1000.0, 5000.0, 20000.0], [0.35, 0.45, 0.2]


def _hashed(*words: str | int) -> int:
    return int.from_bytes(hashlib.sha256("/".join(map(str, words)).encode()).digest()[:8], "big")
