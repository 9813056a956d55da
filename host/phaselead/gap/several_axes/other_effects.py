"""Score test of the rest of the catalogue, in front of the modes that the axes share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from phaselead.gap.regressors import RegressorGroup, regressor_groups
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.joint_records import JointRecord
from phaselead.identify import score_test
from phaselead.model import Effect
from phaselead.record import Samples

MOST_RECORDS = 4
"""That the test uses, spread over all levels."""
MOST_SHAPES = 3
"""Of each effect, spread over its shapes."""


@dataclass(frozen=True)
class EffectScore:
    """One effect on one axis at its best shape. ``amount`` and ``std`` are of its size, in ``unit``."""

    effect: Effect
    axis: str
    amount: float
    std: float
    share: float
    """Of the remaining squares, that the effect would explain."""
    unit: str


def in_front_of_mechanics(effects: Sequence[Effect]) -> list[Effect]:
    """Effects between voltage and mechanics that a voltage predicts."""
    return [e for e in effects if e.kind == "response" and e.shared_modes is None and e.before_modes]


def score_other_effects(train: Sequence[JointRecord], fit: CommonModes, effects: Sequence[Effect]) -> list[EffectScore]:
    """Score of every effect on every axis, best first. Those that the modes can imitate are left out, unless the modes
    are kept."""
    records = spread(train)
    weights = np.array([w for s, w in zip(train, fit.fit.weights, strict=True) if s in records])
    longest_s = max(len(record.x_um) * record.step_s for record in records)
    groups = _few(regressor_groups(in_front_of_mechanics(effects), records[0].step_s, longest_s))
    columns = [
        (group, i, j) for group, j in product(groups, range(len(records[0].axes))) for i in range(len(group.steps))
    ]
    if not columns:
        return []
    drives = [record.drive(fit.entries) for record in records]
    found = score_test(
        fit.fit,
        fit.split,
        drives,
        weights,
        lambda d: _changes(records[d], fit, columns),
        len(columns),
        held=fit.modes_kept,
    )
    best: dict[tuple[str, int], EffectScore] = {}
    for (group, i, j), amount, std, share in zip(columns, found.amounts, found.std, found.share, strict=True):
        key = (group.effect.name, j)
        if np.isfinite(std) and (key not in best or share > best[key].share):
            size, step = group.effect.sizes[i], group.steps[i]
            best[key] = EffectScore(group.effect, records[0].axes[j], amount * step, std * step, share, size.unit)
    return sorted(best.values(), key=lambda s: -s.share)


def spread(train: Sequence[JointRecord]) -> list[JointRecord]:
    """A few records over all levels."""
    ranked = sorted(train, key=lambda s: s.level_V)
    chosen = np.unique(np.linspace(0, len(ranked) - 1, min(MOST_RECORDS, len(ranked))).round().astype(int))
    keep = [ranked[i] for i in chosen]
    return [s for s in train if any(s is k for k in keep)]


def _few(groups: Sequence[RegressorGroup]) -> list[RegressorGroup]:
    """At most MOST_SHAPES of each effect, spread over its shapes."""
    by_name: dict[str, list[RegressorGroup]] = {}
    for group in groups:
        by_name.setdefault(group.effect.name, []).append(group)
    found = []
    for shapes in by_name.values():
        chosen = np.unique(np.linspace(0, len(shapes) - 1, min(MOST_SHAPES, len(shapes))).round().astype(int))
        found += [shapes[i] for i in chosen]
    return found


def _changes(
    record: JointRecord, fit: CommonModes, columns: Sequence[tuple[RegressorGroup, int, int]]
) -> list[Samples]:
    """For each column, what one step of the effect does to the signals at the mechanics (n + 1, axes) in um."""
    plain = [push.value for push in record.pushes(fit.entries)]
    found = []
    for group, i, j in columns:
        amounts = [float(i == k) for k in range(len(group.steps))]
        extra = [*fit.entries.get(record.axes[j], ()), (group.effect, group.params(amounts))]
        change = np.zeros((len(plain[j]), len(plain)))
        change[:, j] = record.chains[j].push(extra).value - plain[j]
        found.append(change)
    return found
