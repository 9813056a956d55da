"""One axis from its runs to what is named, tied, bounded and adopted."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import TypeVar

from phaselead.gap.adopt import adopted, kept_names
from phaselead.gap.bounds import upper_bounds
from phaselead.gap.design import about_limits, propose
from phaselead.gap.effect_search import Progress, select_effects
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
from phaselead.gap.floor import floor_of
from phaselead.gap.goodness_of_fit import (
    FinalFit,
    excused_um2,
    final_fit,
    more_than_equations_miss,
    too_much_for_names,
)
from phaselead.gap.locate import rank_cells
from phaselead.gap.posterior import Claim, goes_on_between_records, levels_say
from phaselead.gap.provisional import nearest_that_pays
from phaselead.gap.records import GapRun
from phaselead.gap.scale import FarAbove, far_above_known, led_beyond_fit, unlike_others
from phaselead.gap.selection import Selection
from phaselead.gap.testable import NEEDS_FROZEN, NEEDS_SESSION, responses, shown_by
from phaselead.gap.unexplained import WORTH_SHARE, Unexplained, unexplained
from phaselead.gap.voltage_independent import VoltageIndependent, find_voltage_independent
from phaselead.model import AxisModel, Effect, catalogue
from phaselead.quantity import digits

_Finding = TypeVar("_Finding", NamedEffect, Adopted, Bound, Candidate, Cell, Detectable, NextExperiment)


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
    messages: list[str]
    """For a person."""
    adopted: list[Adopted]
    """What the model has that the base had not."""
    unexplained: Unexplained
    """How much of what the model with its names leaves can be predicted from the voltage."""
    spans_s: Sequence[tuple[float, float]] = ()
    """First and last time of each record that may hold what was found."""
    spectra: Sequence[Spectrum] = ()
    """Of disturbances, which are looked for where axes are searched one by one."""
    detectable: Sequence[Detectable] = ()
    """From which size each effect was expected to be named, where axes are searched one by one."""
    doubts: Sequence[str] = ()
    """Whether records are of this stage and within the range of its model, for a person."""

    def labelled(self) -> AxisResult:
        """The same where what was found bears the name of the axis, or of the axes that it had: for data of several."""
        return replace(
            self,
            effects=self._with_axis(self.effects),
            excluded=self._with_axis(self.excluded),
            where=self._with_axis(self.where),
            candidates=self._with_axis(self.candidates),
            adopted=self._with_axis(self.adopted),
            detectable=self._with_axis(self.detectable),
            next_experiment=None if self.next_experiment is None else self._with_axis([self.next_experiment])[0],
        )

    def _with_axis(self, found: Sequence[_Finding]) -> list[_Finding]:
        return [replace(one, axis=one.axis or self.axis) for one in found]


def search_axis(
    axis: str,
    model: AxisModel,
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    frozen: bool,
    on_progress: Progress,
) -> AxisResult:
    """The whole workflow on one axis; what it finds does not bear the name of the axis yet.

    ``frozen``: whether the base is kept as it is.
    """
    referenced = any(run.role == "reference" for run in runs)
    shown, beyond_sampling = shown_by(effects, model, runs[0].step_s)
    candidates, refused = responses(shown, frozen, referenced)
    candidates = [effect.as_known() for effect in candidates]
    nameless = [e.as_known() for e in shown if refused.get(e.name) == NEEDS_FROZEN and not referenced]
    selection = select_effects(model, runs, candidates, nameless, frozen, lambda share: on_progress(0.85 * share))
    floor = floor_of(selection.contest)
    final = final_fit(selection, runs, floor)
    claimed = _claimed(selection, final)
    none_drifts = levels_say(runs) and any(selection.is_without(e.name) for e in effects if e.moves_zero == "steadily")
    # What probably goes on between the records moves where they stand, with a name or without.
    going_on = {e.name for e in effects if goes_on_between_records(e) and selection.is_likely(e.name)}
    known = _names(claimed.named, claimed.ties) | going_on
    other = find_voltage_independent(axis, final, effects, known, none_drifts)
    left = _left_by(claimed, final, other)
    vouched = _without_claims(claimed) if left.too_much else claimed
    named, ties = [*vouched.named, *other.named], [*vouched.ties, *other.ties]
    taken = _names(named, ties)
    # Plays that the base was given stay in it under whatever name: neither bounded nor tried beside themselves.
    played = {selection.memory.effect.name} if selection.memory is not None else set()
    excluded, hidden = upper_bounds(vouched.selection, candidates, taken | played)
    on_progress(0.92)
    unlike = unlike_others(final)
    unknown = selection.something_unnamed or other.unknown or left.beyond_equations or bool(unlike)
    provisional: list[NamedEffect] = []
    if unknown:
        # The base stays as it is, so that anything may be tried that a frozen one shows.
        untried, _ = responses([e for e in shown if e.name not in taken | played], frozen=True, referenced=False)
        final, provisional = nearest_that_pays(final, claimed.entries, runs, untried, open_plays=bool(played))
    kept = kept_names(named, [*claimed.entries, *provisional], plays=bool(played))
    unsure = {one.name for one in kept if one.status == PROVISIONAL}
    return AxisResult(
        axis=axis,
        model=adopted(final.axis, [*claimed.entries, *provisional, *other.named], unsure),
        effects=named,
        ties=ties,
        unknown=unknown,
        excluded=[*excluded, *other.excluded],
        untestable={**_untested({**beyond_sampling, **refused}, other, taken), **hidden},
        where=rank_cells(final.residuals_before(), floor.noise),
        gap=final.gap,
        rows=final.rows,
        next_experiment=_proposal(vouched.selection),
        candidates=list(vouched.selection.candidates),
        traces=final.traces(),
        spans_s=[run.span_s for run in runs if run.role != "reference"],
        spectra=other.spectra,
        messages=[
            *vouched.messages,
            *([_something_more(selection, taken)] if selection.something_unnamed else []),
            *left.messages,
            *other.messages,
            *(about_limits(model) if _ties_to_break(vouched.selection) else []),
            *_still_under_way(final, final.gap if other.drift_um_per_s else final.without_history().gap),
        ],
        adopted=kept,
        detectable=_detectable(selection, candidates),
        unexplained=left.unexplained,
        doubts=[*unlike, *led_beyond_fit(vouched.selection)],
    )


def _something_more(selection: Selection, names: AbstractSet[str]) -> str:
    """What to say where the odds are for one effect more than those that are claimed, and for no name."""
    beside = f"beside {' and '.join(sorted(names))} " if names else ""
    near = selection.likeliest(names)
    nearest = f"; nearest by the odds: {', '.join(near)}" if near else ""
    return (
        f"{beside}the records show something more than chance, and no effect of the catalogue is sure to be it{nearest}"
    )


def _still_under_way(final: FinalFit, clean: GapSize) -> list[str]:
    """What to say where held-out records, each about its own mean, are further off with a slow effect that is adopted
    than without, or where much of what is left is what effects had still under way when they began. ``clean``: the gap
    without that."""
    slow = [effect.name for effect, _ in final.entries if effect.slow]
    gap, lines = final.gap, []
    if slow and gap.after**2 > (1 + WORTH_SHARE) * gap.before**2:
        lines.append(
            f"held-out records are further off with {' and '.join(slow)} than without, each about its own mean"
        )
    if slow and gap.after**2 - clean.after**2 > max(WORTH_SHARE * gap.before**2, clean.after**2):
        names = " and ".join(effect.name for effect, _ in final.entries if effect.before_record is not None)
        lines.append(
            f"of held-out records {digits(gap.after, 2)} um rms are left, and {digits(clean.after, 2)} would be "
            f"without what {names} still had under way when they began"
        )
    more = (
        "the odds count it, the gap does not. Let the stage stand for some of its time constants, or drive it the same "
        "way, before each record"
    )
    return ["; ".join(lines) + ": " + more] if lines else []


@dataclass(frozen=True)
class _Claimed:
    """What a search claims."""

    selection: Selection
    named: Sequence[NamedEffect]
    ties: Sequence[tuple[str, ...]]
    entries: Sequence[NamedEffect]
    """For the stage file: what is named, the best of each tie and what has no name, so that the model predicts."""
    messages: Sequence[str]
    """For a person."""


def _claimed(selection: Selection, final: FinalFit) -> _Claimed:
    """What the search claims. Memory that the base was given as plays is named, and in none of its lists of effects."""
    named, ties, entries = [], [], []
    memory = selection.memory
    if memory is not None:
        name = memory.effect.name
        named.append(NamedEffect(name, memory.params, final.share_of(name), memory.why, memory.probability))
    for claim in (*selection.claims, *selection.nameless_claims):
        name = claim.effect.name
        found = NamedEffect(
            name, selection.estimates[name], final.share_of(name), _why(claim), claim.probability,
            posterior=selection.posteriors[name],
        )  # fmt: skip
        entries.append(found)
        if claim in selection.nameless_claims:
            continue
        if len(claim.tied) > 1:
            ties.append(claim.tied)
        else:
            named.append(found)
    return _Claimed(selection, named, ties, entries, selection.messages)


@dataclass(frozen=True)
class _Remainder:
    """What the final model leaves."""

    unexplained: Unexplained
    """What a generic model predicts of it."""
    beyond_equations: bool
    """Whether there is more than the equations of what is claimed may miss."""
    too_much: bool = False
    """Whether it is so much that these equations do not bear their names."""
    messages: Sequence[str] = ()
    """For a person."""


def _left_by(claimed: _Claimed, final: FinalFit, other: VoltageIndependent) -> _Remainder:
    """What is left of the held-out records beside the claims, and beside what was found that no voltage predicts."""
    anything = bool(claimed.named or claimed.ties)
    reference = final.residuals("reference")
    # Beside a name, that something more is there is a claim too.
    clean = final.without_history(other.drift_um_per_s)
    left, gap = unexplained(clean.train, clean.holdout, reference, of_any_size=not anything), clean.gap
    if anything and too_much_for_names(left, gap):
        return _Remainder(left, beyond_equations=True, too_much=True)
    # Where nothing is claimed, the model describes the training records too, or something is there.
    above = far_above_known(final, clean.holdout if anything else [*clean.holdout, *clean.train])
    excused = excused_um2(gap, final.explained_um2(_exact(claimed))) if anything else 0.0
    far = max(above.um2 - other.power_um2, 0.0) > excused
    messages = [_far_above(claimed, above)] if far else []
    if not (anything and reference):
        return _Remainder(left, far or left.something_missing, messages=messages)
    beyond = far or more_than_equations_miss(left, gap, excused)
    return _Remainder(replace(left, of_equations=left.something_missing and not beyond), beyond, messages=messages)


def _exact(claimed: _Claimed) -> list[str]:
    """Names of the effects that are claimed and whose equations are exact, by all that they are tied with."""
    every = [(one.name,) for one in claimed.named] + list(claimed.ties)
    return [name for names in every if all(catalogue()[one].exact for one in names) for name in names]


def _far_above(claimed: _Claimed, above: FarAbove) -> str:
    """What to say where far more is left than is known of the model, and more than the equations of the names miss."""
    names = " and ".join(sorted(_names(claimed.named, claimed.ties)))
    left = f"{above.farthest_um:.3g} um rms is left of {above.farthest}, far more than of {above.known}"
    if not names:
        return f"{left}: look where it is, something is there"
    return f"beside {names} {left} and than equations miss: look where it is, something else may be there"


def _without_claims(claimed: _Claimed) -> _Claimed:
    """The claims withdrawn; what they describe stays for the stage file."""
    names = " or ".join(sorted(_names(claimed.named, claimed.ties)))
    said = f"{names} would be named, but too much is left that the voltage predicts: it is not vouched for"
    messages = [*claimed.messages, said]
    return replace(claimed, selection=claimed.selection.withdrawn(), named=(), ties=(), messages=messages)


def _detectable(selection: Selection, effects: Sequence[Effect]) -> list[Detectable]:
    """What the records were expected to show, before anything of it was looked at."""
    least = selection.contest.detectable
    return [Detectable(e.name, least[e.name], e.sizes[0].unit) for e in effects if e.name in least]


def _names(named: Sequence[NamedEffect], ties: Sequence[tuple[str, ...]]) -> set[str]:
    """Every name that is claimed, for certain or in a tie."""
    return {effect.name for effect in named} | {name for tie in ties for name in tie}


def _untested(refused: dict[str, str], other: VoltageIndependent, taken: set[str]) -> dict[str, str]:
    """Why effects that are not ``taken`` were not tested, by name."""
    why = {n: w for n, w in refused.items() if not (other.zero_tested and w == NEEDS_SESSION)} | other.untested
    return {n: w for n, w in why.items() if n not in taken}


def _proposal(selection: Selection) -> NextExperiment | None:
    """The experiment that would best break the first tie of the search; None where it has none, or where the stage
    file's limits leave none."""
    ties = _ties_to_break(selection)
    return propose(selection, ties[0]) if ties else None


def _ties_to_break(selection: Selection) -> list[Claim]:
    """Those of two members that were fitted and may be named. Ties of a moved zero are none of the search."""
    return [c for c in selection.claims if len(c.rivals) > 1 and not selection.nameless & set(c.tied)]


def _why(claim: Claim) -> str:
    """Why an effect is claimed, for a person."""
    held = round(claim.held_out_log_odds)
    shown = f"add {held}" if held >= 0 else f"lower them by {-held}"
    return f"log odds {claim.log_odds:.0f} against all models without it; held-out records {shown}"
