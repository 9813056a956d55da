"""The cases of generator C, by seeds that follow from a case's own name: set/kind/effects/number."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phaselead import Recording

from .bench import Bench
from .effects import EFFECTS, UNLIKE, Shape
from .mechanics import loaded
from .parts import Mode, Samples
from .session import Piece, plan
from .stage import SLOW, Traits, draw, log_uniform

SETS = {"tuning": "c-tuning-1", "sealed": "c-sealed-2"}
"""Salt of each set of seeds."""
COUNTS = {"none": 60, "single": 92, "pair": 20, "triple": 10, "removed": 18}
"""Cases at scale 1."""
KINDS = tuple(COUNTS)
SIZES = {"single": (0.1, 2.0), "pair": (0.5, 2.0), "triple": (0.5, 2.0), "removed": (1.0, 2.0)}
"""Multiples of the typical size, between which sizes are drawn evenly in their logarithm."""
NOT_REMOVED = {"quantisation", "sampling_jitter"}
"""More noise than before, which says little about where it comes from."""
NUMBERS = {"none": 0, "single": 1, "pair": 2, "triple": 3, "removed": 1}
NOTHING = "nothing"


@dataclass(frozen=True)
class Hidden:
    """One hidden effect: its size as a multiple of the typical one, and, signed, in the catalogue's unit."""

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

    @property
    def name(self) -> str:
        return f"{self.set_name}/{self.kind}/{'+'.join(self.effects) or NOTHING}/{self.number}"

    def _rng(self, purpose: str) -> np.random.Generator:
        return np.random.default_rng(_hashed(SETS[self.set_name], self.name, purpose))

    @property
    def without(self) -> tuple[str, ...]:
        """Effects to leave out of the catalogue."""
        return self.effects if self.kind == "removed" else ()

    @cached_property
    def traits(self) -> Traits:
        """The stage."""
        return draw(self._rng("stage"), self.effects)

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
        """The truth."""
        rng, found = self._rng("sizes"), []
        for name in self.effects:
            effect, (low, high) = EFFECTS[name], SIZES[self.kind]
            size = log_uniform(rng, min(low, effect.largest), min(high, effect.largest))
            sign = -1 if rng.random() < 0.5 and effect.signed else 1
            found.append(Hidden(name, size, sign * size * effect.typical, effect.unit))
        return tuple(found)

    @cached_property
    def shapes(self) -> dict[str, Shape]:
        """Numbers that say how each hidden effect looks."""
        rng = self._rng("shapes")
        return {h.name: EFFECTS[h.name].shape(rng, h.value, self.traits) for h in self.hidden}

    @property
    def chain(self) -> list[list[Mode]]:
        """Modes one after the other, with what is hidden."""
        found = [list(self.traits.modes)]
        for h in self.hidden:
            shape = self.shapes[h.name]
            if h.name == "load_change":
                found[0] = loaded(self.traits.modes, h.value, shape["others"])
            elif h.name == "resonance":
                found.append([(h.value, shape["f_Hz"], shape["zeta"])])
        return found

    @cached_property
    def pieces(self) -> tuple[list[Piece], list[Piece], list[Piece]]:
        """What is recorded: reference, training and held out."""
        return plan(self._rng("session"), self.traits, self.chain, bool(SLOW & set(self.effects)))

    @cached_property
    def _after_reference(self) -> tuple[list[Recording], Bench]:
        bench = Bench(self.traits)
        return [bench.record(piece) for piece in self.pieces[0]], bench

    def _bench(self, hidden: bool) -> Bench:
        """The stage after its reference session, with what is hidden from there on."""
        bench = copy.deepcopy(self._after_reference[1])
        for h in self.hidden if hidden else ():
            bench.ahead_s = self._ahead_s(bench.t_s)
            EFFECTS[h.name].mount(bench, h.value, self.shapes[h.name])
        return bench

    def _ahead_s(self, now_s: float) -> tuple[float, float]:
        """When the training records begin, and how long it is from there to the end of the held-out ones.

        The ways to and from each record take 0.9 s, that to its running in 0.2 s.
        """
        later = [*self.pieces[1], *self.pieces[2]]
        rate_Hz = self.traits.rate_Hz
        ways = [piece.pause_s + 0.9 + len(piece.before) / rate_Hz for piece in later]
        begin_s = now_s + ways[0] + 0.2
        return begin_s, sum(ways[1:]) + sum(len(piece.s) for piece in later) / rate_Hz

    def records(self, *, hidden: bool = True) -> tuple[list[Recording], list[Recording], list[Recording]]:
        """(reference, train, holdout): the first without what is hidden; with ``hidden`` False all of them are."""
        bench = self._bench(hidden)
        train, holdout = ([bench.record(piece) for piece in part] for part in self.pieces[1:])
        return list(self._after_reference[0]), train, holdout

    def bare_holdout(self) -> list[Recording]:
        """The held-out records with nothing hidden."""
        return self.records(hidden=False)[2]

    def follow_up(self, voltage: Callable[[Samples], Samples], seconds: float, axis: str | None) -> Recording:
        """One more record after the others, driven by ``voltage`` of the time from its start; kept to the range."""
        bench, traits = self._bench(True), self.traits
        for part in self.pieces[1:]:
            for piece in part:
                bench.record(piece)
        t_s = np.arange(round(seconds * traits.rate_Hz)) / traits.rate_Hz
        s = (np.asarray(voltage(t_s), float) - traits.mid_V) / traits.half_V
        seed = int(self._rng("follow-up").integers(2**31))
        return bench.record(Piece("follow-up", np.clip(s, -1, 1), 15.0, True, np.zeros(0), seed))


