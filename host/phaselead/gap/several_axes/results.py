"""What a fit of shared modes found, axis by axis, as the gap workflow reports it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from phaselead.gap.axis import AxisResult
from phaselead.gap.error_rates import ONE_SIDED_95
from phaselead.gap.findings import (
    NAMED,
    PROVISIONAL,
    Adopted,
    Bound,
    Candidate,
    Cell,
    Estimate,
    Estimates,
    GapSize,
    NamedEffect,
    NextExperiment,
    Trace,
)
from phaselead.gap.goodness_of_fit import excused_um2, more_than_equations_miss
from phaselead.gap.locate import rank_cells
from phaselead.gap.noise import fit_noise
from phaselead.gap.records import GapRun
from phaselead.gap.residual import RunResidual
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.held_out import (
    LEAST_SAVED,
    HeldOutPrediction,
    Improvement,
    improvement,
    noise_um,
    predict_held_out,
)
from phaselead.gap.several_axes.joint_records import JointRecord, effect_of
from phaselead.gap.several_axes.other_effects import EffectScore
from phaselead.gap.several_axes.rivals import Tie
from phaselead.gap.several_axes.stage_effects import (
    adopted_axis,
    coupling_params,
    own_gains,
    params_in_front,
    resonance_params,
)
from phaselead.gap.unexplained import Unexplained, unexplained
from phaselead.model import AxisModel, Effect, Entry, Params, Stage, catalogue
from phaselead.record import Recording, Samples

ABSORBED = "modes that are fitted to axes moving together absorb it"
ONE_LEVEL = "all training records have one level of drive; add records at another level"
KEPT = "kept as the model has them, with its gains, coupling and softening"
NOT_LOOKED_FOR = "not looked for in records in which several axes move at once; drive one axis at a time"


@dataclass(frozen=True)
class StageFit:
    """Everything that the search has found out about the stage."""

    stage: Stage
    models: Mapping[str, AxisModel]
    """The axes as the modes were fitted to them."""
    fit: CommonModes
    softening: Improvement | None
    """What softening saves on the held-out records; None where the records have one level."""
    others: Sequence[EffectScore]
    before: HeldOutPrediction
    train: Sequence[JointRecord]
    held_out: Sequence[JointRecord]
    names: tuple[str, ...]
    """Of the effects that may be named."""
    ties: Sequence[Tie] = ()
    """Effects in front of the modes that the records cannot tell apart."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes, in the order of every array."""
        return self.train[0].axes

    @property
    def softens(self) -> bool:
        """Whether softening was adopted, or what was put in its place."""
        return self.softening is not None and self.softening.pays

    @property
    def exponent_open(self) -> bool:
        """Whether the levels of the training records leave the power of the level open by which softening grows."""
        power = effect_of("level").parameter("exponent")
        return self.softens and self.fit.exponents == (power.low, power.high)

    @property
    def tied(self) -> set[str]:
        """Names of what is in a tie."""
        return {name for tie in self.ties for name in tie.names}

    @property
    def in_front(self) -> list[str]:
        """Names of what was adopted between the voltage and the modes, softening first."""
        return [e.name for e in self.fit.front.effects] if self.softens and self.fit.front is not None else []

    def had(self, axis: int) -> set[str]:
        """Names of the effects that an axis of the stage had."""
        return {e.name for e in self.stage.axes[self.axes[axis]].effects}

    def without(self, name: str, axis: int) -> CommonModes:
        """The fit with one effect taken out at one axis; softening is taken out at all."""
        model, inputs = self.fit.model, self.fit.model.inputs
        part = catalogue()[name].shared_modes
        if part is None or part == "level":
            of_axes = self.axes if part == "level" else (self.axes[axis],)
            none = {a: [_taken_out(e, p, name, a in of_axes) for e, p in ep] for a, ep in self.fit.entries.items()}
            kept = model if part != "level" else replace(model, drop=None)
            return replace(self.fit, entries=none, fit=replace(self.fit.fit, model=kept))
        weights = model.weights.copy()
        if part == "own path":
            weights[_columns(inputs, axis, len(model.poles)), axis] = 0.0
            weights[axis, axis] = model.static[axis, axis]
        else:
            for j in range(inputs):
                if j != axis:
                    weights[_columns(inputs, j, len(model.poles)), axis] = 0.0
                    weights[j, axis] = 0.0
        return replace(self.fit, fit=replace(self.fit.fit, model=replace(model, weights=weights)))


def _taken_out(effect: Effect, params: Params, name: str, here: bool) -> Entry:
    """An effect of an axis, of size 0 if it is the one of that name and acts here."""
    gone = here and effect.name == name
    return effect, {**params, **{p.name: 0.0 for p in effect.sizes}} if gone else params


def _columns(inputs: int, axis: int, modes: int) -> slice:
    """Rows of the weights that belong to the states of one actuator."""
    return slice(inputs + 2 * modes * axis, inputs + 2 * modes * (axis + 1))


