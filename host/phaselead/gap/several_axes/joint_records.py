"""Records in which the axes of a stage move together, as what drives the modes that the axes share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.records import GapRun, Role
from phaselead.identify import STILL_V, Drive, JointExperiment
from phaselead.model import AxisModel, Chain, Effect, Entry, ModePart, Params, Signal, catalogue, push_level
from phaselead.record import Samples

LEVEL_RATIO = 1.2
"""Records whose drives differ by less than this factor were taken at one level."""

Entries = Mapping[str, Sequence[Entry]]
"""By axis: the effects between voltage and mechanics."""


def effect_of(part: ModePart) -> Effect:
    """The effect of the catalogue that describes one part of the modes that axes share."""
    return next(effect for effect in catalogue().values() if effect.shared_modes == part)


@dataclass(frozen=True)
class JointRecord:
    """One record of all axes. Positions have one row more than voltages, in front, as chains have it."""

    role: Role
    source: str
    axes: tuple[str, ...]
    chains: tuple[Chain, ...]
    """One for each axis, from the voltage up to the mechanics."""
    u_V: Samples
    """(n, axes)."""
    x_um: Samples
    """(n + 1, axes)."""
    rows: slice
    """Scored rows of ``x_um``."""
    step_s: float

    def pushes(self, entries: Entries) -> list[Signal]:
        """For each axis the signal that its actuator gives to the mechanics, with these effects in front."""
        return [chain.push(entries.get(axis, ())) for axis, chain in zip(self.axes, self.chains, strict=True)]

    def drive(self, entries: Entries) -> Drive:
        """The same as the input of a fit of modes; the level of an actuator that does not soften is 0."""
        pushes = self.pushes(entries)
        push_um = np.stack([p.displacement_um for p in pushes], axis=1)
        softening = [softening_params(entries.get(a, ())) for a in self.axes]
        level = None
        if any(q is not None for q in softening):
            none = np.zeros(len(push_um))
            levels = [none if q is None else push_level(p, q) for p, q in zip(pushes, softening, strict=True)]
            level = np.stack(levels, axis=1)
        return Drive(push_um, level, self.x_um, self.rows, self.step_s)

    @property
    def experiment(self) -> JointExperiment:
        """The record as ``identify.frequency_response`` takes it."""
        return JointExperiment(self.u_V, self.x_um[1:], slice(self.rows.start - 1, self.rows.stop - 1), self.step_s)

    @property
    def level_V(self) -> float:
        """Rms voltage of the scored rows over all axes."""
        e = self.experiment
        return float(np.sqrt(np.mean(np.var(e.u_V[e.rows], axis=0))))

    @property
    def together(self) -> bool:
        """Whether more than one axis is driven in the scored rows."""
        e = self.experiment
        return int(np.count_nonzero(np.ptp(e.u_V[e.rows], axis=0) > STILL_V)) > 1


def joint_records(models: Mapping[str, AxisModel], runs: Mapping[str, Sequence[GapRun]]) -> list[JointRecord] | None:
    """The runs of all axes put together by record; None where a record lacks an axis.

    Effects that a model has adopted for the modes are left out of its chains.
    """
    axes = tuple(runs)
    by_record = list(zip(*runs.values(), strict=False))
    if any(len(of_axis) != len(by_record) for of_axis in runs.values()):
        return None
    bare = {a: _without_mechanics(models[a]) for a in axes}
    found = []
    for of_record in by_record:
        first = of_record[0]
        if any(run.source != first.source or run.role != first.role for run in of_record):
            return None
        x = np.stack([run.x_um for run in of_record], axis=1)
        found.append(
            JointRecord(
                first.role,
                first.name,
                axes,
                tuple(Chain(bare[run.axis], run.t_s, run.u_V, remember=2) for run in of_record),
                np.stack([run.u_V for run in of_record], axis=1),
                np.vstack([x[:1], x]),
                slice(first.start + 1, first.stop + 1),
                first.step_s,
            )
        )
    return found


def scaled(record: JointRecord, models: Mapping[str, AxisModel], factor: float) -> JointRecord:
    """The same drives so many times as large about their means, with positions that nobody measured: 0."""
    middle = record.u_V[record.experiment.rows].mean(axis=0)
    u = middle + factor * (record.u_V - middle)
    t_s = np.arange(len(u)) * record.step_s
    bare = [_without_mechanics(models[a]) for a in record.axes]
    chains = tuple(Chain(axis, t_s, drive, remember=2) for axis, drive in zip(bare, u.T, strict=True))
    return replace(record, chains=chains, u_V=u, x_um=np.zeros_like(record.x_um))


def _without_mechanics(model: AxisModel) -> AxisModel:
    """The axis without what it has adopted of shared modes, whose place their fit takes."""
    of_modes = {name for name, effect in catalogue().items() if effect.shared_modes is not None}
    return model.model_copy(update={"effects": tuple(e for e in model.effects if e.name not in of_modes)})


def softening_params(entries: Sequence[Entry]) -> Params | None:
    """Parameters of the softening among the effects of one axis; None where it does not soften."""
    return next((params for e, params in entries if e.shared_modes == "level"), None)


def response_groups(records: Sequence[JointRecord]) -> list[list[JointRecord]]:
    """Groups of one level each with at least as many records as axes; without any, all records as one group."""
    enough = [group for group in level_groups(records) if len(group) >= len(group[0].axes)]
    return enough or [list(records)]


def level_groups(records: Sequence[JointRecord]) -> list[list[JointRecord]]:
    """Records grouped by level, the strongest first."""
    groups: list[list[JointRecord]] = []
    for record in sorted(records, key=lambda s: -s.level_V):
        if groups and groups[-1][0].level_V < LEVEL_RATIO * record.level_V:
            groups[-1].append(record)
        else:
            groups.append([record])
    return groups
