"""Rivals of what was named in front of the modes: put in its place, does one predict the held-out records as well?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.posterior import confused
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.held_out import LEAST_Z, improvement
from phaselead.gap.several_axes.in_front import InFront, fitted_parameters
from phaselead.gap.several_axes.joint_records import JointRecord
from phaselead.gap.several_axes.other_effects import in_front_of_mechanics, score_other_effects, spread
from phaselead.identify import fit_modes
from phaselead.model import Effect
from phaselead.record import Samples

FIRST_SIZES = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Multiples of its typical size from which the fit of a rival may begin; the best of them counts."""
RIVAL_STEPS = 12
"""Most steps of the fit with a rival."""
PROMISING = 0.25
"""Share of the squares which softening saves that a rival of it must promise in the score test to be fitted."""


@dataclass(frozen=True)
class Tie:
    """Effects that predict the held-out records alike, the best first, and the fit with each of them."""

    names: tuple[str, ...]
    fits: tuple[CommonModes, ...]


def rivals_of(effect: Effect, fit: CommonModes, effects: Sequence[Effect], taken: Sequence[str]) -> list[Effect]:
    """The ``effects`` in front of the modes that the catalogue says may be taken for one, without those ``taken``.

    What modes absorb is no rival unless they are kept: it adds nothing to modes that are fitted.
    """
    return [
        e
        for e in in_front_of_mechanics(effects)
        if confused(e, effect) and (fit.modes_kept or not e.absorbed_by_modes) and e.name not in taken
    ]


def contest(
    train: Sequence[JointRecord],
    held_out: Sequence[JointRecord],
    linear: CommonModes,
    fit: CommonModes,
    effect: Effect,
    rivals: Sequence[Effect],
) -> tuple[CommonModes, Tie | None]:
    """The fit that predicts the held-out records best, with ``effect`` or with a rival in its place, and the tie where
    others predict them not significantly worse. ``linear`` are the modes without softening."""
    if effect.shared_modes == "level":
        rivals = _promising(train, linear, fit, rivals)
    candidates = [(effect.name, fit), *((r.name, _in_its_place(train, linear, fit, effect, r)) for r in rivals)]
    best = candidates[0]
    for other in candidates[1:]:
        if improvement(held_out, best[1].answer, other[1].answer).saved > 0:
            best = other
    others = [one for one in candidates if one is not best]
    alike = [one for one in others if improvement(held_out, one[1].answer, best[1].answer).z <= LEAST_Z]
    tied = [best, *alike]
    tie = Tie(tuple(name for name, _ in tied), tuple(one for _, one in tied)) if alike else None
    return best[1], tie


def _promising(
    train: Sequence[JointRecord], linear: CommonModes, fit: CommonModes, rivals: Sequence[Effect]
) -> list[Effect]:
    """The rivals of softening that a score test does not rule out."""
    if not rivals:
        return []
    needed = PROMISING * (1 - _left(train, fit) / _left(train, linear))
    scores = score_other_effects(train, linear, rivals)
    promised = {r.name: sum(one.share for one in scores if one.effect.name == r.name) for r in rivals}
    return [r for r in rivals if promised[r.name] >= needed]


def _left(train: Sequence[JointRecord], fit: CommonModes) -> float:
    """Squares that are left of the training records, each in units of its own output."""
    total = 0.0
    for record in train:
        x, error = record.x_um[record.rows], (record.x_um - fit.answer(record))[record.rows]
        total += float(np.sum((error - error.mean(axis=0)) ** 2) / np.sum((x - x.mean(axis=0)) ** 2))
    return total


def _in_its_place(
    train: Sequence[JointRecord], linear: CommonModes, fit: CommonModes, effect: Effect, rival: Effect
) -> CommonModes:
    """The fit with the rival in place of an effect, modes and everything else in front of them fitted again."""
    softening = effect.shared_modes == "level"
    was, begin = fit.front, linear if softening else fit
    assert was is not None
    others = [rival, *was.others] if softening else [rival if e.name == effect.name else e for e in was.others]
    front = replace(was, others=tuple(others), softens=was.softens and not softening)
    values = _first_values(train, begin, front, _kept_rows(was, fit.fit.values), rival)
    found = fit_modes(
        begin.model.poles,
        front.shaping(train, values),
        shift=begin.fit.shift,
        split=begin.split,
        most_steps=RIVAL_STEPS,
        weights=fit.fit.weights,
        held=begin.held,
    )
    kept = (None, None) if softening else (fit.taus_s, fit.exponents)
    return replace(
        begin, fit=found, front=front, entries=front.entries(found.values.tolist()), taus_s=kept[0], exponents=kept[1]
    )


def _kept_rows(front: InFront, values: Samples) -> dict[tuple[str, str], Samples]:
    """Values (axes,) by effect and parameter."""
    keys = [(e.name, p.name) for e in front.effects for p in fitted_parameters(e)]
    return dict(zip(keys, values.reshape(-1, len(front.axes)), strict=True))


def _first_values(
    train: Sequence[JointRecord],
    begin: CommonModes,
    front: InFront,
    known: dict[tuple[str, str], Samples],
    rival: Effect,
) -> Samples:
    """Values to begin from: what stays as it was, the rival of the size that leaves least of a few records."""
    few = spread(train)

    def values(size: float) -> Samples:
        rows = []
        for e in front.effects:
            for i, p in enumerate(fitted_parameters(e)):
                first = np.full(len(front.axes), p.typical * (size if i == 0 else 1.0))
                rows.append(known.get((e.name, p.name), first) if e.name != rival.name else first)
        return np.concatenate(rows)

    size = rival.sizes[0]
    tried = {m: values(m) for m in FIRST_SIZES if size.low <= m * size.typical <= size.high}

    def left(at: Samples) -> float:
        shaping = front.shaping(few, at)
        fit = fit_modes(
            begin.model.poles, shaping, shift=begin.fit.shift, split=begin.split, most_steps=0, held=begin.held,
            weights=np.array([1 / max(float(np.sum(np.var(r.x_um[r.rows], axis=0))), 1e-30) for r in few]),
        )  # fmt: skip
        return fit.squares

    return min(tried.values(), key=left)
