"""What the fit of common modes found, axis by axis, as the workflow reports it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.axis import AxisResult
from phaselead.gap.locate import Part, locate
from phaselead.gap.multi_axis_adopt import (
    adopted_axis,
    coupling_params,
    own_gains,
    resonance_params,
    softening_params,
)
from phaselead.gap.multi_axis_fit import SharedFit
from phaselead.gap.multi_axis_judge import HeldOut, Judged, judge, noise_um, pays
from phaselead.gap.multi_axis_records import Stand
from phaselead.gap.multi_axis_scan import Scanned
from phaselead.gap.noise import fit_noise
from phaselead.gap.records import Run
from phaselead.gap.result import Bound, Candidate, Cell, Gap, NamedEffect, Trace, Value, Values
from phaselead.model import AxisModel, Stage
from phaselead.record import Recording, Samples

ABOVE = 1.645
"""Of a one-sided 95 % bound."""
UNEXPLAINED = 0.02
"""Share of the power before that may be left above the floor."""
LINEAR = ("delay", "amplifier_lowpass", "creep", "charge_leakage", "sensor_lowpass", "gain_change")
TAKEN_UP = "the modes of a fit to axes that move together would take it up"
ONE_LEVEL = "all training records have one level of drive; add records at another"
NOT_HERE = "not looked for in records in which several axes move at once; drive one axis at a time"


@dataclass(frozen=True)
class Findings:
    """Everything the search found out."""

    stage: Stage
    models: Mapping[str, AxisModel]
    fit: SharedFit
    linear: SharedFit
    softening: Judged | None
    """None where the records have one level."""
    others: Sequence[Scanned]
    before: HeldOut
    train: Sequence[Stand]
    held: Sequence[Stand]
    names: tuple[str, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """In order."""
        return self.train[0].axes

    @property
    def softens(self) -> bool:
        """Whether it was adopted."""
        return self.softening is not None and self.softening.pays

    def without(self, name: str, axis: int) -> SharedFit:
        """The model with one effect taken out at one output."""
        model, inputs = self.fit.model, self.fit.model.inputs
        if name == "softening":
            none = {a: [(e, {**p, "kappa": 0.0}) for e, p in of_axis] for a, of_axis in self.fit.entries.items()}
            return replace(self.fit, entries=none, fit=replace(self.fit.fit, model=replace(model, drop=None)))
        weights = model.weights.copy()
        kept = weights[axis, axis]
        if name == "resonance":
            static = model.static[axis, axis]
            weights[_columns(inputs, axis, len(model.poles)), axis] = 0.0
            weights[axis, axis] = static if name == "resonance" else kept
        else:
            for j in range(inputs):
                if j != axis:
                    weights[_columns(inputs, j, len(model.poles)), axis] = 0.0
                    weights[j, axis] = 0.0
        return replace(self.fit, fit=replace(self.fit.fit, model=replace(model, weights=weights)))


def _columns(inputs: int, axis: int, modes: int) -> slice:
    """Rows of the weights that belong to the states of one push."""
    return slice(inputs + 2 * modes * axis, inputs + 2 * modes * (axis + 1))


def axis_results(
    found: Findings, runs: Mapping[str, Sequence[Run]], holdout: Sequence[Recording], seed: int
) -> list[AxisResult]:
    """One per axis, and with the first the words that are about all of them."""
    gains = own_gains(found.fit)
    named = {a: _named(found, i) for i, a in enumerate(found.axes)}
    adopted = {
        a: adopted_axis(found.models[a], float(gains[i]), _adopted(found, i, named[a]))
        for i, a in enumerate(found.axes)
    }
    after = judge(found.stage.model_copy(update={"axes": {**found.stage.axes, **adopted}}), holdout, found.axes)
    messages = _messages(found, after)
    results = []
    for i, a in enumerate(found.axes):
        gap = _gap(found, after, i)
        taken = {one.name for one in named[a]} | {e.name for e in found.stage.axes[a].effects}
        excluded = _excluded(found, a, taken)
        untestable = _untestable(found, taken | {b.name for b in excluded})
        left = gap.after**2 - gap.floor**2
        held = [run for run in runs[a] if run.role == "holdout"]
        results.append(
            AxisResult(
                a, adopted[a], named[a], [], left > UNEXPLAINED * gap.before**2, excluded, untestable,
                _where(found, held, a, seed), gap, sum(run.stop - run.start for run in held), None,
                _candidates(found, a), _traces(found, after, held, a), [], messages if i == 0 else [],
            )
        )  # fmt: skip
    return results


def _named(found: Findings, axis: int) -> list[NamedEffect]:
    """What the stage did not have and the held-out records want."""
    known = {e.name for e in found.stage.axes[found.axes[axis]].effects}
    candidates = [one for one in _effects(found, axis) if one.name not in known]
    return sorted((one for one in candidates if one.share > 0), key=lambda one: -one.share)


def _adopted(found: Findings, axis: int, named: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Named effects, and those that the stage had, as they are now."""
    known = {e.name for e in found.stage.axes[found.axes[axis]].effects}
    names = {one.name for one in named} | known
    return [one for one in _effects(found, axis) if one.name in names]