def axis_results(
    found: StageFit,
    runs: Mapping[str, Sequence[GapRun]],
    holdout: Sequence[Recording],
    proposal: NextExperiment | None,
) -> list[AxisResult]:
    """One result per axis; messages about the whole stage, its ties and the experiment for them go with the first."""
    gains = [None] * len(found.axes) if found.fit.modes_kept else own_gains(found.fit).tolist()
    effects = [_effects(found, i) for i in range(len(found.axes))]
    named = [_named(found, i, of_axis) for i, of_axis in enumerate(effects)]
    unsure = [_not_vouched_for(found, i, of_axis) for i, of_axis in enumerate(named)]
    adopted = {
        a: adopted_axis(found.models[a], gains[i], _adopted(found, i, effects[i], named[i]), set(unsure[i]))
        for i, a in enumerate(found.axes)
    }
    after = predict_held_out(
        found.stage.model_copy(update={"axes": {**found.stage.axes, **adopted}}), holdout, found.axes
    )
    messages = _messages(found, after)
    ties = [tie.names for tie in found.ties]
    results = []
    for i, a in enumerate(found.axes):
        gap = _gap(found, after, i)
        taken = {*(one.name for one in named[i]), *unsure[i], *found.had(i), *found.tied}
        excluded = _excluded(found, a, taken)
        untestable = _untestable(found, taken | {b.name for b in excluded})
        left = gap.after**2 - gap.floor**2
        held_out = [run for run in runs[a] if run.role == "holdout"]
        predictable = _predictable(found, runs[a], i)
        of_fit = replace(gap, after=math.sqrt(_power_um2(found.held_out, found.fit, i)))
        excused = excused_um2(of_fit) if named[i] else 0.0
        unexcused = more_than_equations_miss(predictable, of_fit, excused)
        predictable = replace(predictable, of_equations=predictable.something_missing and not unexcused)
        missing = left > LEAST_SAVED * gap.before**2 or unexcused
        results.append(
            AxisResult(
                axis=a,
                model=adopted[a],
                effects=named[i],
                ties=ties if i == 0 else [],
                unknown=missing,
                excluded=excluded,
                untestable=untestable,
                where=_where(found, held_out, a),
                gap=gap,
                rows=sum(run.stop - run.start for run in held_out),
                next_experiment=proposal if i == 0 else None,
                candidates=_candidates(found, a),
                traces=_traces(found, after, held_out, a),
                messages=messages if i == 0 else [],
                adopted=[
                    *(Adopted(one.name, NAMED) for one in named[i]),
                    *(Adopted(name, PROVISIONAL) for name in unsure[i]),
                ],
                unexplained=predictable,
            )
        )
    return results


def _predictable(found: StageFit, runs: Sequence[GapRun], axis: int) -> Unexplained:
    """How much of what the fit leaves on one axis can be predicted from the voltages."""

    def left(role: str, records: Sequence[JointRecord]) -> list[RunResidual]:
        of_role = [run for run in runs if run.role == role]
        errors = [_error(record, found.fit, axis) for record in records]
        return [RunResidual(run, error) for run, error in zip(of_role, errors, strict=True)]

    return unexplained(left("train", found.train), left("holdout", found.held_out))


