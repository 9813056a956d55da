"""What the gap workflow reads from recordings: one run per axis and record, checked, with its part in the trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePath
from typing import Literal, NoReturn

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify import DRIVEN_SHARE, SAME_RATE, STILL_V, AxisRun, SineDrive
from phaselead.model import Stage
from phaselead.record import (
    AxisRecord,
    Recording,
    Samples,
    refuse_clipped,
    refuse_gapped,
    same_measurement,
    t0_unix_s,
    times_in,
)

Role = Literal["train", "holdout", "reference"]

FEWEST_SCORED = 256
"""Scored rows of a record: with fewer neither its noise nor a block of it can be judged."""


@dataclass(frozen=True)
class GapRun:
    """One axis of one recording, arrays (n,)."""

    axis: str
    role: Role
    t_s: Samples
    u_V: Samples
    x_um: Samples
    r_um: Samples | None
    """Reference that the position followed; None in open loop."""
    start: int
    """First of the rows to score; those before it warm the memory."""
    stop: int
    """Row after the last of them."""
    source: str
    others_um: Mapping[str, Samples]
    """Positions of the other axes."""
    others_V: Mapping[str, Samples]
    """Voltages of the other axes."""
    later_s: float = 0.0
    """By which its times were moved, so that they count from the first record of its session."""

    @property
    def step_s(self) -> float:
        """Time between rows."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)

    @property
    def rows(self) -> slice:
        """The rows to score."""
        return slice(self.start, self.stop)

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last of these."""
        t_s = self.t_s[self.rows]
        return float(t_s[0]), float(t_s[-1])

    @property
    def file_t_s(self) -> Samples:
        """Its times (n,) as its file has them."""
        return self.t_s - self.later_s

    @property
    def name(self) -> str:
        """Of the file, for a person."""
        return PurePath(self.source).name or "recording"

    @cached_property
    def sine(self) -> SineDrive | None:
        """The sine that drives it, apart from still stretches at either end; None where it is idle or driven by another
        wave."""
        return self.as_fitted.sine if self.driven else None

    @property
    def as_fitted(self) -> AxisRun:
        """As the fits of ``identify`` take it."""
        return AxisRun(self.t_s, self.u_V, self.x_um, self.rows, self.axis, self.source)

    @cached_property
    def driven(self) -> bool:
        """Whether its own voltage moves where it is scored."""
        return bool(np.ptp(self.u_V[self.rows]) > STILL_V)

    @property
    def driven_well(self) -> bool:
        """Whether its own voltage moves, and not by what a monitor sees of that of another axis."""
        spans_V = [float(np.ptp(u[self.rows])) for u in self.others_V.values()]
        return self.driven and float(np.ptp(self.u_V[self.rows])) > DRIVEN_SHARE * max(spans_V, default=0.0)

    @cached_property
    def idle(self) -> bool:
        """Whether no axis is driven where it is scored: what moves then is noise and surroundings."""
        moved = any(np.ptp(u[self.rows]) > STILL_V for u in self.others_V.values())
        return not self.driven and not moved


def taken_at_once(runs: Sequence[GapRun]) -> bool:
    """Whether two records of one role were taken at the same time by their clock: which came first nobody knows."""
    return any(_overlap([run.span_s for run in runs if run.role == role]) for role in {run.role for run in runs})


def seconds_into_session(records: Sequence[Recording]) -> list[float]:
    """By record how long after the t_s = 0 of the first of its session its own was, by what the records say.

    All 0 where one does not say when it was taken, or where two were taken at once: then it is no clock of the stage.
    """
    t0_s = [t0_unix_s(record.meta) for record in records]
    known_s = [t for t in t0_s if t is not None]
    if len(known_s) < len(records):
        return [0.0] * len(records)
    later_s = [t - min(known_s) for t in known_s]
    judged = (record.t_s[record.scored] for record in records)
    spans_s = [(float(t[0]) + later, float(t[-1]) + later) for t, later in zip(judged, later_s, strict=True)]
    return [0.0] * len(records) if _overlap(spans_s) else later_s


def _overlap(spans_s: Sequence[tuple[float, float]]) -> bool:
    """Whether one of some spans begins before another that began earlier has ended."""
    return any(end_s > begin_s for (_, end_s), (begin_s, _) in pairwise(sorted(spans_s)))


def axis_runs(
    stage: Stage,
    train: Sequence[Recording],
    holdout: Sequence[Recording],
    reference: Sequence[Recording],
) -> dict[str, list[GapRun]]:
    """The runs of every axis that model and records share. Raises BadInput, one line, for what cannot be used."""
    if not train or not holdout:
        raise BadInput(
            "the gap needs records to train on and others to hold out; give --train and --holdout (in Python train= "
            "and holdout=)"
        )
    refuse_overlap(train, holdout, "training")
    refuse_overlap(reference, holdout, "reference")
    refuse_overlap(reference, train, "reference", "training")
    for records, what in ((train, "training"), (holdout, "held-out"), (reference, "reference")):
        for i, record in enumerate(records):
            refuse_overlap(records[:i], [record], what, what)
    parts: list[tuple[Role, Sequence[Recording]]] = [("train", train), ("holdout", holdout), ("reference", reference)]
    for _, records in parts:
        for record in records:
            _check(record)
    shared = [a for a in sorted(stage.axes) if all(_has(record, a) for record in (*train, *holdout))]
    axes = [a for a in shared if stage.axes[a].time is not None]
    if shared and not axes:
        raise BadInput(
            f"the model's axis {', '.join(shared)} has no time view to compare with; fit it to recordings first "
            "(phaselead fit)"
        )
    if not axes:
        _refuse_without_common_axis(stage, [*train, *holdout])
    later_s = seconds_into_session([*train, *holdout]) + seconds_into_session(reference)
    every = [(record, role) for role, records in parts for record in records]
    placed = list(zip(every, later_s, strict=True))
    runs = {a: [run_of(r, a, role, later) for (r, role), later in placed if _has(r, a)] for a in axes}
    for a, of_axis in runs.items():
        _refuse_other_rate(stage, a, of_axis)
    _refuse_all_still([r for of_axis in runs.values() for r in of_axis])
    return runs


def _refuse_without_common_axis(stage: Stage, records: Sequence[Recording]) -> NoReturn:
    """Say which record has not the axis that the model and the others have, or that no two agree."""
    strangers = [record for record in records if not set(complete_axes(record)) & set(stage.axes)]
    if not strangers:
        each = ", ".join(f"{record.source} has {_said(complete_axes(record))}" for record in records)
        raise BadInput(f"no axis is in all of the records: {each}; compare one axis at a time")
    one = min(strangers, key=lambda record: len(complete_axes(record)))
    found = complete_axes(one)
    if found and len(strangers) < len(records):
        raise BadInput(f"{one.source}: is of {_said(found)}, the model has {_said(sorted(stage.axes))}; leave it out")
    if not found:
        halves = ("position", "voltage") if any(a.x_um is None for a in one.axes.values()) else ("voltage", "position")
        raise BadInput(
            f"{one.source}: has no {halves[0]} beside its {halves[1]}; record both, or map the missing column"
        )
    raise BadInput(
        f"{one.source}: no common channel: the model has {_said(sorted(stage.axes))}, the record has both voltage and "
        f"position of {', '.join(found)}; map the missing column or fit that axis first"
    )


def _said(axes: Sequence[str]) -> str:
    return f"{'axis' if len(axes) == 1 else 'axes'} {', '.join(axes)}"


INSTEAD = {
    "held-out": "hold out other rows, e.g. another window of the file",
    "training": "a reference is from before what is missing now; give records of that time, or none",
}
ONCE = "the same rows tell nothing new; give them once"


def refuse_overlap(first: Sequence[Recording], later: Sequence[Recording], what: str, now: str = "held-out") -> None:
    """Refuse rows that are given twice, in two roles or in one: windows of one file that share time, or a copy of
    it."""
    also = f"a {what} record" if what != now else "another"
    instead = INSTEAD[now] if what != now else ONCE
    for record in first:
        for other in later:
            if same_measurement(record, other):
                raise BadInput(f"{other.source}: the {now} record is also {also} ({record.source}); {instead}")


def _check(record: Recording) -> None:
    """Refuse a record that is gapped, clipped, too short or holds what is no number."""
    refuse_gapped(record)
    refuse_clipped(record)
    rows = len(record.t_s[record.scored])
    if rows < FEWEST_SCORED:
        raise BadInput(
            f"{record.source}: {rows} rows are too short to compare a model with; record at least {FEWEST_SCORED}"
        )
    for name, axis in record.axes.items():
        for column, values in (("u_V", axis.u_V), ("x_um", axis.x_um)):
            if values is not None and not np.isfinite(values).all():
                raise BadInput(f"{record.source}: {column} of {name} holds what is no number; cut those rows")


def _complete(axis: AxisRecord | None) -> bool:
    """Whether voltage and position of an axis are there."""
    return axis is not None and axis.u_V is not None and axis.x_um is not None


def _has(record: Recording, axis: str) -> bool:
    return _complete(record.axes.get(axis))


def complete_axes(record: Recording) -> list[str]:
    """Those of which voltage and position are there."""
    return sorted(axis for axis in record.axes if _has(record, axis))


def run_of(record: Recording, axis: str, role: Role, later_s: float = 0.0) -> GapRun:
    """One axis of a record, which has it and began so much later than its session."""
    own = record.axes[axis]
    assert own.u_V is not None
    assert own.x_um is not None
    start, stop, _ = record.scored.indices(len(record.t_s))
    others = {name: a for name, a in record.axes.items() if name != axis and _complete(a)}
    return GapRun(
        axis=axis,
        role=role,
        t_s=record.t_s + later_s,
        u_V=own.u_V,
        x_um=own.x_um,
        r_um=own.r_um,
        start=start,
        stop=stop,
        source=record.source,
        others_um={name: a.x_um for name, a in others.items() if a.x_um is not None},
        others_V={name: a.u_V for name, a in others.items() if a.u_V is not None},
        later_s=later_s,
    )


def _refuse_other_rate(stage: Stage, axis: str, runs: Sequence[GapRun]) -> None:
    """Refuse runs at another sampling rate than the model's, and a sensor that says nothing."""
    view = stage.axes[axis].time
    assert view is not None
    for run in runs:
        rate_Hz = 1 / run.step_s
        instead = f"record at {view.rate_Hz:.6g} Hz, or fit a model to records of {rate_Hz:.6g} Hz (phaselead fit)"
        if abs(rate_Hz / view.rate_Hz - 1) > SAME_RATE:
            raise BadInput(
                f"{run.source}: is sampled at {rate_Hz:.6g} Hz but the model was fitted at {view.rate_Hz:.6g} Hz; "
                f"{times_in(rate_Hz, view.rate_Hz) or instead}"
            )
        if run.driven and np.ptp(run.x_um[run.rows]) == 0:
            raise BadInput(f"{run.source}: the position of {axis} never changes; is the sensor connected and mapped?")


def _refuse_all_still(runs: Sequence[GapRun]) -> None:
    """Refuse training or held-out records of which none is driven."""
    for role in ("train", "holdout"):
        mine = [run for run in runs if run.role == role]
        if not any(run.driven for run in mine):
            raise BadInput(
                f"{mine[0].source}: the voltage is constant in every {role} record; nothing can be learned from it: "
                "drive the stage"
            )
