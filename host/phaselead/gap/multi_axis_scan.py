"""What the rest of the catalogue would add to the pushes of a stage with common modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from phaselead.gap.atoms import Atom, atoms_of
from phaselead.gap.multi_axis_fit import SharedFit
from phaselead.gap.multi_axis_records import OF_THE_MECHANICS, Stand
from phaselead.identify import score_test
from phaselead.model import Effect, Place
from phaselead.record import Samples

MOST_RECORDS = 4
MOST_SHAPES = 3


@dataclass(frozen=True)
class Scanned:
    """One effect on one axis at its best shape: amount of the size that stands for it, in its unit."""

    effect: Effect
    axis: str
    shapes: dict[str, float]
    amount: float
    std: float
    share: float
    """Of the squares that the model leaves."""
    unit: str


def pushed(effects: Sequence[Effect]) -> list[Effect]:
    """Effects between voltage and mechanics that a voltage predicts."""
    return [
        e
        for e in effects
        if e.kind == "response"
        and e.name not in OF_THE_MECHANICS
        and (e.place < Place.MECHANICS or (e.place == Place.MECHANICS and e.order < 1))
    ]


def scan(train: Sequence[Stand], fit: SharedFit, effects: Sequence[Effect]) -> list[Scanned]:
    """Every effect on every axis by score test, best first; those that the modes take up are left out."""
    records = _spread(train)
    weights = np.array([w for s, w in zip(train, fit.fit.weights, strict=True) if s in records])
    atoms = _few(atoms_of(pushed(effects), records[0].step_s, _longest_s(records)))
    columns = [(atom, i, j) for atom, j in product(atoms, range(len(records[0].axes))) for i in range(len(atom.steps))]
    if not columns:
        return []
    drives = [stand.drive(fit.entries) for stand in records]
    found = score_test(fit.fit, fit.split, drives, weights, lambda d: _changes(records[d], fit, columns), len(columns))
    best: dict[tuple[str, int], Scanned] = {}
    for (atom, i, j), amount, std, share in zip(columns, found.amounts, found.std, found.share, strict=True):
        key = (atom.effect.name, j)
        if np.isfinite(std) and (key not in best or share > best[key].share):
            size, step = atom.effect.sizes[i], atom.steps[i]
            best[key] = Scanned(
                atom.effect, records[0].axes[j], dict(atom.shapes), amount * step, std * abs(step), share, size.unit
            )
    return sorted(best.values(), key=lambda s: -s.share)


def _spread(train: Sequence[Stand]) -> list[Stand]:
    """A few records over all levels."""
    ranked = sorted(train, key=lambda s: s.level_V)
    chosen = np.unique(np.linspace(0, len(ranked) - 1, min(MOST_RECORDS, len(ranked))).round().astype(int))
    keep = [ranked[i] for i in chosen]
    return [s for s in train if any(s is k for k in keep)]


def _few(atoms: Sequence[Atom]) -> list[Atom]:
    """At most MOST_SHAPES of each effect, spread over its shapes."""
    by_name: dict[str, list[Atom]] = {}
    for atom in atoms:
        by_name.setdefault(atom.effect.name, []).append(atom)
    found = []
    for shapes in by_name.values():
        chosen = np.unique(np.linspace(0, len(shapes) - 1, min(MOST_SHAPES, len(shapes))).round().astype(int))
        found += [shapes[i] for i in chosen]
    return found


def _longest_s(records: Sequence[Stand]) -> float:
    return max(len(s.x_um) * s.step_s for s in records)


def _changes(stand: Stand, fit: SharedFit, columns: Sequence[tuple[Atom, int, int]]) -> list[Samples]:
    """Per column what one step of the effect does to the pushes (n + 1, axes)."""
    plain = [push.value for push in stand.pushes(fit.entries)]
    found = []
    for atom, i, j in columns:
        amounts = [float(i == k) for k in range(len(atom.steps))]
        extra = [*fit.entries.get(stand.axes[j], ()), (atom.effect, atom.params(amounts))]
        change = np.zeros((len(plain[j]), len(plain)))
        change[:, j] = stand.chains[j].push(extra).value - plain[j]
        found.append(change)
    return found
