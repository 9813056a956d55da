"""One axis from its runs to what is named, tied, bounded and adopted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from phaselead.gap.acceptance import Named
from phaselead.gap.adopt import adopted, kept_names
from phaselead.gap.confidence import confidence_intervals, raised_bounds, upper_bounds
from phaselead.gap.design import propose
from phaselead.gap.disturbances import (
    HELD_OUT_P,
    HOLDOUT_CHANCE,
    Disturbance,
    Shift,
    best_explained,
    disturbance_spectra,
    find_disturbances,
    louder_at_rest,
    session_shifts,
)
from phaselead.gap.findings import (
    NAMED,
    PROVISIONAL,
    Adopted,
    Bound,
    Candidate,
    Cell,
    Estimate,
    GapSize,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
)
from phaselead.gap.goodness_of_fit import (
    CLEARLY_ABOVE_FLOOR,
    FinalFit,
    final_fit,
    much_predictable,
    names_leave_too_much,
    structure_remains,
)
from phaselead.gap.locate import ResidualAndNoise, rank_cells
from phaselead.gap.probability import probability_from_false_alarm, probability_from_points
from phaselead.gap.posterior_search import select_by_posterior
from phaselead.gap.provisional import FittedSet, nearest_that_pays
from phaselead.gap.records import GapRun
from phaselead.gap.search import Progress, Selection, select_effects, without_names
from phaselead.gap.unexplained import Unexplained, unexplained
from phaselead.model import AxisModel, Effect

_OF_DISTURBANCE = probability_from_false_alarm(HOLDOUT_CHANCE)
_OF_SHIFT = probability_from_false_alarm(HELD_OUT_P)
SECOND_SEARCH_LEAVES = 0.5
"""Of the power above the floor that the first search left: a second one that leaves less is believed instead."""
NEEDS_FROZEN = "can be told only against a frozen base: give --reference records, or --frozen"
NEEDS_SESSION = "a zero that moved shows only against a session before it: give --reference records, idle and driven"
SUBSTITUTE = "explains most alone and less than the names together; the search that found these went without it"


@dataclass(frozen=True)
class AxisResult:
    """What the workflow found on one axis; ``run_gap`` joins those of all axes."""

    axis: str
    model: AxisModel
    """The base with what was found."""
    effects: list[NamedEffect]
    ties: list[tuple[str, ...]]
    """Names that the records cannot tell apart, the best first."""
    unknown: bool
    """Whether something is there that no name explains."""
    excluded: list[Bound]
    untestable: dict[str, str]
    """Why these records say nothing of an effect, by its name."""
    where: list[Cell]
    gap: GapSize
    rows: int
    """Held-out rows."""
    next_experiment: NextExperiment | None
    candidates: list[Candidate]
    traces: list[Trace]
    spectra: list[Spectrum]
    messages: list[str]
    """For a person."""
    adopted: list[Adopted]
    """What the model has that the base had not."""
    unexplained: Unexplained
    """How much of what the names leave can be predicted from the voltage."""


def search_axis(
    axis: str,
    label: str | None,
    model: AxisModel,
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    frozen: bool,
    seed: int,
    on_progress: Progress,
) -> AxisResult:
    """The whole workflow on one axis. ``label`` is the axis in the result: None for single-axis data.

    ``frozen``: whether the base is beyond doubt. ``seed`` is of the draws for intervals and cells.
    """
    candidates, refused = responses(effects, frozen, any(run.role == "reference" for run in runs))
    searched = _credible_search(model, runs, candidates, frozen, lambda share: on_progress(0.85 * share))
    selection, final = searched.selection, searched.final
    named, ties, file_entries = _named(selection, final, label, seed)
    other = _beyond_voltage(axis, final, effects, _names(named, ties), label)
    ties += other.ties
    taken = _names([*named, *other.named], ties)
    excluded, hidden = upper_bounds(selection, candidates, taken, label)
    on_progress(0.9)
    left = unexplained(final.residuals("train"), final.residuals("holdout"), final.residuals("reference"))
    unknown = structure_remains(selection, final) or other.unknown or much_predictable(left, final.gap, bool(taken))
    on_progress(0.92)
    provisional: list[NamedEffect] = []
    if unknown:
        final, provisional = _provisional(searched, final, file_entries, effects, runs, taken, label, seed)
    kept = kept_names([*named, *other.named], [*file_entries, *provisional], selection.operator is not None, label)
    unsure = {one.name for one in kept if one.status == PROVISIONAL}
    return AxisResult(
        axis,
        adopted(final.axis, [*file_entries, *provisional, *other.named], unsure),
        [*named, *other.named],
        ties,
        unknown,
        raised_bounds([*excluded, *other.excluded], provisional),
        {**_untested(refused, other, taken), **hidden, **_substituted(selection, taken)},
        _where(selection, final, seed, label),
        final.gap,
        final.rows,
        _proposal(selection, label),
        selection.candidates,
        final.traces(),
        other.spectra,
        [*selection.messages, *other.messages],
        kept,
        left,
    )


def _provisional(
    searched: _Searched,
    final: FinalFit,
    file_entries: Sequence[NamedEffect],
    effects: Sequence[Effect],
    runs: Sequence[GapRun],
    taken: set[str],
    label: str | None,
    seed: int,
) -> tuple[FinalFit, list[NamedEffect]]:
    """The final fit with what predicts held-out records better though its name is not vouched for, and that; ``taken``
    are the names that are claimed. The base stays as it is, so that anything may be tried that a frozen one shows."""
    allowed, _ = responses([effect for effect in effects if effect.name not in taken], frozen=True, referenced=False)
    withdrawn = None
    if searched.withdrawn is not None:
        _, _, entries = _named(*searched.withdrawn, label, seed)
        withdrawn = FittedSet(searched.withdrawn[1].fitted.entries, tuple(entries))
    return nearest_that_pays(final, file_entries, runs, allowed, withdrawn, label, seed)


def _names(named: Sequence[NamedEffect], ties: Sequence[tuple[str, ...]]) -> set[str]:
    """Every name that is claimed, for certain or in a tie."""
    return {effect.name for effect in named} | {name for tie in ties for name in tie}


def _untested(refused: dict[str, str], other: _BeyondVoltage, taken: set[str]) -> dict[str, str]:
    """Why effects that are not ``taken`` were not tested, by name."""
    why = {n: w for n, w in refused.items() if not (other.zero_tested and w == NEEDS_SESSION)} | other.untested
    return {n: w for n, w in why.items() if n not in taken}


def _substituted(selection: Selection, taken: set[str]) -> dict[str, str]:
    """Why the effect that the search went without is not named, by its name; empty without one."""
    left_out = selection.substitute
    return {} if left_out is None or left_out in taken else {left_out: SUBSTITUTE}


def responses(effects: Sequence[Effect], frozen: bool, referenced: bool) -> tuple[list[Effect], dict[str, str]]:
    """Effects that the search may name, and why others are not among them, by name.

    ``referenced``: whether there are reference records. Without them, a base that is not frozen is refitted together
    with the effects. Disturbances have tests of their own, but a drift is fitted like a response: its course in time
    is known.
    """
    allowed, refused = [], {}
    for effect in effects:
        if effect.moves_zero == "at once":
            refused[effect.name] = NEEDS_SESSION
        elif effect.alone_as is not None:
            refused[effect.name] = f"one axis cannot tell it from {effect.alone_as}, which stands for both"
        elif effect.kind == "calibration" and not frozen:
            refused[effect.name] = NEEDS_FROZEN
        elif effect.kind != "disturbance" or effect.moves_zero == "steadily":
            allowed.append(effect if frozen or referenced else effect.for_refitted_base())
    return allowed, refused


@dataclass(frozen=True)
class _BeyondVoltage:
    """What no voltage predicts: disturbances, and a zero that moved between the sessions."""

    named: list[NamedEffect]
    ties: Sequence[tuple[str, ...]]
    excluded: Sequence[Bound]
    unknown: bool
    """Whether something is there that no effect allowed explains."""
    untested: dict[str, str]
    """Why a disturbance could not be tested, by its name."""
    zero_tested: bool
    """Whether there are records that could show a zero that moved."""
    spectra: list[Spectrum]
    messages: list[str]


def _beyond_voltage(
    axis: str, final: FinalFit, effects: Sequence[Effect], claimed: set[str], label: str | None
) -> _BeyondVoltage:
    """Test what the final model leaves for disturbances and a moved zero; ``claimed`` are the names of the search."""
    residuals = final.residuals("train"), final.residuals("holdout"), final.residuals("reference")
    found, untested, left_out = find_disturbances(*residuals, {e.name for e in effects})
    zero = _moved_zero(final, effects, claimed, label)
    named = [*(_disturbance(one, final, label) for one in found), *zero.named]
    unknown = zero.unknown or bool(left_out) or (not found and louder_at_rest(*residuals))
    shown = disturbance_spectra(found, residuals[1], residuals[2], axis)
    return _BeyondVoltage(named, zero.ties, zero.excluded, unknown, untested, zero.tested, shown, left_out)


@dataclass(frozen=True)
class _MovedZero:
    """What the means of the records say about a zero that moved between the sessions."""

    tested: bool = False
    """Whether there are records that could show it."""
    named: Sequence[NamedEffect] = ()
    ties: Sequence[tuple[str, ...]] = ()
    excluded: Sequence[Bound] = ()
    unknown: bool = False
    """Whether it moved as no effect allowed explains."""


def _moved_zero(final: FinalFit, effects: Sequence[Effect], claimed: set[str], label: str | None) -> _MovedZero:
    """Test for a zero that moved between the sessions."""
    shifts = session_shifts(final.offsets("reference"), final.offsets("train"), final.offsets("holdout"))
    # While more is left, or what is slow was named, that may shift the records as well.
    little_left = final.gap.after < CLEARLY_ABOVE_FLOOR * final.gap.floor
    slow = any(effect.slow and effect.name in claimed for effect in effects)
    shifted = best_explained(shifts) if little_left and not slow else ()
    allowed = {effect.name: effect for effect in effects if effect.name not in claimed}
    explained = set(shifted) <= set(allowed)
    named = [_shifted(allowed[name], shifts[name], label) for name in shifted] if explained else []
    excluded = [
        Bound(name, abs(shifts[name].amount) + shifts[name].half, effect.sizes[0].unit, label)
        for name, effect in allowed.items()
        if effect.moves_zero == "at once" and name in shifts and name not in {one.name for one in named}
    ]
    if len(named) > 1:
        return _MovedZero(bool(shifts), ties=[shifted], excluded=excluded)
    return _MovedZero(bool(shifts), named, (), excluded, bool(shifted) and not explained)


def _shifted(effect: Effect, shift: Shift, label: str | None) -> NamedEffect:
    """An effect that moved the zero. Its share is 0: the gap is measured about each record's own mean."""
    at, half, size = shift.amount, shift.half, effect.sizes[0]
    why = f"from the reference session on records stand off by {at:.4g} {size.unit}, and held-out ones too"
    return NamedEffect(effect.name, label, {size.name: (at, size.unit, (at - half, at + half))}, 0.0, why, _OF_SHIFT)


