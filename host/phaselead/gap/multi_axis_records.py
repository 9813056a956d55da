"""Records in which the axes of one stage move together, as drives of its common modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.records import Role, Run
from phaselead.identify import STILL_V, Drive, JointExperiment
from phaselead.model import AxisModel, Chain, Entry, Signal, push_level
from phaselead.record import Samples

OF_THE_MECHANICS = ("resonance", "cross_coupling", "softening")
"""Adopted effects that the fit of common modes takes the place of."""
LEVEL_RATIO = 1.2
"""Records whose drive differs by less than this factor were taken at one level."""

Entries = Mapping[str, Sequence[Entry]]
"""Per axis the effects between voltage and mechanics."""


@dataclass(frozen=True)
class Stand:
    """One record of all axes: a chain per axis up to the mechanics, and the positions (n + 1, axes) with a row in
    front, as chains have it."""

    role: Role
    source: str
    axes: tuple[str, ...]
    chains: tuple[Chain, ...]
    u_V: Samples
    """(n, axes)."""
    x_um: Samples
    rows: slice
    """Scored rows of ``x_um``."""
    step_s: float

    def pushes(self, entries: Entries) -> list[Signal]:
        """What each actuator gives to the mechanics."""
        return [chain.push(entries.get(axis, ())) for axis, chain in zip(self.axes, self.chains, strict=True)]

    def drive(self, entries: Entries) -> Drive:
        """Pushes and levels; the level of an actuator that does not soften is 0."""
        pushes = self.pushes(entries)
        push_um = np.stack([p.displacement_um for p in pushes], axis=1)
        softening = [next((q for e, q in entries.get(a, ()) if e.name == "softening"), None) for a in self.axes]
        level = None
        if any(q is not None for q in softening):
            still = np.zeros(len(push_um))
            levels = [still if q is None else push_level(p, q) for p, q in zip(pushes, softening, strict=True)]
            level = np.stack(levels, axis=1)
        return Drive(push_um, level, self.x_um, self.rows, self.step_s)

    @property
    def experiment(self) -> JointExperiment:
        """For the frequency response."""
        return JointExperiment(self.u_V, self.x_um[1:], slice(self.rows.start - 1, self.rows.stop - 1), self.step_s)

    @property
    def level_V(self) -> float:
        """Rms voltage over all axes where it is scored."""
        e = self.experiment
        return float(np.sqrt(np.mean(np.var(e.u_V[e.rows], axis=0))))

    @property
    def together(self) -> bool:
        """Whether more than one axis is driven where it is scored."""
        e = self.experiment
        return int(np.count_nonzero(np.ptp(e.u_V[e.rows], axis=0) > STILL_V)) > 1


def stands(models: Mapping[str, AxisModel], runs: Mapping[str, Sequence[Run]]) -> list[Stand] | None:
    """One per record, or None where a record lacks an axis. Adopted effects of the mechanics are left out."""
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
            Stand(
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


def _without_mechanics(model: AxisModel) -> AxisModel:
    return model.model_copy(update={"effects": tuple(e for e in model.effects if e.name not in OF_THE_MECHANICS)})


def response_groups(records: Sequence[Stand]) -> list[list[Stand]]:
    """Groups of one level each that hold as many records as there are axes; all records where there is no such."""
    enough = [group for group in level_groups(records) if len(group) >= len(group[0].axes)]
    return enough or [list(records)]


def level_groups(records: Sequence[Stand]) -> list[list[Stand]]:
    """Records of like level together, the strongest first."""
    groups: list[list[Stand]] = []
    for stand in sorted(records, key=lambda s: -s.level_V):
        if groups and groups[-1][0].level_V < LEVEL_RATIO * stand.level_V:
            groups[-1].append(stand)
        else:
            groups.append([stand])
    return groups
