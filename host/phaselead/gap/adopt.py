"""The next stage file: the base with what was found, its intervals, and where it came from."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import PurePath

from phaselead.gap.result import NamedEffect
from phaselead.model import AdoptedEffect, AxisModel, DataSource, Provenance, Stage
from phaselead.record import Recording


def adopted(axis: AxisModel, found: Sequence[NamedEffect]) -> AxisModel:
    """The axis with the effects behind its list: one of a name that is there already acts beside it."""
    return axis.model_copy(update={"effects": (*axis.effects, *map(_entry, found))})


def _entry(named: NamedEffect) -> AdoptedEffect:
    return AdoptedEffect(
        name=named.name,
        params={name: value for name, (value, _, _) in named.params.items()},
        ci95={name: interval for name, (_, _, interval) in named.params.items()},
        share=min(max(named.share, 0.0), 1.0),
    )


def next_stage(stage: Stage, axes: Mapping[str, AxisModel], data: Sequence[Recording]) -> Stage:
    """The stage with the axes replaced and its provenance: the parent's hash and the records learned from."""
    sources = {
        r.sha256: DataSource(file=PurePath(r.source).name or "recording", sha256=r.sha256) for r in data if r.sha256
    }
    try:
        tool = f"phaselead {version('phaselead')}"
    except PackageNotFoundError:
        tool = "phaselead"
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0).isoformat().replace("+00:00", "Z")
    provenance = Provenance(parent_sha256=stage.sha256, data=tuple(sources.values()), tool=tool, created=now)
    return Stage(
        name=stage.name,
        provenance=provenance,
        cross_coupling=stage.cross_coupling,
        axes={**stage.axes, **axes},
    )