def _effects(found: Findings, axis: int) -> list[NamedEffect]:
    params: dict[str, Mapping[str, Value | Values]] = {
        "resonance": resonance_params(found.fit, axis),
        "cross_coupling": coupling_params(found.fit, axis, found.axes),
    }
    if found.softens:
        params["softening"] = softening_params(found.fit, axis)
    result = []
    label = found.axes[axis]
    for name, values in params.items():
        without = found.without(name, axis)
        judged = pays(found.held, without.answer, found.fit.answer, axis)
        share = _share(found, without, axis) if judged.pays else 0.0
        growth = 1 / np.sqrt(max(1 - judged.saved, 1e-9))
        why = f"without it the held-out error grows {growth:.3g}-fold (z = {judged.z:.1f})"
        result.append(NamedEffect(name, label, values, share, why))
    return result


def _share(found: Findings, without: SharedFit, axis: int) -> float:
    """Of the power before: what comes back without the effect."""
    before = found.before.rms(found.axes[axis]) ** 2
    power = [float(np.mean(_error(stand, fit, axis) ** 2)) for fit in (without, found.fit) for stand in found.held]
    count = len(found.held)
    return float(np.clip((np.mean(power[:count]) - np.mean(power[count:])) / max(before, 1e-30), 0.0, 1.0))


def _error(stand: Stand, fit: SharedFit, axis: int) -> Samples:
    error = (stand.x_um - fit.answer(stand))[stand.rows, axis]
    return np.asarray(error - error.mean())


def _gap(found: Findings, after: HeldOut, axis: int) -> Gap:
    name = found.axes[axis]
    left = after.rms(name)
    noise = noise_um(found.held, axis)
    if noise is not None:
        return Gap(found.before.rms(name), left, min(noise, left), "um", "what does not repeat from period to period")
    train = float(np.sqrt(np.mean([np.mean(_error(s, found.fit, axis) ** 2) for s in found.train])))
    return Gap(found.before.rms(name), left, min(train, left), "um", "what the modes leave of the training records")


def _excluded(found: Findings, axis: str, taken: set[str]) -> list[Bound]:
    """Largest sizes that the pushes could still hide."""
    return [
        Bound(one.effect.name, abs(one.amount) + ABOVE * one.std, one.unit, axis)
        for one in found.others
        if one.axis == axis and one.effect.name not in taken and one.effect.name not in LINEAR
    ]


def _untestable(found: Findings, tested: set[str]) -> dict[str, str]:
    reasons = {}
    for name in found.names:
        if name in tested or (name == "softening" and found.softening is not None):
            continue
        reasons[name] = ONE_LEVEL if name == "softening" else TAKEN_UP if name in LINEAR else NOT_HERE
    return reasons


def _where(found: Findings, held: Sequence[Run], axis: str, seed: int) -> list[Cell]:
    errors = found.before.errors(axis)
    noise = fit_noise([(e, run.u_V[run.rows]) for e, run in zip(errors, held, strict=True)], [], held[0].step_s)
    return locate([Part(run, e, noise) for run, e in zip(held, errors, strict=True)], seed, axis)


def _candidates(found: Findings, axis: str) -> list[Candidate]:
    """What else was looked at, most promising first."""
    return [
        Candidate(
            1, one.effect.name, 100 * one.share, np.nan, np.nan,
            f"would explain {100 * one.share:.2g} % of what is left", axis,
        )
        for one in found.others if one.axis == axis
    ]  # fmt: skip


def _traces(found: Findings, after: HeldOut, held: Sequence[Run], axis: str) -> list[Trace]:
    return [
        Trace(
            run.name, axis, run.t_s[run.rows], run.u_V[run.rows], run.x_um[run.rows],
            found.before.model_um[axis][i], after.model_um[axis][i],
        )
        for i, run in enumerate(held)
    ]  # fmt: skip


def _messages(found: Findings, after: HeldOut) -> list[str]:
    """The error as those who publish on such stages give it: of the output's rms, over all axes, level by level."""
    levels: dict[str, list[int]] = {}
    for i, stand in enumerate(found.held):
        levels.setdefault(f"{stand.level_V:.2g}", []).append(i)
    lines = []
    for level, records in levels.items():
        was, now = (
            100 * float(np.sqrt(np.mean([held.share_of_output(i) ** 2 for i in records])))
            for held in (found.before, after)
        )
        lines.append(f"held out at {level} V rms: {was:.3g} % of the output's rms before, {now:.3g} % after")
    return [*lines, f"{len(found.fit.model.poles)} modes common to all axes"]
