"""Where the search of one axis ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from phaselead.gap.findings import NAMED, WITHDRAWN, Candidate, Estimate
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import Claim, Contest
from phaselead.gap.records import Role
from phaselead.gap.residual import ModelledRun
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
    claims: tuple[Claim, ...] = ()
    estimates: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    """Value, unit and interval of every parameter by effect."""
    contest: Contest | None = None
    """The sets that were compared, and their likelihood."""
    candidates: tuple[Candidate, ...] = ()
    """The sets that were compared last."""
    memory: Memory | None = None
    something_unnamed: bool = False
    """Whether something is there that no name is sure to be."""
    messages: tuple[str, ...] = ()
    """For a person."""
    nameless_claims: tuple[Claim, ...] = ()
    """What is there and would be a change of the base, or a base that was wrong: it has entries, and gets no name."""
    nameless: frozenset[str] = frozenset()
    """The effects that change what the base has."""

    def runs(self, role: Role) -> list[ModelledRun]:
        """Those of one role, under the base."""
        assert self.contest is not None
        return [run.modelled for run in self.contest.likelihood.runs if run.modelled.run.role == role]

    def withdrawn(self) -> Selection:
        """The same where no claim survives: nothing stands in the place of another effect, or beside it."""
        candidates = tuple(replace(c, remark=WITHDRAWN) if c.remark == NAMED else c for c in self.candidates)
        return replace(self, entries=(), claims=(), estimates={}, candidates=candidates)