def cases(set_name: str, kinds: Sequence[str] = KINDS, sizes: Sequence[float] = (), scale: float = 1.0) -> list[Case]:
    """The campaign's cases; kinds are so mixed that any beginning is a fair sample. ``scale`` multiplies their numbers.

    ``sizes`` has no meaning here: every case draws its own. Raises ValueError for a set or kind that is not there.
    """
    if set_name not in SETS:
        raise ValueError(f"no set {set_name}; there are {', '.join(SETS)}")
    for kind in kinds:
        if kind not in KINDS:
            raise ValueError(f"no kind {kind}; there are {', '.join(KINDS)}")
    found = []
    for kind in kinds:
        count = max(1, round(COUNTS[kind] * scale))
        for i in range(count):
            found.append(((i + 0.5) / count, KINDS.index(kind), Case(set_name, kind, _effects(set_name, kind, i), i)))
    return [c for *_, c in sorted(found, key=lambda item: item[:2])]


def case(name: str) -> Case:
    """The case of that name. Raises ValueError."""
    words = name.split("/")
    if len(words) != 4 or words[0] not in SETS or words[1] not in KINDS or not words[3].isdigit():
        raise ValueError(f"no case {name!r}")
    effects = () if words[2] == NOTHING else tuple(words[2].split("+"))
    if set(effects) - set(EFFECTS) or len(set(effects)) != NUMBERS[words[1]]:
        raise ValueError(f"no case {name!r}")
    return Case(words[0], words[1], effects, int(words[3]))


def _effects(set_name: str, kind: str, number: int) -> tuple[str, ...]:
    """Single effects take turns, in another order each time; several are drawn."""
    known = sorted(set(EFFECTS) - (NOT_REMOVED if kind == "removed" else set()))
    if NUMBERS[kind] < 2:
        turn, at = divmod(number, len(known))
        order = np.random.default_rng(_hashed(SETS[set_name], kind, "turn", turn)).permutation(known)
        return (str(order[at]),) if NUMBERS[kind] else ()
    rng = np.random.default_rng(_hashed(SETS[set_name], kind, "drawn", number))
    found: list[str] = []
    for name in map(str, rng.permutation(known)):
        if len(found) < NUMBERS[kind] and not any(name in group and group & set(found) for group in UNLIKE):
            found.append(name)
    return tuple(found)


def _hashed(*words: str | int) -> int:
    return int.from_bytes(hashlib.sha256("/".join(map(str, words)).encode()).digest()[:8], "big")
