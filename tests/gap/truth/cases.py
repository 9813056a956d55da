"""The cases of a campaign: what is hidden in which rig, by seeds that follow from a case's own name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phaselead.record.recording import Recording

from . import electrical, ferroelectric, habits, mechanical, sensor, sessions, surroundings
from .coupling import CrossCoupling
from .rig import Rig
from .stage import Character, Effect, draw

Samples = NDArray[np.float64]
EFFECTS: dict[str, type[Effect]] = {
    e.name: e for m in (electrical, ferroelectric, mechanical, sensor, surroundings) for e in m.EFFECTS
}
SETS = {"tuning": "tuning-2026", "confirm": "confirm-2026-11-22", "sealed": "sealed-2026-11-r"}
"""Name of each set of seeds. The sealed ones are for the published figure alone; the letters
before this one were spent on earlier versions."""
KINDS = ("none", "single", "sines", "pair", "triple", "removed", "closed_loop", "coupling", "poor")
ON_REQUEST = ("narrow", "slow_sines", "unreferenced", "straight")
"""Kinds that a campaign runs only where they are asked for: the figures of one that names no kinds stay comparable."""
COUNTS = {
    "none": 200, "single": 3, "sines": 1, "pair": 40, "triple": 20, "removed": 23, "closed_loop": 20, "coupling": 9,
    "poor": 20, "narrow": 3, "slow_sines": 6, "unreferenced": 1, "straight": 1,
}  # fmt: skip
"""Cases at scale 1; of the kinds in ``PER_EFFECT`` for each effect and size."""
PER_EFFECT = ("single", "sines", "narrow", "slow_sines", "unreferenced", "straight")
AND_NOTHING = ("unreferenced", "straight")
"""Kinds that have as many cases with nothing hidden as there are effects."""
POORER_THAN_REFERENCE = ("poor", "narrow", "slow_sines")
"""Kinds whose records are poorer than those of the reference session."""
SIZES = (0.05, 0.2, 1.0)
SLOW = {"creep", "charge_leakage", "thermal_drift", "softening"}
FAST = {"delay", "amplifier_lowpass", "sensor_lowpass", "resonance", "load_change", "slew_limit", "sampling_jitter",
        "rate_dependence"}  # fmt: skip
LAGS = ("delay", "amplifier_lowpass", "sensor_lowpass")
"""What is hidden behind slow sines, which show these alike: an experiment may tell them apart."""
STAGE = ("hysteresis", "asymmetric_hysteresis", "resonance", "delay", "amplifier_lowpass", "sensor_lowpass")
"""What every stage has."""
RATES_HZ = {"fast": 5000.0, "slow": 500.0}
ALIKE = [
    {"delay", "amplifier_lowpass", "sensor_lowpass", "slew_limit"},
    {"creep", "charge_leakage", "thermal_drift", "offset"},
    {"asymmetric_hysteresis", "sensor_nonlinearity", "saturation", "dac_nonlinearity"},
    {"hysteresis", "backlash", "rate_dependence"},
    {"gain_change", "softening"},
    {"resonance", "load_change"},
    {"quantisation", "vibration", "sampling_jitter", "mains_hum"},
]
"""Pairs and triples take at most one of each group."""


@dataclass(frozen=True)
class Hidden:
    """One hidden effect: its size as a multiple of the typical, and as the catalogue would measure it."""

    name: str
    size: float
    value: float
    unit: str
    axis: str | None = None


@dataclass(frozen=True)
class Case:
    """One blind trial. ``name`` says it all and is its seed: set/kind/effects/size/rate/number."""

    set_name: str
    kind: str
    effects: tuple[str, ...]
    size: float
    rate: str
    number: int

    @property
    def name(self) -> str:
        what = "+".join(self.effects) or "nothing"
        return f"{self.set_name}/{self.kind}/{what}/{self.size:g}/{self.rate}/{self.number}"

    @property
    def without(self) -> tuple[str, ...]:
        """Effects to leave out of the catalogue."""
        return self.effects if self.kind == "removed" else ()

    @property
    def referenced(self) -> bool:
        """Whether the reference records are at hand, and not the model alone that was fitted to them."""
        return self.kind not in ("unreferenced", "straight")

    @property
    def base(self) -> str:
        """Which model the lab has: of reference records, or no more than a straight line through the training ones."""
        return "linear" if self.kind == "straight" else "operator"

    @property
    def allowed(self) -> tuple[str, ...]:
        """What is missing from a straight line whatever is hidden."""
        if self.kind != "straight":
            return ()
        character = self.characters["x"]
        creeps = ("creep",) if character.base_creep else ()
        return (*STAGE, *creeps)

    @property
    def seed(self) -> int:
        words = "/".join([SETS[self.set_name], *self.name.split("/")[1:]])
        return int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big")

    @cached_property
    def characters(self) -> dict[str, Character]:
        """The stages."""
        rng = np.random.default_rng([self.seed, 1])
        rate_Hz = RATES_HZ[self.rate]
        bits = 12 if "dac_nonlinearity" in self.effects else 16
        found = {axis: draw(rng, rate_Hz, bits) for axis in ("xyz" if self.kind == "coupling" else "x")}
        if "hysteresis" in self.effects:
            found = {axis: replace(c, loop=0.005) for axis, c in found.items()}
        if self.kind == "poor":
            found = {
                axis: replace(c, white_um=20 * c.white_um, coloured_um=20 * c.coloured_um) for axis, c in found.items()
            }
        return found

    @cached_property
    def hidden(self) -> tuple[Hidden, ...]:
        """The truth."""
        axis = "x" if self.kind == "coupling" else None
        known = {**EFFECTS, CrossCoupling.name: CrossCoupling}
        return tuple(
            Hidden(name, self.size, self.size * known[name].typical, known[name].unit, axis) for name in self.effects
        )

    @cached_property
    def habit(self) -> habits.Habit:
        """What the lab of a narrow case always records; drawn by itself: it depends on nothing that is hidden."""
        return habits.draw(np.random.default_rng([self.seed, 4]))

    @property
    def bits(self) -> int:
        """Of the converters, as a lab knows them."""
        return next(iter(self.characters.values())).bits

    def records(self, *, hidden: bool = True) -> tuple[list[Recording], list[Recording], list[Recording]]:
        """(reference, train, holdout): the first without what is hidden; with ``hidden`` False all of them are."""
        return self._recorded(hidden)[1]

    def _recorded(self, hidden: bool = True) -> tuple[Rig, tuple[list[Recording], list[Recording], list[Recording]]]:
        rig = Rig(self.characters, np.random.default_rng([self.seed, 2]))
        session = {
            "sines": sessions.sines, "closed_loop": sessions.tracked, "coupling": sessions.three_axes,
            "poor": sessions.poor, "slow_sines": sessions.slow_sines,
            "narrow": partial(sessions.narrow, habit=self.habit),
        }.get(self.kind, sessions.mixed)  # fmt: skip
        reference = sessions.mixed(rig, "reference") if self.kind in ("closed_loop", *POORER_THAN_REFERENCE) else []
        reference += session(rig, "reference") if self.kind not in POORER_THAN_REFERENCE else []
        rig.pause(30)
        if hidden:
            self.hide(rig)
        train = session(rig, "train")
        rig.pause(10)
        holdout = session(rig, "holdout", held_out=True)
        return rig, (reference, train, holdout)

    def bare_holdout(self) -> list[Recording] | None:
        """The held-out records with nothing hidden; None where the base is too poor for what it leaves of them to be
        a floor."""
        return None if self.kind == "straight" else self.records(hidden=False)[2]

    def follow_up(self, voltage: Callable[[Samples], Samples], seconds: float, axis: str | None) -> Recording:
        """One more record after the others, driven by ``voltage`` of the time from its start, within the span."""
        rig = self._recorded()[0]
        driven = axis or next(iter(rig.stages))
        t = np.arange(round(seconds * rig.rate_Hz)) / rig.rate_Hz
        waves = {a: np.zeros(len(t)) for a in rig.stages}
        waves[driven] = np.clip(voltage(t), 0.0, self.characters[driven].span_V)
        return rig.record("more", waves)

    def hide(self, rig: Rig) -> None:
        """Switch it on."""
        rng = np.random.default_rng([self.seed, 3])
        if self.kind == "coupling":
            rig.switch({}, CrossCoupling(self.size, self.characters, rng) if self.effects else None)
        elif self.effects:
            character = self.characters["x"]
            rig.switch({"x": [EFFECTS[name](self.size, character, rng) for name in self.effects]})


def cases(
    set_name: str, kinds: Sequence[str] = KINDS, sizes: Sequence[float] = SIZES, scale: float = 1.0
) -> list[Case]:
    """The campaign's cases in an order that any beginning of represents. ``scale`` multiplies their numbers.

    Raises ValueError for a set or kind that does not exist.
    """
    if set_name not in SETS or (wrong := set(kinds) - {*KINDS, *ON_REQUEST}):
        raise ValueError(f"no set {set_name!r}" if set_name not in SETS else f"no kind {', '.join(sorted(wrong))}")
    found = [case for kind in kinds for case in _of_kind(set_name, kind, sizes, scale)]
    return sorted(found, key=lambda case: case.seed)


def case(name: str) -> Case:
    """The case of that name. Raises ValueError."""
    set_name, kind, what, size, rate, number = name.split("/")
    effects = () if what == "nothing" else tuple(what.split("+"))
    return Case(set_name, kind, effects, float(size), rate, int(number))


def _of_kind(set_name: str, kind: str, sizes: Sequence[float], scale: float) -> list[Case]:
    count = COUNTS[kind] * scale
    if kind in PER_EFFECT:
        numbers = range(round(count * len(EFFECTS)) if kind in AND_NOTHING else 0)
        nothing = [Case(set_name, kind, (), 0.0, _rate((), i), i) for i in numbers]
        return [*nothing, *_singles(set_name, kind, sizes, count)]
    number = max(1, round(count))
    names = [_combination(set_name, kind, i) for i in range(number)]
    found = []
    for i, effects in enumerate(names):
        size = {"none": 0.0, "poor": 0.05, "coupling": SIZES[i % 3]}.get(kind, 1.0)
        found.append(Case(set_name, kind, effects, size, "slow" if kind == "coupling" else _rate(effects, i), i))
    return found


def _singles(set_name: str, kind: str, sizes: Sequence[float], count: float) -> list[Case]:
    """``count`` of each effect and size; below 1, that share of them."""
    effects = LAGS if kind == "slow_sines" else tuple(EFFECTS)
    made = [(e, s, i) for e, s, i in product(effects, sizes, range(max(1, int(np.ceil(count)))))]
    found = [Case(set_name, kind, (e,), s, _rate((e,), i), i) for e, s, i in made]
    whole = max(1, round(len(effects) * len(sizes) * count))
    return sorted(found, key=lambda case: (case.number, case.seed))[:whole]


def _rate(effects: Sequence[str], number: int) -> str:
    if set(effects) & FAST:
        return "fast"
    if set(effects) & SLOW:
        return "slow"
    return "slow" if number % 2 else "fast"


def _combination(set_name: str, kind: str, number: int) -> tuple[str, ...]:
    """What is hidden in the ``number``-th case of a kind."""
    if kind == "none":
        return ()
    if kind == "coupling":
        return (CrossCoupling.name,)
    words = f"{SETS[set_name]}/{kind}/{number}"
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big"))
    if kind in ("removed", "closed_loop", "poor"):
        block = np.random.default_rng(len(kind) + number // len(EFFECTS)).permutation(list(EFFECTS))
        return (str(block[number % len(EFFECTS)]),)
    return _unlike(rng, {"pair": 2, "triple": 3}[kind])


def _unlike(rng: np.random.Generator, count: int) -> tuple[str, ...]:
    found: list[str] = []
    for name in rng.permutation(list(EFFECTS)):
        clash = any({str(name), other} <= group for group in ALIKE for other in found)
        speeds = {"fast" if n in FAST else "slow" for n in [*found, str(name)] if n in FAST | SLOW}
        if not clash and len(speeds) < 2:
            found.append(str(name))
        if len(found) == count:
            break
    return tuple(found)