@dataclass(frozen=True)
class _Searched:
    """Where the search ended, and where it was before its names were withdrawn, if they were."""

    selection: Selection
    final: FinalFit
    withdrawn: tuple[Selection, FinalFit] | None = None


def _credible_search(
    model: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], frozen: bool, on_progress: Progress
) -> _Searched:
    """The better search, its names withdrawn where they leave too much to be what is there."""
    view = model.time
    assert view is not None
    if any(run.role == "reference" for run in runs) and view.play_r_V:
        selection = select_by_posterior(model, runs, effects, on_progress)
        return _Searched(selection, final_fit(selection, runs))
    selection, final = search_twice(model, runs, effects, frozen, on_progress)
    if not names_leave_too_much(selection, final):
        return _Searched(selection, final)
    bare = without_names(selection)
    return _Searched(bare, final_fit(bare, runs), (selection, final))


def search_twice(
    model: AxisModel, runs: Sequence[GapRun], effects: Sequence[Effect], frozen: bool, on_progress: Progress
) -> tuple[Selection, FinalFit]:
    """The search, or a second one without the effect that the first began with, where that explains much more.

    The search names one effect after the other, and the one that explains most alone may imitate two that act
    together: a mode for a load and a lag. So where clearly more is left than the reference records allow, the search
    is run again without it, and the better explanation of the held-out records is kept.
    """
    selection = select_effects(model, runs, effects, frozen, lambda share: on_progress(0.8 * share))
    final = final_fit(selection, runs)
    first = _first_named(selection)
    if first is None or selection.problem.reference is None or final.gap.after < CLEARLY_ABOVE_FLOOR * final.gap.floor:
        return selection, final
    others = [effect for effect in effects if effect.name != first]
    again = select_effects(model, runs, others, frozen, lambda share: on_progress(0.8 + 0.2 * share))
    second = final_fit(again, runs)
    if not again.named or _above_floor(second) > SECOND_SEARCH_LEAVES * _above_floor(final):
        return selection, final
    names = " and ".join(n.effect.name for n in again.named)
    said = f"{first} alone explains most, but {names} without it leave less of the held-out records"
    return replace(again, substitute=first, messages=[*again.messages, said]), second


