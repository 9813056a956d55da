"""One axis from its runs to what is named, tied, bounded and adopted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from phaselead.gap.adopt import adopted
from phaselead.gap.bounds import bounds
from phaselead.gap.design import propose
from phaselead.gap.disturbances import (
    Shift,
    best_explained,
    disturbance_spectra,
    find_disturbances,
    louder_at_rest,
    session_shifts,
)
from phaselead.gap.final import Final, finish
from phaselead.gap.grow import Growth, Named, unnamed
from phaselead.gap.intervals import intervals
from phaselead.gap.left import Found
from phaselead.gap.locate import ResidualAndNoise, rank_cells
from phaselead.gap.records import Run
from phaselead.gap.result import Bound, Candidate, Cell, Gap, NamedEffect, NextExperiment, Spectrum, Trace, Value
from phaselead.gap.second_opinion import explained
from phaselead.gap.surplus import PLAINLY, SLOW, leaves_too_much, unexplained
from phaselead.model import AxisModel, Effect, Place

NEEDS_FROZEN = "can be told only against a frozen base: give --reference records, or --frozen"
OFFSET = "a zero that moved shows only against a session before it: give --reference records, idle and driven"
STOOD_IN = "explains most alone and less than the names together; the search that found these went without it"


@dataclass(frozen=True)
class AxisResult:
    """What ``run_gap`` puts together."""

    axis: str
    model: AxisModel
    effects: list[NamedEffect]
    ties: list[tuple[str, ...]]
    unknown: bool
    excluded: list[Bound]
    untestable: dict[str, str]
    where: list[Cell]
    gap: Gap
    rows: int
    next_experiment: NextExperiment | None
    candidates: list[Candidate]
    traces: list[Trace]
    spectra: list[Spectrum]
    messages: list[str]


def search_axis(
    axis: str,
    label: str | None,
    model: AxisModel,
    runs: Sequence[Run],
    effects: Sequence[Effect],
    frozen: bool,
    seed: int,
    on_progress: Callable[[float], None],
) -> AxisResult:
    """The whole workflow on one axis. ``label`` is the axis in the result: None for single-axis data."""
    candidates, refused = responses(effects, frozen)
    if not frozen and not any(run.role == "reference" for run in runs):
        candidates = [effect.beside_moving_base() for effect in candidates]
    growth, final = explained(model, runs, candidates, frozen, lambda share: on_progress(0.9 * share))
    if leaves_too_much(growth, final):
        growth = unnamed(growth)
        final = finish(growth, runs)
    little_left = final.gap.after < PLAINLY * final.gap.floor
    named, ties, file_entries = _named(growth, final, label, seed)
    lefts = final.lefts("train"), final.lefts("holdout"), final.lefts("reference")
    disturbed, untested, left_out = find_disturbances(*lefts, {e.name for e in effects})
    noise_like = [_disturbance(found, final, label) for found in disturbed]
    shifts = session_shifts(final.offsets("reference"), final.offsets("train"), final.offsets("holdout"))
    claimed = {e.name for e in named} | {n for tie in ties for n in tie}
    # While more is left, or what is slow was named, that may shift the records as well.
    shifted = best_explained(shifts) if little_left and not claimed & SLOW else ()
    allowed = {e.name for e in effects} - claimed
    moved = [_other_zero(name, shifts[name], label) for name in shifted if set(shifted) <= allowed]
    if len(moved) > 1:
        ties.append(shifted)
    else:
        noise_like += moved
    if shifts:
        refused.pop("offset", None)
    taken = {e.name for e in [*named, *noise_like]} | {n for tie in ties for n in tie}
    excluded, hidden = bounds(growth, candidates, taken, label)
    if growth.stood_in is not None and growth.stood_in not in taken:
        hidden[growth.stood_in] = STOOD_IN
    if "offset" in shifts and "offset" in allowed - taken:
        excluded.append(Bound("offset", abs(shifts["offset"].amount) + shifts["offset"].half, "um", label))
    on_progress(0.97)
    tied = max((n for n in growth.named if len(n.tied) > 1), key=_comparable, default=None)
    return AxisResult(
        axis,
        adopted(final.axis, [*file_entries, *noise_like]),
        [*named, *noise_like],
        ties,
        unexplained(growth, final)
        or (bool(shifted) and not moved and not allowed >= set(shifted))
        or bool(left_out)
        or (not disturbed and louder_at_rest(*lefts)),
        excluded,
        {**{n: w for n, w in {**refused, **untested}.items() if n not in taken}, **hidden},
        rank_cells(
            [ResidualAndNoise(left.run, left.error_um, growth.bench.noise) for left in final.before_lefts("holdout")],
            seed,
            label,
        ),
        final.gap,
        final.rows,
        propose(growth, tied, label) if tied is not None else None,
        growth.candidates,
        final.traces(),
        disturbance_spectra(disturbed, lefts[1], lefts[2], axis),
        [*growth.messages, *left_out],
    )


def responses(effects: Sequence[Effect], frozen: bool) -> tuple[list[Effect], dict[str, str]]:
    """Effects that the search may name, and why the others are not among them. Noise-like ones have their own tests."""
    allowed, refused = [], {}
    for effect in effects:
        if effect.name == "offset":
            refused[effect.name] = OFFSET
        elif effect.kind == "calibration" and not frozen:
            refused[effect.name] = NEEDS_FROZEN
        elif effect.kind != "disturbance" or (effect.place == Place.ENVIRONMENT and effect.name == "thermal_drift"):
            allowed.append(effect)
    return allowed, refused


def _comparable(one: Named) -> bool:
    """Whether two of its tie were refitted, so that an experiment can be predicted for both."""
    return sum(r.effect.name in one.tied for r in one.rivals) > 1


def _named(
    growth: Growth, final: Final, label: str | None, seed: int
) -> tuple[list[NamedEffect], list[tuple[str, ...]], list[NamedEffect]]:
    """Named effects, ties, and what goes into the file's list (a tie's best member too, so that the model predicts)."""
    values = intervals(final.fitted, growth.bench.slim, growth.bench.correction, seed)
    by_name = {effect.name: v for (effect, _), v in zip(final.fitted.entries, values, strict=True)}
    named, ties, entries = [], [], []
    for one in growth.named:
        name = one.effect.name
        params = by_name.get(name) or _operator_params(one, growth)
        found = NamedEffect(name, label, params, final.share_of(name), _why(one))
        if len(one.tied) > 1:
            ties.append(one.tied)
        else:
            named.append(found)
        if name in by_name:
            entries.append(found)
    return named, ties, entries


def _operator_params(one: Named, growth: Growth) -> dict[str, Value]:
    """Of `hysteresis` that became the base's own operator: the catalogue's description of it."""
    params = growth.operator or {}
    spread = 2 / max(one.held.z, 1.0)
    return {
        p.name: (params[p.name], p.unit, _around(params[p.name], spread))
        for p in one.effect.parameters
        if p.name in params
    }


def _around(value: float, share: float) -> tuple[float, float]:
    return value - share * abs(value), value + share * abs(value)


def _why(one: Named) -> str:
    rivals = [r for r in one.rivals if r.effect.name not in one.tied]
    found = f"beats the model without it by {one.score:.0f} points"
    if one.held.testable:
        found += f"; held-out records show {100 * one.held.slope:.0f} % of it (z = {one.held.z:.1f})"
    else:
        found += "; the held-out records lack the drive to show it, so this rests on the training records"
    if rivals:
        found += f"; {rivals[0].effect.title.lower()} comes next, {one.score - rivals[0].score:.0f} points behind"
    return found


def _other_zero(name: str, shift: Shift, label: str | None) -> NamedEffect:
    """Its share is 0: the gap is measured about each record's own offset."""
    at, half = shift.amount, shift.half
    size, unit = ("offset_um", "um") if name == "offset" else ("ramp_um_per_s", "um/s")
    why = f"from the reference session on records stand off by {at:.4g} {unit}, and held-out ones too"
    return NamedEffect(name, label, {size: (at, unit, (at - half, at + half))}, 0.0, why)


def _disturbance(found: Found, final: Final, label: str | None) -> NamedEffect:
    share = min(found.power_um2 / max(final.gap.before**2, 1e-30), 1.0)
    return NamedEffect(found.name, label, found.params, share, found.why)


__all__ = ["AxisResult", "search_axis"]
