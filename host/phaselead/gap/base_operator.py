"""A hysteresis operator for a base that has none: symmetric plays behind the base's own delay, fitted to the training
records.

Asymmetry, more delay and everything else are left to be found beyond it, each on its own evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import Estimate
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import each_fitted, intervals_alone
from phaselead.gap.records import GapRun, Role
from phaselead.gap.residual import ModelledRun, modelled_run, power_um2, with_effects
from phaselead.gap.savings import probability_by_chance, saved_by_block
from phaselead.gap.selection import Memory
from phaselead.identify import fit_plays
from phaselead.model import AxisModel, Effect
from phaselead.record import Samples

MOST_BESIDE = 2
"""Effects at most beside which memory is looked for, and as many more beside which it is fitted once more: what the
time for an answer allows. Where more are needed first, no memory is given."""
OPERATOR_ROUNDS = 2
"""In which the operator and the effects that lie behind it are fitted in turn."""


def find_memory(axis: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect]) -> tuple[AxisModel, Memory | None]:
    """The axis with plays of its own, and what they are, where it has none and plays predict the held-out records
    better than the line and than any other single effect; otherwise the axis as it is, and None. Not where they predict
    reference records better too: a base that lacks them there has a fault, and they are not what is new. Nor where the
    loop may be of no width.

    Where another effect predicts more, such as a mode that rings in every record, plays are looked for beside it. The
    axis gets the plays alone, and the other effect is left to be found.

    Everything is compared in um, where memory is largest.
    """
    assert axis.time is not None
    becoming = next((effect for effect in effects if effect.becomes_plays), None)
    if axis.time.play_r_V or becoming is None or not any(run.driven for run in runs if run.role == "train"):
        return axis, None
    others = [effect for effect in effects if effect is not becoming]
    found = _apart_from_others(axis, runs, others)
    if found is None:
        return axis, None
    looped, beside, saved = found
    as_line = [modelled_run(with_effects(axis, beside), run) for run in runs]
    chance = probability_by_chance(saved) * (1 + len(beside))
    params = _loop(as_line, becoming) if chance < ERROR_RATE else None
    if params is None:
        return axis, None
    lines = _of(as_line, "reference")
    plays = [modelled_run(with_effects(looped, beside), line.run) for line in lines]
    if lines and probability_by_chance(saved_by_block(lines, (), plays, ())) < ERROR_RATE:
        return axis, None
    given = _beside_all(looped, len(beside) + MOST_BESIDE, runs, others)
    return given, Memory(becoming, params, 1 - chance, _why([effect.name for effect, _ in beside]))


def _why(beside: Sequence[str]) -> str:
    """Why the axis got plays, for a person."""
    if not beside:
        return "plays predict the held-out records better than the line, and than any other effect alone"
    first = " and ".join(beside)
    return f"beside {first}, plays predict the held-out records better than the line does, and than any further effect"


def _apart_from_others(
    axis: AxisModel, runs: Sequence[GapRun], others: Sequence[Effect]
) -> tuple[AxisModel, list[SizedEffect], Samples] | None:
    """The axis with plays, the effects beside which they predict the held-out records better than any of the others
    would, and what they save of the squares by block; None where that takes too many effects."""
    tried = [run for run in runs if run.role != "reference"]
    train = [modelled_run(axis, run) for run in runs if run.role == "train"]
    beside: list[SizedEffect] = []
    while True:
        looped = with_refitted_operator(train, beside)[0].axis
        as_line, as_plays = ([modelled_run(with_effects(one, beside), run) for run in tried] for one in (axis, looped))
        saved = saved_by_block(_of(as_line, "holdout"), (), _of(as_plays, "holdout"), ())
        larger = _most_saving(as_line, others)
        if larger is None or saved.sum() > larger[1].sum():
            return looped, beside, saved
        if len(beside) == MOST_BESIDE:
            return None
        beside.append(larger[0])
        others = [one for one in others if one.name != larger[0][0].name]


def _loop(as_line: Sequence[ModelledRun], becoming: Effect) -> Mapping[str, Estimate] | None:
    """Parameters of the effect of the catalogue that describes the loop which a line leaves; None where it may be of no
    width, or runs the other way round."""
    described = each_fitted(_of(as_line, "train"), [becoming], base_may_be_off=True)
    if not described:
        return None
    params = intervals_alone(as_line, described[0])
    _, _, (narrowest, _) = params[becoming.sizes[0].name]
    return params if narrowest > 0 else None


def _beside_all(axis: AxisModel, rounds: int, runs: Sequence[GapRun], others: Sequence[Effect]) -> AxisModel:
    """The axis with its plays fitted beside other effects, one more in each of some rounds, as long as the held-out
    records are then predicted better. Those beside which memory was looked for are fitted anew, now beside the plays.
    Plays stand in for what lags: fitted without it they are too wide where the stage is quick."""
    found: list[SizedEffect] = []
    train = [modelled_run(axis, run) for run in runs if run.role == "train"]
    tried = [run for run in runs if run.role != "reference"]
    for _ in range(rounds):
        larger = _most_saving([modelled_run(with_effects(axis, found), run) for run in tried], others)
        if larger is None:
            break
        found.append(larger[0])
        others = [one for one in others if one.name != larger[0][0].name]
        anew = with_refitted_operator(train, found)
        before, after = ([modelled_run(with_effects(one, found), r) for r in tried if r.role == "holdout"]
                         for one in (axis, anew[0].axis))  # fmt: skip
        if saved_by_block(before, (), after, ()).sum() <= 0:
            break
        axis, train = anew[0].axis, anew
    return axis


def _most_saving(runs: Sequence[ModelledRun], effects: Sequence[Effect]) -> tuple[SizedEffect, Samples] | None:
    """The effect that alone, fitted to the training runs, saves most of the squares of the held-out ones, and what it
    saves by block; None where none saves any."""
    held = _of(runs, "holdout")
    fitted = each_fitted(_of(runs, "train"), effects, base_may_be_off=True)
    saved = [(one, saved_by_block(held, (), held, [one])) for one in fitted]
    best = max(saved, key=lambda pair: float(pair[1].sum()), default=None)
    return best if best is not None and best[1].sum() > 0 else None


def _of(runs: Sequence[ModelledRun], role: Role) -> list[ModelledRun]:
    return [modelled for modelled in runs if modelled.run.role == role]


def with_refitted_operator(runs: Sequence[ModelledRun], entries: Sequence[SizedEffect]) -> list[ModelledRun]:
    """The runs of an axis under that axis with plays fitted to what some effects leave of the training runs; as they
    are where that leaves no less of these."""
    train = _of(runs, "train")
    best, best_left = train, _left_um2(train, entries)
    for _ in range(OPERATOR_ROUNDS if entries else 1):
        beyond = [t.answer(entries) - t.answer() for t in best]
        axis = with_operator(best[0].axis, [t.run for t in best], beyond)
        tried = [modelled_run(axis, t.run) for t in best]
        left = _left_um2(tried, entries)
        if left >= best_left:
            break
        best, best_left = tried, left
    if best is train:
        return list(runs)
    again = iter(best)
    return [next(again) if t.run.role == "train" else modelled_run(best[0].axis, t.run) for t in runs]


def _left_um2(runs: Sequence[ModelledRun], entries: Sequence[SizedEffect]) -> float:
    """Mean square in um^2 that the model of the runs with the effects leaves of them, each about its own mean."""
    return power_um2([modelled.error_about_mean(entries) for modelled in runs])


def with_operator(axis: AxisModel, runs: Sequence[GapRun], beyond_um: Sequence[Samples] | None = None) -> AxisModel:
    """The axis with plays, fitted to the runs, of which some are driven, in place of its line.

    ``beyond_um``: per run what effects add to the operator, (n,) over the scored rows, taken out before the fit.
    """
    if beyond_um is not None:
        runs = [_without(run, beyond) for run, beyond in zip(runs, beyond_um, strict=True)]
    driven = [r.as_fitted for r in runs if r.driven]
    return axis.model_copy(update={"time": fit_plays(driven, axis.time.delay_s if axis.time is not None else 0.0)})


def _without(run: GapRun, beyond_um: Samples) -> GapRun:
    """The run with (n,) taken out of its position over the scored rows."""
    x = run.x_um.copy()
    x[run.rows] -= beyond_um
    return replace(run, x_um=x)
