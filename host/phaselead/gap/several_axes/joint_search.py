"""From records in which the axes of a stage move together to named effects: shared modes, coupling and softening.

The search of a single axis cannot use such records: cross-talk through a common structure is as large as an axis' own
path. Here the frequency response matrix gives the modes that all axes share. These become a resonance and a
cross-coupling of every axis; records of several levels show whether the modes soften; and a score test of the rest of
the catalogue shows what else there could be. Every name must improve the prediction of the held-out records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.gap.axis import AxisResult
from phaselead.gap.effect_search import Progress
from phaselead.gap.records import GapRun, Role
from phaselead.gap.several_axes.base_modes import has_common_modes, modes_as_they_are
from phaselead.gap.several_axes.common_modes import CommonModes, fit_linear, fit_softening
from phaselead.gap.several_axes.held_out import HeldOutPrediction, Improvement, improvement, predict_held_out
from phaselead.gap.several_axes.joint_records import (
    JointRecord,
    effect_of,
    joint_records,
    level_groups,
    response_groups,
)
from phaselead.gap.several_axes.next_record import propose_together
from phaselead.gap.several_axes.other_effects import score_other_effects
from phaselead.gap.several_axes.results import StageFit, axis_results, named_in_front
from phaselead.gap.several_axes.rivals import contest, rivals_of
from phaselead.identify import frequency_response
from phaselead.model import AxisModel, Effect, Stage, catalogue
from phaselead.record import Recording

LEAST_ERROR = 0.1
"""Share of the output's power below which a stage without shared modes needs none."""
KNOWN_ERROR = 0.5
"""Error on reference records, as a share of that on held-out ones, from which on nothing new is missing."""
LOWEST_LINES = 8
"""Of the frequency response, whose mean stands for the static gain."""
NOTHING_TO_FREEZE = (
    "--frozen: the model has no modes that its axes share, and modes fitted to axes that move together carry its "
    "static gains: give --refit, then freeze what that makes"
)


def search_together(
    stage: Stage,
    runs: Mapping[str, Sequence[GapRun]],
    holdout: Sequence[Recording],
    reference: Sequence[Recording],
    effects: Sequence[Effect],
    frozen: bool | None,
    report: Progress,
) -> list[AxisResult] | None:
    """One result per axis, which bears its name, or None where the axes do not move together or nothing is missing
    that they share.

    ``effects`` may be named; ``frozen``: whether the modes of the stage stay as they are, by default where there are
    reference records; ``report`` is called with the share of the work that is done. Raises BadInput for a stage that is
    to be kept but has no modes that its axes share.
    """
    names = {e.name for e in effects}
    records = _moving_together(stage, runs)
    if records is None or not {effect_of("own path").name, effect_of("coupling").name} <= names:
        return None
    before = predict_held_out(stage, holdout, list(runs))
    if not _lacks_modes(stage, before, reference):
        return None
    if frozen and not has_common_modes(stage):
        raise BadInput(NOTHING_TO_FREEZE)
    kept = has_common_modes(stage) and (bool(reference) if frozen is None else frozen)
    axes = {a: stage.axes[a] for a in runs}
    models = axes if kept else _with_static_gains(stage, _of(records, "train"))
    if models is None:
        return None
    records = joint_records(models, runs)
    assert records is not None  # the same runs gave records of the stage
    train, held_out = _of(records, "train"), _of(records, "holdout")
    if kept:
        strongest = linear = modes_as_they_are(stage, train)
    else:
        strongest, linear = fit_linear(train, lambda share: report(0.35 * share))
    softened = None
    beside = [e for e in effects if e.fitted_with_modes and not _has(axes, e)]
    soften = effect_of("level").name in names and not linear.given
    if (soften or (linear.given and beside)) and len(level_groups(train)) > 1:
        softened = fit_softening(train, strongest, beside, lambda share: report(0.35 + 0.5 * share))
    modes, softening = _better(linear, softened, held_out)
    others = score_other_effects(train, modes, effects)
    report(0.95)
    allowed = tuple(e.name for e in effects)
    findings = StageFit(stage, models, modes, softening, others, before, train, held_out, allowed)
    findings = _with_rivals(findings, linear, effects)
    results = axis_results(findings, runs, holdout, propose_together(findings))
    return [result.labelled() for result in results]


def _with_rivals(found: StageFit, linear: CommonModes, effects: Sequence[Effect]) -> StageFit:
    """What was found after what was named in front of the modes has met its rivals."""
    fit, ties = found.fit, []
    for effect in [catalogue()[name] for name in named_in_front(found)]:
        untried = [e for e in effects if not _has(found.models, e)]
        taken = [e.name for e in fit.front.effects] if fit.front is not None else []
        fit, tie = contest(found.train, found.held_out, linear, fit, effect, rivals_of(effect, fit, untried, taken))
        ties += [tie] if tie is not None else []
    if fit is found.fit:
        return replace(found, ties=ties)
    return replace(found, fit=fit, ties=ties, others=score_other_effects(found.train, fit, effects))


def _has(axes: Mapping[str, AxisModel], effect: Effect) -> bool:
    """Whether an axis has adopted the effect, which then stays as it is."""
    return any(e.name == effect.name for axis in axes.values() for e in axis.effects)


def _moving_together(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> list[JointRecord] | None:
    """The records of all axes; None where there is one axis only, or one axis is driven at a time."""
    records = joint_records({a: stage.axes[a] for a in runs}, runs) if len(runs) > 1 else None
    if records is None or not all(r.together for r in records if r.role != "reference"):
        return None
    return records


def _lacks_modes(stage: Stage, before: HeldOutPrediction, reference: Sequence[Recording]) -> bool:
    """Whether the error on held-out records calls for shared modes, and is not the same on reference records."""
    if not has_common_modes(stage) and before.share_left < LEAST_ERROR:
        return False
    axes = list(before.model_um)
    return not reference or predict_held_out(stage, reference, axes).share_left <= KNOWN_ERROR * before.share_left


def _of(records: Sequence[JointRecord], role: Role) -> list[JointRecord]:
    """The records of one role."""
    return [r for r in records if r.role == role]


def _better(
    linear: CommonModes, softened: CommonModes | None, held_out: Sequence[JointRecord]
) -> tuple[CommonModes, Improvement | None]:
    """The softened modes where they predict the held-out records better, and by how much; else the linear ones."""
    if softened is None:
        return linear, None
    gained = improvement(held_out, linear.answer, softened.answer)
    return (softened, gained) if gained.pays else (linear, gained)


def _with_static_gains(stage: Stage, train: Sequence[JointRecord]) -> dict[str, AxisModel] | None:
    """The axes; those that are straight lines have the gain of the lowest lines of the frequency response.

    A line fitted to axes that move together takes its sign from whatever resonates. None where the records give no
    frequency response.
    """
    axes = train[0].axes
    try:
        response = frequency_response([r.experiment for r in response_groups(train)[0]])
    except BadInput:
        return None
    static = response.matrix[:LOWEST_LINES].real.mean(axis=0)
    models = {}
    for i, axis in enumerate(axes):
        model = stage.axes[axis]
        view = model.time
        assert view is not None
        straight = not (view.play_r_V or view.deadzone_d_V)
        if straight and not has_common_modes(stage) and abs(static[i, i]) > 0:
            model = model.model_copy(update={"time": view.model_copy(update={"gain_um_per_V": float(static[i, i])})})
        models[axis] = model
    return models
