"""The model at the end of the search, and what it leaves of every record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.base import with_operator
from phaselead.gap.disturbances import RecordOffset
from phaselead.gap.grow import Growth
from phaselead.gap.left import Left
from phaselead.gap.records import Role, Run
from phaselead.gap.refit import Fitted
from phaselead.gap.residual import Track, track
from phaselead.gap.result import Gap, Trace
from phaselead.model import AxisModel
from phaselead.record import Samples

ROUNDS = 2


@dataclass(frozen=True)
class Final:
    """Tracks under the base as given and under the final base with its effects."""

    axis: AxisModel
    fitted: Fitted
    before: tuple[Track, ...]
    after: tuple[Track, ...]
    gap: Gap

    @property
    def rows(self) -> int:
        """Held-out rows."""
        return sum(t.run.stop - t.run.start for t in self.after if t.run.role == "holdout")

    def lefts(self, role: Role) -> list[Left]:
        """What the final model leaves; the reference records are without what was found."""
        entries = () if role == "reference" else self.fitted.entries
        return [Left(t.run, _own_offset_removed(t, t.error(entries))) for t in self.after if t.run.role == role]

    def offsets(self, role: Role) -> list[RecordOffset]:
        """What the final model leaves of each record on average; the reference records are without what was found."""
        entries = () if role == "reference" else self.fitted.entries
        return [
            RecordOffset(float(t.run.t_s[t.run.rows].mean()), float(t.error(entries).mean()), t.run.idle)
            for t in self.after
            if t.run.role == role
        ]

    def before_lefts(self, role: Role) -> list[Left]:
        """What the base as given leaves."""
        return [Left(t.run, _own_offset_removed(t, t.error())) for t in self.before if t.run.role == role]

    def share_of(self, name: str) -> float:
        """Of the power that the base leaves of the held-out records: what comes back without the effect."""
        before = _power([left.error_um for left in self.before_lefts("holdout")])
        after = _power([left.error_um for left in self.lefts("holdout")])
        entries = [entry for entry in self.fitted.entries if entry[0].name != name]
        if len(entries) == len(self.fitted.entries):  # it became the base's own operator
            alone = [t for t in self.after if t.run.role == "holdout"]
            return max(before - _power([_own_offset_removed(t, t.error()) for t in alone]), 0.0) / max(before, 1e-30)
        without = [_own_offset_removed(t, t.error(entries)) for t in self.after if t.run.role == "holdout"]
        return float(np.clip((_power(without) - after) / max(before, 1e-30), 0.0, 1.0))

    def traces(self) -> list[Trace]:
        """Held-out records: measured, before, after, each model at the record's own offset."""
        found = []
        for was, now in zip(self.before, self.after, strict=True):
            if was.run.role != "holdout":
                continue
            run, rows = was.run, was.run.rows
            x = run.x_um[rows]
            before = x - _own_offset_removed(was, was.error())
            after = x - _own_offset_removed(now, now.error(self.fitted.entries))
            found.append(Trace(run.name, run.axis, run.t_s[rows], run.u_V[rows], x, before, after))
        return found


def _own_offset_removed(t: Track, error: Samples) -> Samples:
    return np.asarray(error - error.mean())


def _power(errors: Sequence[Samples]) -> float:
    return float(np.mean(np.concatenate(errors) ** 2))


def finish(growth: Growth, runs: Sequence[Run]) -> Final:
    """Fit an operator of our own once more beside the effects, and measure the gap."""
    axis, fitted = growth.bench.axis, growth.fitted
    if growth.operator is not None and fitted.entries:
        axis = _operator_beside(axis, fitted, [r for r in runs if r.role == "train"])
    before = tuple(track(growth.start, run) for run in runs)
    after = tuple(track(axis, run) for run in runs)
    final = Final(axis, fitted, before, after, Gap(0.0, 0.0, 0.0))
    return Final(axis, fitted, before, after, _gap(final, growth))


def _operator_beside(axis: AxisModel, fitted: Fitted, train: Sequence[Run]) -> AxisModel:
    """The plays fitted to what the effects leave; the better of this and what it was."""
    best, best_left = axis, _train_power(axis, fitted, train)
    for _ in range(ROUNDS):
        tracks = [track(best, run) for run in train]
        beyond = [t.answer(fitted.entries) - t.answer() for t in tracks]
        tried = with_operator(best, train, beyond)
        left = _train_power(tried, fitted, train)
        if left >= best_left:
            break
        best, best_left = tried, left
    return best


def _train_power(axis: AxisModel, fitted: Fitted, train: Sequence[Run]) -> float:
    return _power([_own_offset_removed(t, t.error(fitted.entries)) for t in (track(axis, run) for run in train)])


def _gap(final: Final, growth: Growth) -> Gap:
    before = float(np.sqrt(_power([left.error_um for left in final.before_lefts("holdout")])))
    after = float(np.sqrt(_power([left.error_um for left in final.lefts("holdout")])))
    reference = final.lefts("reference")
    if reference:
        floor = float(np.sqrt(_power([left.error_um for left in reference])))
        return Gap(before, after, floor, "um", "what the model leaves of the reference records")
    floor = growth.bench.noise.level_um
    return Gap(before, after, min(floor, after), "um", "what the richest model of all leaves of the training records")
