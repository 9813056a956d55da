"""One case: its records, the gap workflow on them, and the answer as plain JSON types."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from phaselead.errors import BadInput, PhaseleadError
from phaselead.freed_memory import keep_freed_memory
from phaselead.gap import GapResult, NamedEffect, excitation_of, left_um, run_gap
from phaselead.identify import STILL_V, Base, fit
from phaselead.model import Actuator, AxisModel, Place, Stage, catalogue
from phaselead.record import Recording
from phaselead.validation.journal import Outcome
from phaselead.validation.truth import Case, Hidden, load_truth

IN_UNIT = {("um", "um"): 1.0, ("of range", "of range"): 1.0, ("LSB", "LSB"): 1.0, ("nm/min", "um/s"): 1e-3 / 60}
"""Derived sizes by their unit and that of a truth, and what one is in the other."""
USUAL_BITS = 16
"""Of the output converter, which a stage file need not mention."""
FOLLOWED_UP = ("single", "sines", "closed_loop", "narrow", "slow_sines", "unreferenced")
"""Kinds of whose cases the proposed experiment is run."""


def try_case(folder: str, name: str, follow_up: bool = True) -> Outcome:
    """Run the case ``name`` of the generator in ``folder``; with ``follow_up`` the proposed experiment too.

    An exception is an outcome like any other: its text is under "error", and the answer is missing.
    """
    keep_freed_memory()
    case = load_truth(folder).case(name)
    outcome: Outcome = {
        "case": case.name,
        "kind": case.kind,
        "hidden": [
            {"name": h.name, "size": h.size, "value": h.value, "unit": h.unit, "axis": h.axis} for h in case.hidden
        ],
        "without": list(case.without),
        "allowed": list(getattr(case, "allowed", ())),
        "error": None,
    }
    try:
        return outcome | _tried(case, follow_up)
    except PhaseleadError as error:
        return outcome | {"error": str(error)}
    except Exception as error:  # a crash of the workflow counts as a wrong answer
        return outcome | {"error": f"{type(error).__name__}: {error}"}


def _tried(case: Case, follow_up: bool) -> Outcome:
    reference, train, holdout = case.records()
    stage = base_model(case, train if _base(case) == "linear" else reference)
    reference = reference if getattr(case, "referenced", True) else []
    began, spent = time.monotonic(), time.process_time()
    result = run_gap(stage, train, holdout, reference, without=case.without)
    found = {
        **answer(result, case.hidden),
        "seconds": time.monotonic() - began,
        "cpu_seconds": time.process_time() - spent,
        "floor": left_um(stage, bare) if (bare := case.bare_holdout()) is not None else None,
        "rows": sum(len(r.t_s) * len(r.axes) for r in [*reference, *train, *holdout]),
    }
    if follow_up and case.kind in FOLLOWED_UP:
        found["after_next"] = _after_next(case, stage, result, reference, train, holdout)
    return found


def _base(case: Case) -> Base:
    return getattr(case, "base", "operator")


def base_model(case: Case, records: Sequence[Recording]) -> Stage:
    """The model a lab would start from: a fit of the driven, open-loop ones of some records. Raises BadInput without
    any."""
    if not records:
        raise BadInput(f"{case.name}: has no records to make the base of; give reference records or base = 'linear'")
    driven = [r for r in records if _driven(r)]
    open_loop = [r for r in driven if all(a.r_um is None for a in r.axes.values())]
    axes: Any = {axis: _known(case) for axis in records[0].axes}
    parent = Stage(name="rig", axes=axes)
    return fit(open_loop or driven, _base(case), parent=parent)[0]


def _known(case: Case) -> AxisModel:
    """What a lab knows of its converter."""
    span_V = getattr(case, "output_V", None)
    if span_V is not None:
        return AxisModel(actuator=Actuator(bits=case.bits, u_min_V=span_V[0], u_max_V=span_V[1]))
    return AxisModel(actuator=Actuator(bits=case.bits)) if case.bits != USUAL_BITS else AxisModel()


def _driven(record: Recording) -> bool:
    return any(a.u_V is not None and float(np.ptp(a.u_V)) > STILL_V for a in record.axes.values())


def answer(result: GapResult, hidden: Sequence[Hidden]) -> Outcome:
    """The parts of a result that are scored."""
    scores: dict[str, float] = {}
    units = {h.name: h.unit for h in hidden}
    on_axis = {h.name: h.axis for h in hidden if h.axis is not None}
    sized = [e for e in result.effects if catalogue()[e.name].sizes and on_axis.get(e.name, e.axis) == e.axis]
    for candidate in result.candidates:
        scores[candidate.name] = max(candidate.score, scores.get(candidate.name, 0.0))
    return {
        "verdicts": list(result.verdicts),
        "named": [e.name for e in result.effects],
        "axes": [e.axis for e in result.effects],
        "scores": {e.name: scores.get(e.name) for e in result.effects},
        "probability": {e.name: e.probability for e in result.effects},
        "sizes": {e.name: _size(result, e, units.get(e.name, "")) for e in sized},
        "adopted": [[a.name, a.status] for a in result.adopted],
        "detectable": {d.name: d.size for d in result.detectable},
        "ties": [list(tie) for tie in result.ties],
        "next": _proposed(result),
        "excluded": [{"name": b.name, "upper_95": b.upper_95, "unit": b.unit, "axis": b.axis} for b in result.excluded],
        "untestable": list(result.untestable),
        "candidates": [[c.step, c.name, round(c.score, 1), c.remark] for c in result.candidates],
        "gap": {"before": result.gap.before, "after": result.gap.after, "floor": result.gap.floor},
    }


def _proposed(result: GapResult) -> Outcome | None:
    """What is proposed for which tie, and how probably it is said to settle it."""
    proposed = result.next_experiment
    if proposed is None:
        return None
    return {
        "tie": list(proposed.tells_apart),
        "waveform": proposed.waveform,
        "chance": proposed.chance,
        "needs_sensor": proposed.needs_sensor,
    }


def _size(result: GapResult, effect: NamedEffect, unit: str) -> list[float]:
    """Value and both ends of the 95 % interval of the size that a truth in ``unit`` is compared with.

    One that is derived as a person means it, where it has that unit, or else its first; of several modes those of the
    first, and of what comes from several axes the largest.
    """
    sizes, entry = result.sizes_of(effect), catalogue()[effect.name]
    found = [(sizes[d.name], IN_UNIT[d.unit, unit]) for d in entry.derived if (d.unit, unit) in IN_UNIT]
    if not found:
        first = [(sizes[p.name], 1.0) for p in entry.sizes if p.name in sizes]
        found = first if entry.place is Place.COUPLING else first[:1]
    (value, _, interval), in_unit = max(found, key=lambda one: float(np.max(np.abs(one[0][0]))))
    ends = np.atleast_2d(np.asarray(interval, dtype=float))[0]
    return [in_unit * float(number) for number in (np.atleast_1d(value)[0], *ends)]


def _after_next(
    case: Case,
    stage: Stage,
    result: GapResult,
    reference: Sequence[Recording],
    train: Sequence[Recording],
    holdout: Sequence[Recording],
) -> Outcome | None:
    """The answer after the proposed experiment has been added to the training records; None where none was proposed."""
    proposed = result.next_experiment
    if not result.ties or proposed is None or proposed.needs_sensor:
        return None
    excitation = excitation_of(vars(proposed))
    more = case.follow_up(excitation.voltage, excitation.seconds, proposed.axis)
    again = run_gap(stage, [*train, more], holdout, reference, without=case.without)
    return {"tie": list(proposed.tells_apart), **answer(again, case.hidden)}