def _first_named(selection: Selection) -> str | None:
    """Name of the effect that was named first, though it may have been dropped since, or that came nearest to it."""
    names = [c.name for c in selection.candidates if c.remark == NAMED] or [c.name for c in selection.candidates]
    return names[0] if names else None


def _above_floor(final: FinalFit) -> float:
    """Power in um^2 that is left of the held-out records beyond the floor."""
    return float(final.gap.after**2 - final.gap.floor**2)


def _where(selection: Selection, final: FinalFit, seed: int, label: str | None) -> list[Cell]:
    """Where the base as given leaves most of the held-out records."""
    noise = selection.problem.noise
    parts = [ResidualAndNoise(before.run, before.error_um, noise) for before in final.residuals_before("holdout")]
    return rank_cells(parts, seed, label)


def _proposal(selection: Selection, label: str | None) -> NextExperiment | None:
    """The experiment that would best break a tie; None where no tie has two members that were refitted."""
    ties = [one for one in selection.named if len(one.tied) > 1]
    tied = max(ties, key=lambda one: sum(r.effect.name in one.tied for r in one.rivals) > 1, default=None)
    return propose(selection, tied, label) if tied is not None else None


def _named(
    selection: Selection, final: FinalFit, label: str | None, seed: int
) -> tuple[list[NamedEffect], list[tuple[str, ...]], list[NamedEffect]]:
    """Named effects, ties, and the effects for the stage file: those named, and the best of each tie, so that the model
    predicts. An effect that the base took up as plays is in none of its lists of effects."""
    by_name = selection.estimates
    if by_name is None:
        values = confidence_intervals(final.fitted, selection.problem.train_common, selection.problem.discrepancy, seed)
        by_name = {effect.name: v for (effect, _), v in zip(final.fitted.entries, values, strict=True)}
    named, ties, entries = [], [], []
    for one in selection.named:
        name = one.effect.name
        params = by_name.get(name) or _operator_params(one, selection)
        probability = (selection.probability or {}).get(name)
        if probability is None:
            probability = probability_from_points(one.score, [r.score for r in one.rivals if r.effect.name != name])
        found = NamedEffect(name, label, params, final.share_of(name), _why(one), probability)
        if len(one.tied) > 1:
            ties.append(one.tied)
        else:
            named.append(found)
        if name in by_name:
            entries.append(found)
    return named, ties, entries


