"""The search from the bare base to the last effect that pays: forward selection one by one, then pruning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phaselead.gap.acceptance import (
    ALIKE_SHARE,
    OPERATOR_SHARE,
    HeldOutScore,
    Named,
    held_out_score,
    pays_for_a_name,
    why_not_named,
)
from phaselead.gap.base_operator import with_operator
from phaselead.gap.comparison import MARGIN, Comparison, compare
from phaselead.gap.findings import NAMED, Candidate, Estimate
from phaselead.gap.problem import Problem, common_with_effects, make_problem, with_effects
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted, refit, with_total
from phaselead.gap.scan import ScannedShape, penalty, refit_best, scan
from phaselead.model import AxisModel, Effect

MOST_EFFECTS = 5
"""Steps of the search: the trials hide three effects at most."""
TRIES_PER_STEP = 2
"""How many effects may fail on held-out records before a step is given up."""
CLEAR_ON_ONE_LOOP = 50.0
"""Score from which an effect is told from others although all records go round one loop."""

Progress = Callable[[float], None]
"""Takes the share that is done, 0 to 1."""


@dataclass
class Selection:
    """Where the search of one axis ended."""

    problem: Problem
    """As it is with the effects that were named."""
    start: AxisModel
    """The base as given."""
    fitted: Fitted
    named: list[Named] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)
    """Every effect that was compared, step by step, named or not."""
    last_scan: list[list[ScannedShape]] = field(default_factory=list)
    inflation: float = 1.0
    """By how much more than white noise the residual scattered along what was named last."""
    messages: list[str] = field(default_factory=list)
    """For a person."""
    substitute: str | None = None
    """An effect that was kept out of this search, because in the first one it explained most in the place of several.
   """
    estimates: dict[str, dict[str, Estimate]] | None = None
    """Value, unit and interval of every parameter by effect, where they come from the posterior."""
    probability: dict[str, float] | None = None
    """Of each effect, where it comes from the posterior."""
    operator: dict[str, float] | None = None
    """Parameters of the effect that the base took up as plays of its own, where it had none."""


@dataclass(frozen=True)
class _Inputs:
    """What a search is made with again when the base changes."""

    runs: Sequence[GapRun]
    effects: Sequence[Effect]
    frozen: bool


def select_effects(
    axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], frozen: bool, on_progress: Progress
) -> Selection:
    """Name effects of ``effects`` one after the other until none pays. The base ``axis`` has a time view.

    ``frozen``: without reference runs, whether nothing may be wrong with the base. A base without plays is given its
    memory first, where that explains most.
    """
    given = _Inputs(runs, effects, frozen)
    view = axis.time
    assert view is not None
    made = make_problem(axis, runs, effects, frozen, unwhitened=not view.play_r_V)
    selection = Selection(made, axis, refit(made.train_common, made.discrepancy, []))
    if not view.play_r_V and not _gave_memory(selection, given):
        made = make_problem(axis, runs, effects, frozen)
        selection.problem, selection.fitted = made, refit(made.train_common, made.discrepancy, [])
    for step in range(MOST_EFFECTS):
        on_progress((step + 1) / (MOST_EFFECTS + 1))
        taken = {name for n in selection.named for name in n.tied}
        left = [e for e in effects if e.name not in taken]
        selection.last_scan = scan(selection.problem, selection.fitted, left)
        if not _named_one(selection, given, left, step + 1):
            break
    _prune(selection)
    return selection


def without_names(selection: Selection) -> Selection:
    """The search with its names withdrawn, where they leave too much: the nearest of the catalogue is not the
    effect."""
    bare = with_effects(selection.problem, [])
    names = " and ".join(n.effect.name for n in selection.named)
    said = f"{names} would come nearest, but leaves too much of what is new since the reference to be it"
    return replace(
        selection,
        problem=bare,
        fitted=refit(bare.train_common, bare.discrepancy, []),
        named=[],
        candidates=[
            replace(c, remark="nearest, but leaves too much") if c.remark == NAMED else c for c in selection.candidates
        ],
        messages=[*selection.messages, said],
    )


def _gave_memory(selection: Selection, given: _Inputs) -> bool:
    """Give a base without plays its memory, if that explains most of the unwhitened residual; whether it was done."""
    selection.last_scan = scan(selection.problem, selection.fitted, given.effects)
    tried = refit_best(selection.problem, selection.fitted, selection.last_scan)
    if not tried:
        return False
    found = compare(selection.problem, selection.fitted, tried)
    held = _held_out_score(found)
    pays = found.best.effect.becomes_plays and pays_for_a_name(found, held, len(given.effects))
    if pays:
        _note(selection, found, held, 0, pays)
        _accept(selection, found, held, given)
    return pays


def _named_one(selection: Selection, given: _Inputs, left: Sequence[Effect], step: int) -> bool:
    """Name one more of the effects ``left``, if one pays; whether one was named."""
    tried = refit_best(selection.problem, selection.fitted, selection.last_scan)
    for _ in range(TRIES_PER_STEP):
        if not tried:
            return False
        found = compare(selection.problem, selection.fitted, tried)
        held = _held_out_score(found)
        pays = pays_for_a_name(found, held, len(left), selection.named)
        _note(selection, found, held, step, pays)
        if pays:
            _accept(selection, found, held, given)
            return True
        if found.best.score < MARGIN:
            return False
        tried = [t for t in tried if t.effect is not found.best.effect]
    return False


def _held_out_score(found: Comparison) -> HeldOutScore:
    """Of the best effect of a comparison."""
    least = found.problem.reference_inflation.get(found.best.effect.name, 1.0)
    return held_out_score(found.problem, found.before.entries, found.best.fitted.entries, least)


def _accept(selection: Selection, found: Comparison, held: HeldOutScore, given: _Inputs) -> None:
    """Name the best effect of a comparison: it joins the model, or the base takes it up as plays of its own."""
    best = found.best
    tied = (*(r.effect.name for r in found.tied()), *_uncompared(selection, found, given.effects))
    view = selection.problem.axis.time
    assert view is not None
    becomes_plays = best.effect.becomes_plays and not view.play_r_V
    alike_share = OPERATOR_SHARE if becomes_plays else ALIKE_SHARE
    rivals = tuple(replace(r, fitted=with_total(found.problem.train_common, r.fitted)) for r in found.rivals)
    selection.named.append(Named(best.effect, best.score, held, rivals, tied, alike_share))
    selection.inflation = found.inflation
    if not becomes_plays:
        selection.problem = with_effects(found.problem, best.fitted.entries)
        selection.fitted = refit(selection.problem.train_common, selection.problem.discrepancy, best.fitted.entries)
        return
    # A base without plays gets a whole operator, not the catalogue's compact one.
    selection.operator = dict(best.fitted.entries[-1][1])
    axis = with_operator(selection.problem.axis, [r for r in given.runs if r.role == "train"])
    selection.problem = make_problem(axis, given.runs, given.effects, given.frozen, open_plays=True)
    others = list(best.fitted.entries[:-1])
    selection.fitted = refit(selection.problem.train_common, selection.problem.discrepancy, others)


def _uncompared(selection: Selection, found: Comparison, effects: Sequence[Effect]) -> list[str]:
    """Names of effects that were not compared with the best but are confused with it, where all records go round one
    loop and little is gained: one loop does not rule them out."""
    best = found.best.effect
    if not found.one_loop or found.best.score > CLEAR_ON_ONE_LOOP:
        return []
    compared = {r.effect.name for r in found.rivals}
    shown = {shapes[0].effect.name for shapes in selection.last_scan}
    near = [e for e in effects if e.name in best.confused_with or best.name in e.confused_with]
    return [e.name for e in near if e.name in shown - compared]


def _prune(selection: Selection) -> None:
    """Drop names that no longer pay beside the others. What the base can absorb is then simulated without the effect:
    simulated with it, the base's own columns carry some of it."""
    fitted = {effect.name for effect, _ in selection.fitted.entries}
    for name in [n.effect.name for n in selection.named if n.effect.name in fitted]:
        entries = [entry for entry in selection.fitted.entries if entry[0].name != name]
        if not entries:
            return
        without = refit(common_with_effects(selection.problem, entries), selection.problem.discrepancy, entries)
        effect = next(n.effect for n in selection.named if n.effect.name == name)
        gained = (without.squares - selection.fitted.squares) / selection.inflation - penalty(selection.problem, effect)
        if gained < MARGIN:
            selection.problem = with_effects(selection.problem, without.entries)
            selection.fitted = refit(selection.problem.train_common, selection.problem.discrepancy, without.entries)
            selection.named = [n for n in selection.named if n.effect.name != name]


def _note(selection: Selection, found: Comparison, held: HeldOutScore, step: int, pays: bool) -> None:
    """Write down how every effect of a comparison did, for the table of candidates."""
    rows = found.problem.train_common.metric.rows
    for rival in found.rivals:
        best = rival is found.best
        if best:
            remark = NAMED if pays else why_not_named(found, held, selection.named)
        elif found.is_tied(rival):
            remark = f"these records cannot tell it from {found.best.effect.name}"
        else:
            remark = f"{found.best.score - rival.score:.0f} points behind {found.best.effect.name}"
        rms = float(np.sqrt(rival.fitted.squares / rows))
        z = held.z if best else float("nan")
        selection.candidates.append(Candidate(step, rival.effect.name, rival.score, z, rms, remark))
