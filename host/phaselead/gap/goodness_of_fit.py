"""The model at the end of the search, and what it leaves of every record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from phaselead.gap.base_operator import with_refitted_operator
from phaselead.gap.error_rates import TWO_SIDED_95
from phaselead.gap.findings import GapSize, Trace
from phaselead.gap.floor import Floor
from phaselead.gap.history import before_record, from_its_memory, history_um
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import LEAST_OF_MATERIAL, MOST_MISSED
from phaselead.gap.records import GapRun, Role
from phaselead.gap.residual import ModelledRun, RunResidual, base_entries, modelled_run, power_um2
from phaselead.gap.ringing import without_ringing
from phaselead.gap.selection import Selection
from phaselead.gap.unexplained import Unexplained
from phaselead.model import AxisModel
from phaselead.record import Samples

OF_THE_RICHEST = "what the richest model of all leaves of the training records"
"""What the floor is without reference records."""


@dataclass(frozen=True)
class WithoutHistory:
    """What a final model leaves of the records, about their means, without a drift and without what slow effects had
    done before these began, as far as each record tells: no voltage of theirs predicts it."""

    train: list[RunResidual]
    holdout: list[RunResidual]
    gap: GapSize
    """What the base and the final model leave of the held-out records without the same; the floor is that with it."""


@dataclass(frozen=True)
class FinalFit:
    """The model at the end of a search and the runs under it."""

    axis: AxisModel
    """The base, whose plays may have been fitted anew."""
    entries: tuple[SizedEffect, ...]
    """The effects beyond it."""
    before: tuple[ModelledRun, ...]
    """Every run under the base as given."""
    after: tuple[ModelledRun, ...]
    """Every run under ``axis``, the effects not yet in it, from the memory that suits it with what is named."""
    gap: GapSize
    richest_um: float = math.inf
    """RMS that the richest model of all leaves of the training records: the floor where no reference record says."""

    @property
    def rows(self) -> int:
        """Held-out rows."""
        return sum(t.run.stop - t.run.start for t in self.after if t.run.role == "holdout")

    @property
    def unexplained_um(self) -> float:
        """RMS that is left of the held-out records beyond the floor, where it is clearly above that."""
        after, floor = self.gap.after, self.gap.floor
        return math.sqrt(after**2 - floor**2) if self.gap.clearly_above_floor else 0.0

    def acting(self, role: Role) -> list[tuple[ModelledRun, tuple[SizedEffect, ...]]]:
        """Every run of a role, and the effects that act in it: none in a reference record."""
        entries = () if role == "reference" else self.entries
        return [(t, entries) for t in self.after if t.run.role == role]

    def residuals(self, role: Role) -> list[RunResidual]:
        """Residuals of the final model, about their means. The reference records are without the effects."""
        return [RunResidual(t.run, t.error_about_mean(acting)) for t, acting in self.acting(role)]

    def without_ringing(self, role: Role) -> list[RunResidual]:
        """The same residuals, those of records at rest without what the model's modes still ring of what was before: it
        is the stage's own, and dies away."""
        left = [(t, acting, t.error_about_mean(acting)) for t, acting in self.acting(role)]
        return [RunResidual(t.run, without_ringing(t, acting, e) if t.run.idle else e) for t, acting, e in left]

    def without_history(self, drift_um_per_s: float = 0.0) -> WithoutHistory:
        """What is left, and the gap, without what slow effects had done before the records began, and without a drift
        that was found. That is estimated from the residual of the final model; the same curve is subtracted from the
        residual of the base for ``gap.before``."""
        train, holdout = (self._pairs_without_history(role, drift_um_per_s) for role in ("train", "holdout"))
        of_base = [t.error() for t in self.before if t.run.role == "holdout"]
        before = [_about_mean(error - history) for error, (_, history) in zip(of_base, holdout, strict=True)]
        after = [left for left, _ in holdout]
        gap = replace(self.gap, before=math.sqrt(power_um2(before)), after=_rms(after))
        return WithoutHistory([left for left, _ in train], after, gap)

    def _pairs_without_history(self, role: Role, drift_um_per_s: float) -> list[tuple[RunResidual, Samples]]:
        """Of each run what is left without a drift, without what slow effects had done before it began and, at rest,
        without what the base still carries from then; and all of these together (n,)."""
        pairs = []
        for t, acting in self.acting(role):
            left = t.error_about_mean(acting)
            apart = drift_um_per_s * _about_mean(t.run.t_s[t.run.rows])
            apart = apart + history_um(t, acting, left - apart)
            if t.run.idle:
                apart = apart + _history_of_base(t, left - apart)
            pairs.append((RunResidual(t.run, left - apart), apart))
        return pairs

    def with_entries(self, entries: Sequence[SizedEffect]) -> FinalFit:
        """The same with further effects, and the gap that they leave."""
        richer = replace(self, entries=(*self.entries, *entries))
        after = _rms(richer.residuals("holdout"))
        referenced = any(t.run.role == "reference" for t in self.after)
        if referenced:
            return replace(richer, gap=replace(self.gap, after=after))
        return replace(richer, gap=GapSize.below(self.gap.before, after, self.richest_um, OF_THE_RICHEST))

    def with_plays_refitted(self) -> FinalFit:
        """The same with plays fitted anew to what the effects leave of the training records, where that leaves less:
        they had been fitted to what is now the effects'."""
        after = with_refitted_operator(self.after, self.entries)
        return replace(self, axis=after[0].axis, after=tuple(after)).with_entries(())

    def residuals_before(self) -> list[RunResidual]:
        """Residuals of the base as given, of the held-out records about their means."""
        return [RunResidual(t.run, t.error_about_mean()) for t in self.before if t.run.role == "holdout"]

    def share_of(self, name: str) -> float:
        """Share of the power that the base leaves of the held-out records which comes back without the effect
        ``name``."""
        before = power_um2([left.error_um for left in self.residuals_before()])
        after = power_um2([left.error_um for left in self.residuals("holdout")])
        entries = [entry for entry in self.entries if entry[0].name != name]
        if len(entries) == len(self.entries):  # the base took it up as plays
            alone = [t.error_about_mean() for t, _ in self.acting("holdout")]
            return max(before - power_um2(alone), 0.0) / max(before, 1e-30)
        without = [t.error_about_mean(entries) for t, _ in self.acting("holdout")]
        return float(np.clip((power_um2(without) - after) / max(before, 1e-30), 0.0, 1.0))

    def explained_um2(self, names: Sequence[str]) -> float:
        """Mean square over the held-out rows that comes back without each of some effects, summed over these."""
        before = power_um2([left.error_um for left in self.residuals_before()])
        return before * sum(self.share_of(one.name) for one, _ in self.entries if one.name in names)

    def traces(self) -> list[Trace]:
        """Measured position of every held-out record, and each model's at the record's own offset."""
        found = []
        for was, now in zip(self.before, self.after, strict=True):
            if was.run.role != "holdout":
                continue
            run, rows = was.run, was.run.rows
            x = run.x_um[rows]
            before = x - was.error_about_mean()
            after = x - now.error_about_mean(self.entries)
            found.append(Trace(run.name, run.axis, run.file_t_s[rows], run.u_V[rows], x, before, after))
        return found


