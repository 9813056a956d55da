"""One axis from its runs to what is named, tied, bounded and adopted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.adopt import adopted, kept_names
from phaselead.gap.bounds import MANY_TIMES, disturbance_bounds, upper_bounds
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
    PROVISIONAL,
    Adopted,
    Bound,
    Candidate,
    Cell,
    Detectable,
    GapSize,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
)
from phaselead.gap.floor import noise_of
from phaselead.gap.goodness_of_fit import (
    CLEARLY_ABOVE_FLOOR,
    FinalFit,
    final_fit,
    more_than_equations_miss,
    too_little_described,
)
from phaselead.gap.locate import ResidualAndNoise, rank_cells
from phaselead.gap.noise import Noise
from phaselead.gap.posterior import Claim
from phaselead.gap.provisional import nearest_that_pays
from phaselead.gap.records import GapRun
from phaselead.gap.search import Progress, select_effects
from phaselead.gap.selection import Selection
from phaselead.gap.unexplained import Unexplained, unexplained
from phaselead.model import AxisModel, Effect

_OF_DISTURBANCE, _OF_SHIFT = 1 - HOLDOUT_CHANCE, 1 - HELD_OUT_P
"""Probability that what one test has found is there: all but its false alarms."""
NEEDS_FROZEN = "can be told only against a frozen base: give --reference records, or --frozen"
NEEDS_SESSION = "a zero that moved shows only against a session before it: give --reference records, idle and driven"


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
    detectable: list[Detectable]
    """From which size each effect was expected to be named."""
    unexplained: Unexplained
    """How much of what the model with its names leaves can be predicted from the voltage."""


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

    ``frozen``: whether the base is beyond doubt. ``seed`` is of the draws for cells.
    """
    referenced = any(run.role == "reference" for run in runs)
    candidates, refused = responses(effects, frozen, referenced)
    candidates = [effect.as_known() for effect in candidates]
    nameless = [e.as_known() for e in effects if refused.get(e.name) == NEEDS_FROZEN and not referenced]
    selection = select_effects(model, runs, candidates, nameless, frozen, lambda share: on_progress(0.85 * share))
    assert selection.contest is not None
    noise = noise_of(selection.contest)
    final = final_fit(selection, runs, noise)
    named, ties, file_entries = _named(selection, final, label)
    other = _beyond_voltage(axis, final, effects, _names(named, ties), label)
    residuals = final.residuals("train"), final.residuals("holdout"), final.residuals("reference")
    # Beside a name, that something more is there is a claim too.
    left = unexplained(*residuals, of_any_size=not named and not ties)
    surviving, predictable = selection, left.something_missing
    said = [f"{label}: {message}" if label else message for message in selection.messages]
    if (named or ties) and too_little_described(left, final.gap):
        names = " or ".join(sorted(_names(named, ties)))
        said.append(f"{names} would be named, but too much is left that the voltage predicts: it is not vouched for")
        named, ties, surviving = [], [], selection.withdrawn()
    elif (named or ties) and selection.runs("reference"):
        predictable = more_than_equations_miss(left, final.gap)
        left = replace(left, of_equations=left.something_missing and not predictable)
    ties += other.ties
    taken = _names([*named, *other.named], ties)
    # Plays that the base was given stay in it under whatever name: neither bounded nor tried beside themselves.
    taken_or_played = taken | ({selection.memory.effect.name} if selection.memory is not None else set())
    excluded, hidden = upper_bounds(surviving, candidates, taken_or_played, label)
    on_progress(0.92)
    unknown = selection.something_unnamed or other.unknown or predictable
    provisional: list[NamedEffect] = []
    if unknown:
        untried = [effect for effect in effects if effect.name not in taken_or_played]
        # The base stays as it is, so that anything may be tried that a frozen one shows.
        allowed, _ = responses(untried, frozen=True, referenced=False)
        own_plays = selection.memory is not None
        final, provisional = nearest_that_pays(final, file_entries, runs, allowed, label, own_plays)
    kept = kept_names([*named, *other.named], [*file_entries, *provisional], selection.memory is not None, label)
    unsure = {one.name for one in kept if one.status == PROVISIONAL}
    return AxisResult(
        axis,
        adopted(final.axis, [*file_entries, *provisional, *other.named], unsure),
        [*named, *other.named],
        ties,
        unknown,
        [*excluded, *other.excluded],
        {**_untested(refused, other, taken), **hidden},
        _where(noise, final, seed, label),
        final.gap,
        final.rows,
        _proposal(surviving, label),
        list(surviving.candidates),
        final.traces(),
        other.spectra,
        [*said, *other.messages],
        kept,
        _detectable(selection, candidates, label),
        left,
    )


