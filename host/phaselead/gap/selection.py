"""Where the search of one axis ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace

from phaselead.gap.error_rates import INSIDE
from phaselead.gap.findings import NAMED, WITHDRAWN, Candidate, Estimate, Posterior
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import MORE_LIKELY_THAN_NOT, MOST_TIED, Claim, Contest
from phaselead.model import AxisModel, Effect


@dataclass(frozen=True)
class Memory:
    """Plays that a base without any was given, and the effect of the catalogue that describes them."""

    effect: Effect
    params: Mapping[str, Estimate]
    probability: float
    why: str


@dataclass(frozen=True)
class Selection:
    """The effects that are there, by their posterior, beside a base."""

    base: AxisModel
    """With the memory that it was given."""
    start: AxisModel
    """The base as given."""
    entries: tuple[SizedEffect, ...]
    """The effects that are there, at the parameters that are adopted."""
    contest: Contest
    """The sets that were compared, and their likelihood."""
    found: tuple[Claim, ...] = ()
    """What is there, with a name or without."""
    nameless: frozenset[str] = frozenset()
    """Effects that change what the base has, and so get no name."""
    probability: Mapping[str, float] = field(default_factory=dict)
    """Of each effect of the sets that were compared, by name."""
    something_unnamed: bool = False
    """Whether something is there that no name is sure to be."""
    estimates: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    """Value, unit and interval of every parameter by effect."""
    posteriors: Mapping[str, Posterior] = field(default_factory=dict)
    """Of the parameters, by effect."""
    candidates: tuple[Candidate, ...] = ()
    """The sets that were compared last."""
    memory: Memory | None = None
    in_place: tuple[str, ...] = ()
    """Names of effects that may be in the place of a mode that the base has."""

    @property
    def claims(self) -> tuple[Claim, ...]:
        """What is there and has a name, or is tied with what has one."""
        return with_a_name(self.found, self.nameless)

    @property
    def nameless_claims(self) -> tuple[Claim, ...]:
        """What is there and would be a change of the base, or a base that was wrong: it has entries, and gets no
        name."""
        return tuple(claim for claim in self.found if claim not in self.claims)

    def is_without(self, name: str) -> bool:
        """Whether an effect was looked for and is probably not there."""
        return name in self.contest.names and self.probability.get(name, 0.0) <= 1 - INSIDE

    def likeliest(self, without: AbstractSet[str]) -> list[str]:
        """Names of the effects that may be there and may have one, but for some, the most probable first, as many as
        a tie may hold."""
        out = without | self.nameless
        may_be = [name for name in self.probability if name not in out and not self.is_without(name)]
        return sorted(may_be, key=lambda name: -self.probability[name])[:MOST_TIED]

    def is_likely(self, name: str) -> bool:
        """Whether an effect is more likely there than not."""
        return self.probability.get(name, 0.0) > MORE_LIKELY_THAN_NOT

    @property
    def messages(self) -> list[str]:
        """Why what is there has no name, or cannot be told from a rival, for a person."""
        said = [
            f"{name} has its zeros where the model has a mode, so that it may be that mode, changed"
            for name in self.in_place
        ]
        for claim in self.found:
            names = " or ".join(name for name in claim.tied if name in self.nameless)
            if names:
                said.append(
                    f"{names} cannot be told from a model that was wrong: give --reference records, or --frozen"
                )
        return said

    def withdrawn(self) -> Selection:
        """The same where no claim survives: nothing stands in the place of another effect, or beside it."""
        candidates = tuple(replace(c, remark=WITHDRAWN) if c.remark == NAMED else c for c in self.candidates)
        return replace(self, entries=(), found=(), estimates={}, posteriors={}, candidates=candidates)


def with_a_name(claims: Sequence[Claim], nameless: AbstractSet[str]) -> tuple[Claim, ...]:
    """The claims that are not of nameless effects alone."""
    return tuple(claim for claim in claims if not nameless >= set(claim.tied))