def _named(found: StageFit, axis: int, effects: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Effects that the stage lacked and that improve the held-out records, largest share first; none of a tie."""
    known = found.had(axis) | found.tied
    return sorted((one for one in effects if one.share > 0 and one.name not in known), key=lambda one: -one.share)


def _adopted(
    found: StageFit, axis: int, effects: Sequence[NamedEffect], named: Sequence[NamedEffect]
) -> list[NamedEffect]:
    """The named effects, those that the stage had, with their new values unless they are kept, and what the modes were
    fitted behind."""
    known = set() if found.fit.modes_kept else found.had(axis)
    names = {*(one.name for one in named), *known, *found.in_front}
    return [one for one in effects if one.name in names]


def _effects(found: StageFit, axis: int) -> list[NamedEffect]:
    """Every effect of the fit on one axis, with share 0 where it does not improve the held-out records."""
    params: dict[str, Mapping[str, Estimate | Estimates]] = {
        effect_of("own path").name: resonance_params(found.fit, axis),
        effect_of("coupling").name: coupling_params(found.fit, axis, found.axes),
    }
    if found.softens:
        params |= params_in_front(found.fit, axis)
    result = []
    for name, values in params.items():
        without = found.without(name, axis)
        gained = improvement(found.held_out, without.answer, found.fit.answer, axis)
        share = _share(found, without, axis) if gained.pays else 0.0
        growth = 1 / np.sqrt(max(1 - gained.saved, 1e-9))
        why = f"without it the held-out error grows {growth:.3g}-fold (z = {gained.z:.1f})"
        result.append(NamedEffect(name, values, share, why, _probability(gained.z)))
    return result


def _share(found: StageFit, without: CommonModes, axis: int) -> float:
    """Share of the power before that comes back without the effect."""
    before = found.before.rms(found.axes[axis]) ** 2
    lost = _power_um2(found.held_out, without, axis) - _power_um2(found.held_out, found.fit, axis)
    return float(np.clip(lost / max(before, 1e-30), 0.0, 1.0))


def _power_um2(records: Sequence[JointRecord], fit: CommonModes, axis: int) -> float:
    """Power that a fit leaves of an axis, mean over records."""
    return float(np.mean([np.mean(_error(record, fit, axis) ** 2) for record in records]))


def _error(record: JointRecord, fit: CommonModes, axis: int) -> Samples:
    error = (record.x_um - fit.answer(record))[record.rows, axis]
    return np.asarray(error - error.mean())


def _gap(found: StageFit, after: HeldOutPrediction, axis: int) -> GapSize:
    name = found.axes[axis]
    left = after.rms(name)
    noise = noise_um(found.held_out, axis)
    if noise is not None:
        return GapSize.below(found.before.rms(name), left, noise, "what does not repeat from period to period")
    train = math.sqrt(_power_um2(found.train, found.fit, axis))
    return GapSize.below(found.before.rms(name), left, train, "what the modes leave of the training records")


def _excluded(found: StageFit, axis: str, taken: set[str]) -> list[Bound]:
    """Largest size of each effect in front of the mechanics that the records still allow."""
    return [
        Bound(one.effect.name, abs(one.amount) + ONE_SIDED_95 * one.std, one.unit)
        for one in found.others
        if one.axis == axis
        and one.effect.name not in taken
        and (found.fit.modes_kept or not one.effect.absorbed_by_modes)
    ]


def _not_vouched_for(found: StageFit, axis: int, named: Sequence[NamedEffect]) -> list[str]:
    """The effects that the modes were fitted behind and that neither are ``named`` nor were in the stage."""
    known = {*(one.name for one in named), *found.had(axis)}
    return [name for name in found.in_front if name not in known]


def named_in_front(found: StageFit) -> list[str]:
    """Names, on any axis, of what was fitted in front of the modes, softening first."""
    of_axes = [one.name for i in range(len(found.axes)) for one in _named(found, i, _effects(found, i))]
    return [name for name in found.in_front if name in of_axes]


def _untestable(found: StageFit, tested: set[str]) -> dict[str, str]:
    """Why each of the remaining effects could not be tested, by name."""
    reasons = {}
    for name in found.names:
        entry = catalogue()[name]
        softening = entry.shared_modes == "level"
        if name in tested or (softening and found.softening is not None):
            continue
        absorbed = entry.absorbed_by_modes and not found.fit.modes_kept
        reasons[name] = ONE_LEVEL if softening else ABSORBED if absorbed else NOT_LOOKED_FOR
    return reasons


def _where(found: StageFit, held_out: Sequence[GapRun], axis: str) -> list[Cell]:
    errors = found.before.errors(axis)
    noise = fit_noise([(e, run.u_V[run.rows]) for e, run in zip(errors, held_out, strict=True)], [], held_out[0].step_s)
    return rank_cells([RunResidual(run, e) for run, e in zip(held_out, errors, strict=True)], noise)


def _candidates(found: StageFit, axis: str) -> list[Candidate]:
    """The other effects that were scored, most promising first."""
    return [
        Candidate(
            1, one.effect.name, 100 * one.share, f"would explain {100 * one.share:.2g} % of what remains"
        )
        for one in found.others if one.axis == axis
    ]  # fmt: skip


def _traces(found: StageFit, after: HeldOutPrediction, held_out: Sequence[GapRun], axis: str) -> list[Trace]:
    return [
        Trace(
            run.name, axis, run.file_t_s[run.rows], run.u_V[run.rows], run.x_um[run.rows],
            found.before.model_um[axis][i], after.model_um[axis][i],
        )
        for i, run in enumerate(held_out)
    ]  # fmt: skip


def _messages(found: StageFit, after: HeldOutPrediction) -> list[str]:
    """The error over all axes relative to the output's rms, level by level, as publications on such stages give it."""
    levels: dict[str, list[int]] = {}
    for i, record in enumerate(found.held_out):
        levels.setdefault(f"{record.level_V:.2g}", []).append(i)
    lines = []
    for level, records in levels.items():
        was, now = (
            100 * float(np.sqrt(np.mean([prediction.share_of_output(i) ** 2 for i in records])))
            for prediction in (found.before, after)
        )
        lines.append(f"held out at {level} V rms: {was:.3g} % of the output's rms before, {now:.3g} % after")
    modes = f"{len(found.fit.model.poles)} modes common to all axes"
    return [*lines, f"{modes}, {KEPT}" if found.fit.modes_kept else modes, *_undetermined(found)]


def _undetermined(found: StageFit) -> list[str]:
    """What the levels of the training records leave open."""
    power = effect_of("level").parameter("exponent")
    if not found.exponent_open:
        return []
    return [
        f"the power of the level by which softening grows is not determined: {power.low:g} to {power.high:g} fit these "
        "records alike; records at a level between those of the training records would tell"
    ]


def _probability(z: float) -> float:
    """Of an effect that held-out records show by so many standard deviations, where it was as probable as not before:
    z^2 / 2 is what its amount gains in log likelihood."""
    return float(expit(0.5 * max(z, 0.0) ** 2))
