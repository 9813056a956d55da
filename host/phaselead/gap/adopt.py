"""The next stage file: the base with the effects that were found, their intervals and its provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet

from phaselead.control import are_designed, with_gains
from phaselead.gap.findings import NAMED, PROVISIONAL, Adopted, NamedEffect
from phaselead.model import AdoptedEffect, AxisModel, Stage, catalogue, provenance_of
from phaselead.record import Recording


def adopted(axis: AxisModel, found: Sequence[NamedEffect], provisional: AbstractSet[str] = frozenset()) -> AxisModel:
    """The axis with the effects appended to its list, each beside any of the same name that it had; ``provisional``
    are the names that are not vouched for."""
    return axis.model_copy(update={"effects": (*axis.effects, *stage_file_entries(found, provisional))})


def stage_file_entries(found: Sequence[NamedEffect], provisional: AbstractSet[str]) -> list[AdoptedEffect]:
    """Effects as a stage file keeps them; ``provisional`` are the names that are not vouched for."""
    return [
        AdoptedEffect(
            name=one.name,
            status=PROVISIONAL if one.name in provisional else NAMED,
            params={name: value for name, (value, _, _) in one.params.items()},
            ci95={name: interval for name, (_, _, interval) in one.params.items()},
            share=min(max(one.share, 0.0), 1.0),
        )
        for one in found
    ]


def kept_names(named: Sequence[NamedEffect], entries: Sequence[NamedEffect], plays: bool) -> list[Adopted]:
    """What the next model of an axis has that the base had not: all that is ``named``, what else is among the
    ``entries`` of its list, and the effect that became ``plays`` of its own, if one did."""
    sure = [one.name for one in named]
    as_plays = [e.name for e in catalogue().values() if e.becomes_plays] if plays else []
    unsure = [name for name in dict.fromkeys([*(one.name for one in entries), *as_plays]) if name not in sure]
    return [*(Adopted(name, NAMED) for name in sure), *(Adopted(name, PROVISIONAL) for name in unsure)]


def next_stage(stage: Stage, axes: Mapping[str, AxisModel], data: Sequence[Recording]) -> Stage:
    """The stage with ``axes`` replaced, and with the parent's hash and the records learned from as its provenance.
    Gains that were designed for the model before are designed anew; chosen or tuned ones, and none, stay."""
    found = Stage(
        name=stage.name,
        provenance=provenance_of(stage, data),
        cross_coupling=stage.cross_coupling,
        axes={**stage.axes, **axes},
    )
    designed = {n: m for n, m in found.axes.items() if m.gains is not None and are_designed(m.gains)}
    if not designed:
        return found
    anew = with_gains(found.model_copy(update={"axes": designed}))
    return found.model_copy(update={"axes": {**found.axes, **anew.axes}})
