"""A model judged on recordings, as one result: a table, a figure, columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, get_args

from phaselead.errors import BadInput, more_like_it
from phaselead.identify.runs import SAME_RATE, usable
from phaselead.identify.simple_changes import Size
from phaselead.identify.verification import Verification, View, verification_dict, verify
from phaselead.model import Stage, driven_far_beyond, in_other_times, out_of_scale, scale_doubt
from phaselead.record import Recording, glitch_doubts
from phaselead.result import Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHAT_NEXT = "what it is, and what looks like it, `phaselead gap` tells from several records"
"""Said once behind what describes errors."""


class Verifications(Result, list[Verification]):
    """Errors of one view of a model, one entry for each driven axis of each recording: a list that prints as a table.

    Each entry has ``file``, ``axis``, ``max_um``, ``mean_um`` (mean of the error's size), ``range_um`` (measured
    peak-to-peak), and ``max_pct`` and ``mean_pct`` of that range. ``left_out`` are lines on recordings of which nothing
    could be used, and ``doubts`` on those that do not seem to be of this model or in its units. ``described`` of an
    entry says which simple changes (a shift of zero, a gain, a delay) describe an error that is larger than the model
    should leave.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     model = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    ...     other = dev.record("sine:4V@5Hz", duration=1)
    >>> report = pl.verify(model, other)
    >>> len(report), report[0].axis, report[0].max_pct < 10
    (1, 'x', True)
    >>> print(report)  # doctest: +ELLIPSIS
    time view ...
    record       axis  max (µm)  mean |e| (µm)  range (µm)  max (%)  mean (%)
    sine:4V@5Hz  x     ...
    """

    def __init__(
        self,
        verifications: Iterable[Verification] = (),
        view: View = "time",
        model: str = "",
        model_sha256: str = "",
        left_out: Iterable[str] = (),
        doubts: Iterable[str] = (),
    ) -> None:
        list.__init__(self, verifications)
        self.model_sha256 = model_sha256
        self.view: View = view
        self.model_name = model
        self.left_out, self.doubts = list(left_out), list(doubts)

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each verification: file, axis, max_um, mean_um, range_um, max_pct, mean_pct."""
        names = ("file", "axis", "max_um", "mean_um", "range_um", "max_pct", "mean_pct")
        return {name: [asdict(one)[name] for one in self] for name in names}

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead verify --json`` writes it; with ``left_out`` and ``doubts`` where there are any."""
        remarks = {"left_out": self.left_out, "doubts": self.doubts}
        records = {"records": [verification_dict(one) for one in self]}
        return records | {name: lines for name, lines in remarks.items() if lines}

    def remarks(self) -> list[str]:
        """One line for each recording, or axis of one, that was left out, on those that the model was fitted on, and
        for those whose error the same changes describe, or none does, then of that with the largest."""
        left_out = [f"left out: {line}" for line in self.left_out]
        own = list(dict.fromkeys(v.file for v in self if v.fitted_on))
        fitted_on = [f"the model was fitted on rows of {own[0]}{more_like_it(len(own) - 1)}"] if own else []
        alike: dict[tuple[str, tuple[Size, ...]], list[tuple[float, str]]] = {}
        for v in self:
            if v.described is not None:
                said = f"{v.file}: axis {v.axis} {v.described.said()}"
                alike.setdefault((v.axis, v.described.about), []).append((v.described.error_um_rms, said))
        each = [
            (lines[0] if about else max(lines))[1] + more_like_it(len(lines) - 1) for (_, about), lines in alike.items()
        ]
        return [*left_out, *fitted_on, *each, *([WHAT_NEXT] if each else [])]

    def tables(self) -> list[Table | str]:
        headings = ("record", "axis", "max (µm)", "mean |e| (µm)", "range (µm)", "max (%)", "mean (%)")
        rows = tuple(
            (
                v.file,
                v.axis,
                *(f"{value:.4g}" for value in (v.max_um, v.mean_um, v.range_um)),
                *(f"{value:.2f}" for value in (v.max_pct, v.mean_pct)),
            )
            for v in self
        )
        table = Table(headings, rows, f"{self.view} view of {self.model_name}" if self.model_name else "")
        return [table, *self.remarks(), *self.doubts]

    def plot(self) -> Figure:
        """Largest and mean error of every record, in per cent of its range."""
        from phaselead.identify.pictures import error_bars  # matplotlib is slow to load and is needed here only

        labels = [f"{PurePath(v.file).name or 'recording'} ({v.axis})" for v in self]
        return error_bars(labels, [v.max_pct for v in self], [v.mean_pct for v in self])

    def __repr__(self) -> str:
        return f"<{len(self)} verifications, {self.view} view>"


def judge(
    stage: Stage, recordings: Sequence[Recording], view: View, model: str, *, refit_offset: bool = False
) -> Verifications:
    """``verify`` on the recordings of which something can be used; the others are left out. ``model`` is what the stage
    is called. Raises BadInput where none is left."""
    if view not in get_args(View):
        raise BadInput(f"view={view!r}: a model has the views {' and '.join(get_args(View))}")
    if not recordings:
        raise BadInput("no recordings to verify the model on; give at least one file")
    kept, left_out = usable(recordings)
    found = verify(stage, kept, view, refit_offset=refit_offset)
    unlike = {one.file for one in found if one.described is not None}
    late = _held_at_another_rate(stage, [one for one in kept if one.source in unlike])
    doubts = [*in_other_times(stage, kept), *late, *driven_far_beyond(stage, kept)]
    doubts += [*glitch_doubts(kept), *_out_of_scale(found), *_about_starts(found)]
    return Verifications(found, view, model, stage.sha256, left_out, doubts)


def _held_at_another_rate(stage: Stage, recordings: Sequence[Recording]) -> list[str]:
    """Of records that the model misses and that have another sampling rate than it, in one line for each rate: a
    voltage that is held from row to row is late by half a row, of which the delay of the model has its own."""
    lines: dict[str, list[str]] = {}
    for recording in recordings:
        rates_Hz = [axis.time.rate_Hz for name, axis in stage.axes.items() if name in recording.axes and axis.time]
        if rates_Hz and abs(recording.rate_Hz / rates_Hz[0] - 1) > SAME_RATE:
            late_s = (1 / recording.rate_Hz - 1 / rates_Hz[0]) / 2
            when = f"{1e3 * abs(late_s):.3g} ms {'later' if late_s > 0 else 'earlier'}"
            rates = f"is sampled at {recording.rate_Hz:.6g} Hz, the model at {rates_Hz[0]:.6g} Hz"
            lines.setdefault(
                f"{rates}: if its voltage was held from row to row, that alone comes {when} than the model says", []
            ).append(recording.source)
    return [f"{names[0]}: {line}{more_like_it(len(names) - 1)}" for line, names in lines.items()]


def _out_of_scale(found: Sequence[Verification]) -> list[str]:
    """Records that move as no change of the stage makes them, in one line for all that move as far."""
    said: dict[str, list[Verification]] = {}
    for one in found:
        if one.gain is not None and out_of_scale(one.gain):
            said.setdefault(scale_doubt([one.gain]), []).append(one)
    return [f"{of[0].file}: axis {of[0].axis} moves {doubt}{more_like_it(len(of) - 1)}" for doubt, of in said.items()]


def _about_starts(found: Sequence[Verification]) -> list[str]:
    """Records that probably began elsewhere than at rest, in one line for all."""
    lines = [one.about_start for one in found if one.about_start]
    return [lines[0] + more_like_it(len(lines) - 1)] if lines else []
