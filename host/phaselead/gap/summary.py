"""What the gap workflow found, as tables, columns and a figure."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from phaselead.model import Stage
from phaselead.record import write_text
from phaselead.result import Result, Table, json_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_CELLS = 5
"""Of the largest cells, in the table."""


class GapSummary(Result):
    """How a ``GapResult`` is shown. Its fields are those of the result."""

    stage: Stage
    verdicts: Sequence[str]
    effects: Sequence[Any]
    ties: Sequence[Sequence[str]]
    excluded: Sequence[Any]
    untestable: Sequence[str]
    where: Sequence[Any]
    gap: Any
    next_experiment: Any
    traces: Sequence[Any]
    messages: Sequence[str]
    verification: Any

    @property
    def next_model(self) -> Stage:
        """The model with what was found; the one that was compared is untouched."""
        return self.stage

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each number of each named effect: effect, axis, parameter, value, low_95, high_95, unit and
        share (of the unexplained power)."""
        names = ("effect", "axis", "parameter", "value", "low_95", "high_95", "unit", "share")
        rows = [row for effect in self.effects for row in _numbers(effect)]
        return {name: [row[i] for row in rows] for i, name in enumerate(names)}

    def tables(self) -> list[Table | str]:
        gap = self.gap
        floor = f"floor {gap.floor:.4g} ({gap.floor_from})"
        parts: list[Table | str] = [
            f"verdict: {', '.join(self.verdicts)}",
            f"held-out gap {gap.before:.4g} -> {gap.after:.4g} {gap.unit} rms; {floor}",
        ]
        if self.effects:
            parts.append(self._effects())
        parts += [f"these records cannot tell apart: {', '.join(tie)}" for tie in self.ties]
        if self.where:
            rows = ((c.by, c.cell, f"{100 * c.share:.0f} %") for c in self.where[:MOST_CELLS])
            parts.append(Table(("where", "cell", "share of the unexplained power"), tuple(rows)))
        if self.excluded:
            bounds = ((b.name, f"{b.upper_95:.2g}", "" if b.unit == "1" else b.unit) for b in self.excluded)
            parts.append(Table(("not named", "at most (95 %)", "unit"), tuple(bounds)))
        if self.untestable:
            parts.append(f"not testable with these records: {', '.join(self.untestable)}")
        if self.next_experiment is not None:
            parts.append(_experiment(self.next_experiment))
        return [*parts, *self.messages]

    def _effects(self) -> Table:
        rows = tuple(
            (effect, axis or "", parameter, f"{value:.4g}", f"{low:.4g} .. {high:.4g}", unit, f"{100 * share:.0f} %")
            for effect, axis, parameter, value, low, high, unit, share in zip(*self.columns.values(), strict=True)
        )
        return Table(("effect", "axis", "parameter", "value", "95 % interval", "unit", "share"), rows)

    def as_json(self) -> dict[str, Any]:
        """gap.json."""
        raise NotImplementedError

    def save_json(self, path: str | os.PathLike[str]) -> None:
        """Writes gap.json, with what tracking on a device came to where that was asked for."""
        tracked = {} if self.verification is None else self.verification.as_dict()
        write_text(os.fspath(path), json_text(self.as_json() | tracked))

    def plot(self) -> Figure:
        """What the model left of the held-out record it missed most, before and after; and the cells it lies in."""
        from phaselead.gap.pictures import gap_figure  # matplotlib is slow to load and is needed here only

        return gap_figure(self.traces, self.where)

    def __repr__(self) -> str:
        return f"<GapResult: {', '.join(self.verdicts)}; {self.gap.before:.3g} -> {self.gap.after:.3g} {self.gap.unit}>"


def _numbers(effect: Any) -> list[tuple[Any, ...]]:
    """One row for each number of an effect; those of a list are numbered from 1."""
    rows: list[tuple[Any, ...]] = []
    params: Mapping[str, Any] = effect.params
    for name, (value, unit, interval) in params.items():
        several = isinstance(value, tuple)
        values, pairs = (value, interval) if several else ((value,), (interval,))
        for i, (one, (low, high)) in enumerate(zip(values, pairs, strict=True), 1):
            label = f"{name} {i}" if several else name
            rows.append((effect.name, effect.axis, label, one, low, high, "" if unit == "1" else unit, effect.share))
    return rows


def _experiment(e: Any) -> str:
    low, high = e.band
    band = f"{low:.3g} Hz" if low == high else f"{low:.3g}..{high:.4g} Hz"
    text = (
        f"next experiment: {e.waveform}, {e.level:.3g} V peak-to-peak about {e.bias:.3g} V, {band}, {e.seconds:.3g} s"
    )
    return f"{text}; no voltage tells them apart, it takes {e.needs_sensor}" if e.needs_sensor else text
