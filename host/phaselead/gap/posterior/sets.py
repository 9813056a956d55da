"""A set of effects: block by block at some parameters, and fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phaselead.gap.history import Stood
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.moments import Amounts, Integers, Moments
from phaselead.gap.posterior.priors import Prior
from phaselead.model import Effect
from phaselead.record import Samples

Names = tuple[str, ...]
"""Of a set of effects, sorted."""


@dataclass(frozen=True)
class Settled:
    """Where what is integrated out is most likely, under each of s shares."""

    amounts: Amounts
    """Of its columns."""
    power: Samples
    """(s, blocks) of the residual less these."""
    variance: Samples
    """(s, blocks) that is expected of it."""

    def __getitem__(self, which: int) -> Settled:
        """Under one of them."""
        return Settled(self.amounts[which], self.power[[which]], self.variance[[which]])


@dataclass(frozen=True)
class Begun:
    """Where the fit of a set of effects begins."""

    entries: Sequence[SizedEffect]
    stood: Sequence[Stood] = ()
    """By run about what they had done before it as voltages; by default nothing."""
    moving: Samples | None = None
    """(runs, b) 1 for what still goes on of what had been done before; by default all of it."""
    moving_found: bool = False
    """Whether a fit found that: of this set, or of the set less an effect that has no past."""
    last_is_over: bool = False
    """Whether what the last effect had done before is taken to be over in all records."""

    def and_one(self, entry: SizedEffect, is_over: bool = False) -> Begun:
        """With one effect more, of which all that it had done before may be over."""
        entries = (*self.entries, entry)
        if entry[0].before_record is not None:
            return Begun(entries, self.stood, last_is_over=is_over)
        return Begun(entries, self.stood, self.moving, self.moving_found)


@dataclass(frozen=True)
class Terms:
    """A set of effects at some parameters, block by block."""

    entries: tuple[SizedEffect, ...]
    moments: Moments
    """Of the tangents of the p parameters, of what is integrated out, and of the residual."""
    signal: Samples
    """(blocks,) power of what the effects add, spread."""
    of_material: Samples
    """(blocks,) the part of it that is of the ceramic's loops and creep."""
    moved_before: Samples
    """(blocks,) power of how what had stood off before the records moves the stage."""
    prior: Prior
    stood: tuple[Stood, ...]
    """By run what the effects had done before it as voltages, beside which all of this is linear."""
    of_effects: tuple[tuple[int, ...], ...]
    """By run the entry that each of its columns before is of."""
    levels_say: bool = True
    """Whether levels count."""
    settled: dict[tuple[float, bool], Settled] = field(default_factory=dict)
    """Where what is integrated out settles, by share and whether held-out records counted, once found."""

    @property
    def of_columns(self) -> Integers:
        """(b,) The entry that each column before is of, in a record that has such columns."""
        return np.array(max(self.of_effects, key=len), dtype=np.intp)

    @property
    def begun(self) -> Begun:
        """Where a fit of the same set would begin, with what goes on as it is taken here."""
        return Begun(self.entries, self.stood, self.moments.moving)

    def where_moving(self, moving: Samples) -> Terms:
        """The same where of what had been done before only this (runs, b) still goes on."""
        return replace(self, moments=self.moments.where_moving(moving), settled={})


@dataclass(frozen=True)
class Fit:
    """A set of effects at its most likely parameters."""

    terms: Terms
    log_evidence: float
    """Of all records, over all shares."""
    log_evidence_fitted: float
    """Without the held-out records."""
    named: float
    """Probability that no more is missed than an equation of that name may miss."""
    share: float
    """The most likely share of equation misfit."""
    joint_covariance: Samples
    """(parameters + k, parameters + k) of the parameters in internal units, and of the amounts of the k columns that
    may be missed in all records alike. An octave tells a size once, however many records there are."""
    log_levels: float = 0.0
    """What the levels of all records bring to the log evidence."""
    log_levels_fitted: float = 0.0
    """The same without the held-out records."""

    def levels(self, held_out: bool) -> float:
        """What the levels of all records bring to the log evidence, with the held-out ones or without."""
        return self.log_levels if held_out else self.log_levels_fitted

    @property
    def covariance(self) -> Samples:
        """(parameters, parameters) in internal units."""
        p = len(self.terms.prior.centre)
        return self.joint_covariance[:p, :p]

    @property
    def entries(self) -> tuple[SizedEffect, ...]:
        """The effects and their parameters."""
        return self.terms.entries

    @property
    def begun(self) -> Begun:
        """Where a fit of the same set would begin beside something else."""
        return replace(self.terms.begun, moving_found=True)

    def begun_without(self, index: int) -> Begun:
        """Where a fit of the set less one of its effects would begin."""
        entries = (*self.entries[:index], *self.entries[index + 1 :])
        return Begun(entries, self.terms.stood, self.terms.moments.moving[:, self.terms.of_columns != index])

    @property
    def names(self) -> Names:
        """Of the effects, sorted."""
        return names_of(self.entries)


def goes_on_between_records(effect: Effect) -> bool:
    """Whether it is so slow that what it had done before a record shows in where that stands."""
    return effect.slow and effect.before_record is not None


def has_history(entries: Sequence[SizedEffect]) -> bool:
    """Whether where records stand depends on what went on between them, which no record shows."""
    return any(goes_on_between_records(effect) for effect, _ in entries)


def names_of(entries: Sequence[SizedEffect]) -> Names:
    """Names of some effects, sorted."""
    return tuple(sorted(effect.name for effect, _ in entries))


def confused(one: Effect, other: Effect) -> bool:
    """Whether two effects are hard to tell apart by what the catalogue says of either."""
    mine, theirs = ({*e.confused_with, *e.hard_to_tell_from} for e in (one, other))
    return one.name != other.name and (other.name in mine or one.name in theirs)