def _detectable(selection: Selection, effects: Sequence[Effect], label: str | None) -> list[Detectable]:
    """What the records were expected to show, before anything of it was looked at."""
    assert selection.contest is not None
    least = selection.contest.detectable
    return [
        Detectable(e.name, least[e.name], e.sizes[0].unit, label)
        for e in effects
        if least.get(e.name, np.inf) < MANY_TIMES * e.sizes[0].typical
    ]


def _names(named: Sequence[NamedEffect], ties: Sequence[tuple[str, ...]]) -> set[str]:
    """Every name that is claimed, for certain or in a tie."""
    return {effect.name for effect in named} | {name for tie in ties for name in tie}


def _untested(refused: dict[str, str], other: _BeyondVoltage, taken: set[str]) -> dict[str, str]:
    """Why effects that are not ``taken`` were not tested, by name."""
    why = {n: w for n, w in refused.items() if not (other.zero_tested and w == NEEDS_SESSION)} | other.untested
    return {n: w for n, w in why.items() if n not in taken}


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
    tested = [effect for effect in effects if effect.name not in untested]
    bounds, hidden = disturbance_bounds(*residuals[:2], tested, {one.name for one in found}, label)
    zero = _moved_zero(final, effects, claimed, label)
    named = [*(_disturbance(one, final, label) for one in found), *zero.named]
    unknown = zero.unknown or bool(left_out) or (not found and louder_at_rest(*residuals))
    shown = disturbance_spectra(found, residuals[1], residuals[2], axis)
    excluded, untested = [*zero.excluded, *bounds], {**untested, **hidden}
    return _BeyondVoltage(named, zero.ties, excluded, unknown, untested, zero.tested, shown, left_out)


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


def _where(noise: Noise, final: FinalFit, seed: int, label: str | None) -> list[Cell]:
    """Where the base as given leaves most of the held-out records."""
    parts = [ResidualAndNoise(before.run, before.error_um, noise) for before in final.residuals_before("holdout")]
    return rank_cells(parts, seed, label)


def _proposal(selection: Selection, label: str | None) -> NextExperiment | None:
    """The experiment that would best break the first tie of the search; None where it has no tie of two members that
    were fitted and may be named. Ties of a moved zero are none of the search."""
    ties = [c for c in selection.claims if len(c.rivals) > 1 and not selection.nameless & set(c.tied)]
    return propose(selection, ties[0], label) if ties else None


def _named(
    selection: Selection, final: FinalFit, label: str | None
) -> tuple[list[NamedEffect], list[tuple[str, ...]], list[NamedEffect]]:
    """Named effects, ties, and the effects for the stage file: those named, the best of each tie and what has no name,
    so that the model predicts. Memory that the base was given as plays is in none of its lists of effects."""
    named, ties, entries = [], [], []
    memory = selection.memory
    if memory is not None:
        name = memory.effect.name
        named.append(NamedEffect(name, label, memory.params, final.share_of(name), memory.why, memory.probability))
    for claim in (*selection.claims, *selection.nameless_claims):
        name = claim.effect.name
        found = NamedEffect(
            name, label, selection.estimates[name], final.share_of(name), _why(claim), claim.probability
        )
        entries.append(found)
        if claim in selection.nameless_claims:
            continue
        if len(claim.tied) > 1:
            ties.append(claim.tied)
        else:
            named.append(found)
    return named, ties, entries


def _why(claim: Claim) -> str:
    """Why an effect is claimed, for a person."""
    held = claim.held_out_log_odds
    shown = f"add {held:.0f}" if held >= 0 else f"take {-held:.0f} away"
    return f"log odds {claim.log_odds:.0f} against all models without it; held-out records {shown}"


def _disturbance(found: Disturbance, final: FinalFit, label: str | None) -> NamedEffect:
    """A disturbance that was found, with its share of the power."""
    share = min(found.power_um2 / max(final.gap.before**2, 1e-30), 1.0)
    return NamedEffect(found.name, label, found.params, share, found.why, _OF_DISTURBANCE)