def _history_of_base(modelled: ModelledRun, error: Samples) -> Samples:
    """The part (n,) of a residual at rest, about its mean, that the base's own lags and modes may still carry from
    before a run: each at most as much as in 95 of 100 stages."""
    before = np.concatenate([np.zeros((len(error), 0)), *before_record(modelled, base_entries(modelled.axis))], axis=1)
    if not before.any():
        return np.zeros(len(error))
    before = before - before.mean(axis=0)
    amounts = lsq_linear(before, error, bounds=(-TWO_SIDED_95, TWO_SIDED_95), method="bvls").x
    return np.asarray(before @ amounts)


def _about_mean(values: Samples) -> Samples:
    return np.asarray(values - values.mean())


def _rms(left: Sequence[RunResidual]) -> float:
    """In um, over all rows."""
    return math.sqrt(power_um2([one.error_um for one in left]))


def final_fit(selection: Selection, runs: Sequence[GapRun], floor: Floor) -> FinalFit:
    """The model that a search ended with on all runs, each from the memory that suits it best, as the stage file will
    be judged, and the gap. Plays that the base was given are fitted once more, now to what the effects leave.
    ``floor``: what it is where no reference record says."""
    before = tuple(modelled_run(selection.start, run) for run in runs)
    after = list(before)
    if selection.memory is not None:
        after = with_refitted_operator([modelled_run(selection.base, run) for run in runs], selection.entries)
    if selection.entries:
        changed = [() if run.role == "reference" else selection.entries for run in runs]
        after = [from_its_memory(t, beside) for t, beside in zip(after, changed, strict=True)]
    final = FinalFit(after[0].axis, selection.entries, before, tuple(after), GapSize(0.0, 0.0, 0.0), floor.rms_um)
    return replace(final, gap=_gap(final))


def _gap(final: FinalFit) -> GapSize:
    """RMS before and after over all held-out rows, and the floor."""
    before = _rms(final.residuals_before())
    after = _rms(final.residuals("holdout"))
    reference = final.residuals("reference")
    if reference:
        floor = _rms(reference)
        return GapSize(before, after, floor, "um", "what the model leaves of the reference records")
    return GapSize.below(before, after, final.richest_um, OF_THE_RICHEST)


def excused_um2(gap: GapSize, exactly_um2: float = 0.0) -> float:
    """Power in um^2 that equations of names may miss of what these explain of the held-out records. ``exactly_um2``:
    what effects with exact equations explain; of that only as much may be left as the ceramic's equations miss at
    least, since another voltage reaches it."""
    explained_um2 = max(gap.before**2 - gap.after**2, 0.0)
    exactly_um2 = min(exactly_um2, explained_um2)
    return MOST_MISSED**2 * (explained_um2 - exactly_um2) + LEAST_OF_MATERIAL**2 * exactly_um2


def too_much_for_names(left: Unexplained, gap: GapSize) -> bool:
    """Whether so much of the gap before can be predicted beside names that their equations do not bear these."""
    return more_than_equations_miss(left, gap, (MOST_MISSED * gap.before) ** 2)


def more_than_equations_miss(left: Unexplained, gap: GapSize, excused: float) -> bool:
    """Whether more can be predicted from the voltage beside names than this power in um^2, which is excused."""
    return left.something_missing and left.share * gap.after**2 > excused