def _operator_params(one: Named, selection: Selection) -> dict[str, Estimate]:
    """Parameters of an effect that the base took up as plays of its own: as the catalogue describes it."""
    params = selection.operator or {}
    spread = 2 / max(one.held_out.z, 1.0)
    return {
        p.name: (params[p.name], p.unit, _around(params[p.name], spread))
        for p in one.effect.parameters
        if p.name in params
    }


def _around(value: float, share: float) -> tuple[float, float]:
    """The interval of a share of the value on either side of it."""
    return value - share * abs(value), value + share * abs(value)


def _why(one: Named) -> str:
    """Why an effect was named, for a person."""
    rivals = [r for r in one.rivals if r.effect.name not in one.tied]
    found = f"beats the model without it by {one.score:.0f} points"
    if one.held_out.testable:
        found += f"; held-out records show {100 * one.held_out.slope:.0f} % of it (z = {one.held_out.z:.1f})"
    else:
        found += "; the held-out records lack the drive to show it, so this rests on the training records"
    if rivals:
        found += f"; {rivals[0].effect.title.lower()} comes next, {one.score - rivals[0].score:.0f} points behind"
    return found


def _disturbance(found: Disturbance, final: FinalFit, label: str | None) -> NamedEffect:
    """A disturbance that was found, with its share of the power."""
    share = min(found.power_um2 / max(final.gap.before**2, 1e-30), 1.0)
    return NamedEffect(found.name, label, found.params, share, found.why, _OF_DISTURBANCE)
