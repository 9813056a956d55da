"""What no voltage predicts: disturbances, and a zero that moved between the sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from phaselead.gap.bounds import disturbance_bounds
from phaselead.gap.disturbances import (
    Disturbance,
    RecordOffset,
    Shift,
    best_explained,
    disturbance_spectra,
    find_disturbances,
    louder_at_rest,
    session_shifts,
)
from phaselead.gap.error_rates import ERROR_RATE, FOUND_AGAIN
from phaselead.gap.findings import Bound, NamedEffect, Spectrum
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.records import Role
from phaselead.model import Effect, catalogue

_OF_DISTURBANCE, _OF_SHIFT = 1 - FOUND_AGAIN, 1 - ERROR_RATE
"""Probability that what one test has found is there: all but its false alarms."""
KNOWN_WITHIN = 2.0
"""Factor in power to which a disturbance is known: surroundings are as loud as they like from one record to the next,
and a hum and a jitter are told of the training records alone. Chosen, not measured."""


LOUDER = "records at rest are louder than the reference's at some frequencies, and no disturbance is sure to be why"


@dataclass(frozen=True)
class VoltageIndependent:
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
    power_um2: float
    """That disturbances may add to the held-out records."""
    drift_um_per_s: float
    """Of the zero, from one record to the next and so within each; 0 where none was found."""


def find_voltage_independent(
    axis: str, final: FinalFit, effects: Sequence[Effect], claimed: set[str], none_drifts: bool
) -> VoltageIndependent:
    """Test what the final model leaves for disturbances and a moved zero. ``claimed`` are the names of the search;
    ``none_drifts``: it has found that the zero moves in no session."""
    residuals = final.without_ringing("train"), final.without_ringing("holdout"), final.without_ringing("reference")
    found, untested, left_out = find_disturbances(*residuals, {e.name for e in effects})
    tested = [effect for effect in effects if effect.name not in untested]
    whole = final.residuals("train"), final.residuals("holdout")
    bounds, hidden = disturbance_bounds(*whole, tested, {one.name for one in found})
    zero = _moved_zero(final, effects, claimed, none_drifts)
    louder = not found and louder_at_rest(*residuals)
    return VoltageIndependent(
        named=[*(_disturbance(one, final) for one in found), *zero.named],
        ties=zero.ties,
        excluded=[*zero.excluded, *bounds],
        unknown=zero.unknown or bool(left_out) or louder,
        untested={**untested, **hidden},
        zero_tested=zero.tested,
        spectra=disturbance_spectra(found, residuals[1], residuals[2], axis),
        messages=[*left_out, *([LOUDER] if louder and not left_out else []), *zero.messages],
        power_um2=KNOWN_WITHIN * sum(one.power_um2 for one in found),
        drift_um_per_s=zero.drift_um_per_s,
    )


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
    messages: Sequence[str] = ()
    drift_um_per_s: float = 0.0


def _moved_zero(final: FinalFit, effects: Sequence[Effect], claimed: set[str], none_drifts: bool) -> _MovedZero:
    """Test for a zero that moved between the sessions."""
    offsets = _offsets(final, "reference"), _offsets(final, "train"), _offsets(final, "holdout")
    shifts = session_shifts(*offsets, final.unexplained_um, none_drifts=none_drifts)
    # What is slow and was named may shift the records as well.
    slow = any(effect.slow and effect.name in claimed for effect in effects)
    shifted = () if slow else best_explained(shifts)
    refuted = [] if slow or shifted else [name for name, shift in shifts.items() if shift.refuted]
    allowed = {effect.name: effect for effect in effects if effect.name not in claimed}
    left_out = [name for name in shifted if name not in allowed]
    explained = not left_out
    named = [_shifted(allowed[name], shifts[name]) for name in shifted] if explained else []
    excluded = [
        Bound(name, shifts[name].upper, effect.sizes[0].unit)
        for name, effect in allowed.items()
        if effect.moves_zero == "at once" and name in shifts and name not in {one.name for one in named}
    ]
    elsewhere = [] if slow or shifted else [name for name, shift in shifts.items() if shift.not_at_rest]
    rates = [shifts[name].amount for name in shifted if explained and allowed[name].moves_zero == "steadily"]
    return _MovedZero(
        tested=bool(shifts),
        named=named if len(named) == 1 else (),
        ties=[shifted] if len(named) > 1 else (),
        excluded=excluded,
        unknown=bool(refuted) or (bool(shifted) and not explained) or (bool(elsewhere) and not claimed),
        messages=[
            *([_moved_back(refuted, shifts)] if refuted else []),
            *([_elsewhere(elsewhere, shifts)] if elsewhere and not refuted else []),
            *([] if explained else [f"{_standing_off(left_out, shifts)}, which is left out of the catalogue"]),
        ],
        drift_um_per_s=sum(rates),
    )


def _offsets(final: FinalFit, role: Role) -> list[RecordOffset]:
    """Mean residual of the final model per run. The reference records are without the effects."""
    return [RecordOffset.of(t.run.t_s[t.run.rows], t.error(acting), t.run.idle) for t, acting in final.acting(role)]


def _moved_back(names: Sequence[str], shifts: Mapping[str, Shift]) -> str:
    """What to say of shifts that records at rest refute."""
    return f"{_standing_off(names, shifts)}, but those at rest move back: what moved the zero is not known"


def _elsewhere(names: Sequence[str], shifts: Mapping[str, Shift]) -> str:
    """What to say of shifts that driven records show and records at rest do not."""
    return (
        f"driven {_standing_off(names, shifts)}, but those at rest by another amount: either the zero moved or the "
        "stage answers otherwise"
    )


def _standing_off(names: Sequence[str], shifts: Mapping[str, Shift]) -> str:
    """By how much records stand off, as these shifts say."""
    seen = [f"{name} of {shifts[name].amount:.4g} {catalogue()[name].sizes[0].unit}" for name in names]
    return f"records stand off from the reference session as by {' or '.join(seen)}"


def _shifted(effect: Effect, shift: Shift) -> NamedEffect:
    """An effect that moved the zero. Its share is 0: the gap is measured about each record's own mean."""
    at, half, size = shift.amount, shift.half, effect.sizes[0]
    why = f"from the reference session on records stand off by {at:.4g} {size.unit}, and held-out ones too"
    return NamedEffect(effect.name, {size.name: (at, size.unit, (at - half, at + half))}, 0.0, why, _OF_SHIFT)


def _disturbance(found: Disturbance, final: FinalFit) -> NamedEffect:
    """A disturbance that was found, with its share of the power."""
    share = min(found.power_um2 / max(final.gap.before**2, 1e-30), 1.0)
    return NamedEffect(found.name, found.params, share, found.why, _OF_DISTURBANCE)
