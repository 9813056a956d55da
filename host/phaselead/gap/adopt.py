"""The next stage file: the base with the effects that were found, their intervals and its provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet

from phaselead.gap.findings import NamedEffect
from phaselead.model import AdoptedEffect, AdoptedStatus, AxisModel, Stage, provenance_of
from phaselead.record import Recording


def adopted(axis: AxisModel, found: Sequence[NamedEffect], provisional: AbstractSet[str] = frozenset()) -> AxisModel:
    """The axis with the effects appended to its list, each beside any of the same name that it had; ``provisional``
    are the names that are not vouched for."""
    entries = [stage_file_entry(one, "provisional" if one.name in provisional else "named") for one in found]
    return axis.model_copy(update={"effects": (*axis.effects, *entries)})


def stage_file_entry(named: NamedEffect, status: AdoptedStatus = "named") -> AdoptedEffect:
    """An effect as a stage file keeps it."""
    return AdoptedEffect(
        name=named.name,
        status=status,
        params={name: value for name, (value, _, _) in named.params.items()},
        ci95={name: interval for name, (_, _, interval) in named.params.items()},
        share=min(max(named.share, 0.0), 1.0),
    )


def next_stage(stage: Stage, axes: Mapping[str, AxisModel], data: Sequence[Recording]) -> Stage:
    """The stage with ``axes`` replaced, and with the parent's hash and the records learned from as its provenance."""
    return Stage(
        name=stage.name,
        provenance=provenance_of(stage, data),
        cross_coupling=stage.cross_coupling,
        axes={**stage.axes, **axes},
    )
