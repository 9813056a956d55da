"""What the gap workflow found, as one value: tables, columns, a figure, gap.json, and what the report draws."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from phaselead.gap.derived import derived_of
from phaselead.gap.findings import (
    PROVISIONAL,
    Adopted,
    Bound,
    Candidate,
    Cell,
    Detectable,
    Estimate,
    Estimates,
    GapSize,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
    parameter_rows,
    parameter_texts,
)
from phaselead.gap.locate import excludes, explained, headline, unit_of
from phaselead.gap.unexplained import Unexplained
from phaselead.gap.verify_on import TrackingComparison
from phaselead.model import Scene, Stage, catalogue
from phaselead.quantity import digits
from phaselead.record import Source, write_text
from phaselead.result import Result, Table, json_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAY_HIDE = (
    "nothing that these records can show was found, and yet more is left than the floor: what they cannot show may be "
    "there"
)
"""Said beside `none` where far more is left than the floor."""
MOST_CELLS = 5
"""Of the largest cells, in a notebook."""


@dataclass(frozen=True, repr=False)
class GapResult(Result):
    """The answer of the gap workflow and what led to it. ``stage`` is the next stage; the input is untouched.

    ``effects`` are what the data demand, strongest first; ``gap`` the held-out rms ``before`` and ``after`` and its
    ``floor``, in um; ``next_model`` the model with what was found.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> def made(f_Hz, seed):
    ...     t_s = np.arange(300) / 200
    ...     u_V = 2.5 - 2.5 * np.cos(2 * np.pi * f_Hz * t_s)
    ...     noise_um = np.random.default_rng(seed).normal(0, 0.01, 300)
    ...     return pl.recording(t_s=t_s, u_V=u_V, x_um=20 * u_V + noise_um)
    >>> model = pl.fit(made(2, seed=0), base="linear")
    >>> gap = pl.gap(model, train=made(2, seed=1), holdout=made(3, seed=2))
    >>> gap.gap.after <= gap.gap.before
    True
    >>> gap.next_model.save("next.toml")
    >>> print(gap)  # doctest: +ELLIPSIS
    verdict: none
    ...
    """

    stage: Stage
    verdicts: tuple[str, ...]
    effects: tuple[NamedEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    excluded: tuple[Bound, ...]
    untestable: tuple[str, ...]
    where: tuple[Cell, ...]
    gap: GapSize
    next_experiment: NextExperiment | None
    holdout_sha256: tuple[str, ...]
    candidates: tuple[Candidate, ...] = ()
    spans_s: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """By axis, first and last time of each record that may hold what was found."""
    traces: tuple[Trace, ...] = ()
    spectra: tuple[Spectrum, ...] = ()
    untestable_why: dict[str, str] = field(default_factory=dict)
    """By name, why the records say nothing of an effect."""
    messages: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    """Whether records and model are of one stage and in the same units: said first, since all else rests on it."""
    seconds: float = 0.0
    adopted: tuple[Adopted, ...] = ()
    """What the next stage has that the one compared had not, and whether each name is vouched for."""
    unexplained: Unexplained | None = None
    """How much of what the model with its names leaves can be predicted from the voltage, on the axis where it is
    most."""
    detectable: tuple[Detectable, ...] = ()
    """The size from which each effect is expected to be named, by noise, the base's misfit and the excitation alone."""
    base: Stage | None = None
    """The model that was compared."""
    sources: Mapping[str, tuple[Source, ...]] = field(default_factory=dict)
    """The recordings by what they were given as: train, holdout, reference."""
    verification: TrackingComparison | None = None
    """What tracking on a device came to, where that was asked for."""

    def __post_init__(self) -> None:
        """What was adopted, for certain or not, is neither bounded nor untestable, on whatever axis: an answer does not
        contradict itself."""
        has = {one.name for one in self.adopted}
        object.__setattr__(self, "excluded", tuple(b for b in self.excluded if b.name not in has))
        object.__setattr__(self, "untestable", tuple(name for name in self.untestable if name not in has))

    def as_json(self) -> dict[str, Any]:
        """The content of gap.json, with what tracking on a device came to where that was asked for."""
        tracked = {} if self.verification is None else self.verification.as_dict()
        return {
            "verdicts": list(self.verdicts),
            "effects": [_effect(effect, self.sizes_of(effect)) for effect in self.effects],
            "adopted": [vars(one) for one in self.adopted],
            "ties": [list(tie) for tie in self.ties],
            "excluded": [
                {"name": b.name, "axis": b.axis, "upper_95": b.upper_95, "unit": b.unit} for b in self.excluded
            ],
            "untestable": list(self.untestable),
            "untestable_why": {name: self.untestable_why.get(name, "") for name in self.untestable},
            "where": [_cell(c) for c in self.where],
            "gap": {name: getattr(self.gap, name) for name in ("before", "after", "floor", "unit", "floor_from")},
            "unexplained": None if self.unexplained is None else self.unexplained.as_dict(),
            "next_experiment": _experiment(self.next_experiment),
            "doubts": list(self.doubts),
            "holdout_sha256": list(self.holdout_sha256),
            **tracked,
        }

    @property
    def compared(self) -> Stage:
        """The model that was compared, where it is known; else the next one."""
        return self.base or self.stage

    def sizes_of(self, effect: NamedEffect) -> Mapping[str, Estimate | Estimates]:
        """Its parameters and, behind them, what they come to as a person means them: a bow's peak, a mean rate."""
        axis = self._axis_of(effect)
        scene = Scene(self.compared.axes[axis], self.spans_s.get(axis, ()))
        return {**effect.params, **derived_of(effect, scene)}

    def in_words(self, effect: NamedEffect) -> str:
        """Its parameters as a person would say them, where their names do not; otherwise empty."""
        known = catalogue()[effect.name]
        if known.reads is None:
            return ""
        params = known.complete({name: value for name, (value, _, _) in effect.params.items()})
        return known.reads(params, self.compared.axes[self._axis_of(effect)])

    def _axis_of(self, effect: NamedEffect) -> str:
        return effect.axis or (self.traces[0].axis if self.traces else next(iter(self.compared.axes)))

    @property
    def next_model(self) -> Stage:
        """The model with what was found; the one that was compared is untouched."""
        return self.stage

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each number of each named effect: effect, axis, parameter, value, low_95, high_95, unit,
        share (of the unexplained power) and probability."""
        names = ("effect", "axis", "parameter", "value", "low_95", "high_95", "unit", "share", "probability")
        rows = [
            (effect.name, effect.axis, label, value, low, high, unit_of(unit), effect.share, effect.probability)
            for effect in self.effects
            for label, value, low, high, unit in parameter_rows(self.sizes_of(effect))
        ]
        return {name: [row[i] for row in rows] for i, name in enumerate(names)}

    @property
    def provisional(self) -> list[str]:
        """Names of the effects that the next model has though they are not vouched for, each once."""
        return list(dict.fromkeys(one.name for one in self.adopted if one.status == PROVISIONAL))

    @property
    def unexplained_sentence(self) -> str:
        """How much of the rest a generic model predicts, for a person; empty where that was not asked."""
        if self.unexplained is None:
            return ""
        said = self.unexplained.sentence(named=bool(self.effects))
        if not self.unexplained.of_equations:
            return said
        explain, whose = ("they explain", "their") if self.effects else ("the tie explains", "its")
        return f"{said}; that is no more than {whose} equations may miss of the power that {explain}"

    @property
    def more_than_floor(self) -> bool:
        """Whether nothing was found, and yet far more is left than the floor: what these records cannot show may be
        there."""
        return self.verdicts == ("none",) and self.gap.clearly_above_floor

    @property
    def remarks(self) -> list[str]:
        """What the figures do not say by themselves, for a person: what stays in the gap, and what may hide there."""
        names = [effect.name for effect in self.effects if catalogue()[effect.name].seen_as is not None]
        stays = [f"no voltage predicts {' or '.join(names)}: that stays in the gap"] if names else []
        return [*stays, *([MAY_HIDE] if self.more_than_floor else [])]

    @property
    def advice(self) -> str:
        """Which records would help where something is there and nothing is named; otherwise empty."""
        if "unknown" not in self.verdicts or self.effects or self.sources.get("reference"):
            return ""
        return (
            "records of the unchanged stage, given as --reference, would help: they show what the model misses anyway"
        )

    def tables(self) -> list[Table | str]:
        gap = self.gap
        parts: list[Table | str] = [f"verdict: {', '.join(self.verdicts)}", *self.doubts]
        for effect in self.effects:
            on = f" ({effect.axis})" if effect.axis else ""
            parts.append(f"{effect.name}{on}: {explained(effect)}; {effect.why}")
            headings = ("parameter", "value", "95 % interval", "unit")
            parts.append(Table(headings, tuple(parameter_texts(self.sizes_of(effect)))))
            parts += [words] if (words := self.in_words(effect)) else []
        parts += [f"these records cannot tell apart: {', '.join(tie)}" for tie in self.ties]
        if self.provisional:
            parts.append(f"adopted provisionally, for the prediction; not vouched for: {', '.join(self.provisional)}")
        if (where := headline(self.where)) is not None:
            parts.append(where)
        floor = f"floor {gap.floor:.4g} ({gap.floor_from})"
        about = "each record about its own mean"
        parts.append(f"held-out gap {gap.before:.4g} -> {gap.after:.4g} {gap.unit} rms, {about}; {floor}")
        if self.unexplained is not None and self.unexplained.something_missing:
            parts.append(self.unexplained_sentence)
        if self.advice:
            parts.append(self.advice)
        parts += _bounds(self.excluded)
        parts += self.remarks
        if self.untestable and ("unknown" in self.verdicts or self.more_than_floor):
            reasons = tuple((name, self.why_untestable(name)) for name in self.untestable)
            parts.append(Table(("not testable with these records", "why, and what would show it"), reasons))
        elif self.untestable:
            silent = ", so that `none` says nothing of them" if self.verdicts == ("none",) else ""
            parts.append(f"not testable with these records{silent}: {', '.join(self.untestable)}")
        if self.next_experiment is not None:
            parts.append(_experiment_text(self.next_experiment))
        tracked = [] if self.verification is None else self.verification.tables()
        return [*parts, *self.messages, *tracked]

    def why_untestable(self, name: str) -> str:
        """Why these records say nothing of an effect, and which would; for one that another stands for, none would."""
        why, effect = self.untestable_why.get(name, ""), catalogue()[name]
        if effect.reveals in why or effect.alone_as is not None:
            return why
        return f"{why}; {effect.reveals}" if why else effect.reveals

    def _repr_html_(self) -> str:
        """What is printed, and below it the largest cells of the residual and every bound."""
        cells = tuple((c.by, c.cell, f"{100 * c.share:.0f} %") for c in self.where[:MOST_CELLS])
        bounds = tuple((_with_axis(b), f"{b.upper_95:.2g}", unit_of(b.unit)) for b in self.excluded)
        below = (
            Table(("where", "cell", "share of the unexplained power"), cells),
            Table(("not named", "at most (95 %)", "unit"), bounds),
        )
        return super()._repr_html_() + "".join(table.html() for table in below if table.rows)

    def save_json(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Writes gap.json, whole or not at all. Raises BadInput where the file exists, unless ``overwrite``."""
        write_text(os.fspath(path), json_text(self.as_json()), overwrite=overwrite)

    def plot(self) -> Figure:
        """What the model left of the held-out record it missed most, before and after; and the cells it lies in."""
        from phaselead.gap.pictures import gap_figure  # matplotlib is slow to load and is needed here only

        return gap_figure(self.traces, self.where)

    def __repr__(self) -> str:
        return f"<GapResult: {', '.join(self.verdicts)}; {self.gap.before:.3g} -> {self.gap.after:.3g} {self.gap.unit}>"


def _bounds(excluded: Sequence[Bound]) -> list[str]:
    """The bounds in two lines: effects smaller than is typical or without a typical size, and those that may be as
    large as that, but no larger than said."""
    found = []
    for said, sure in (("smaller than usual, if there at all", True), ("may be there, but not larger", False)):
        below = [
            f"{_with_axis(b)} < {b.upper_95:.2g} {unit_of(b.unit)}".strip() for b in excluded if excludes(b) == sure
        ]
        if below:
            found.append(f"{said}: {', '.join(below)}")
    return found


def _with_axis(bound: Bound) -> str:
    """The name of a bounded effect, with its axis where there are several."""
    return f"{bound.name} ({bound.axis})" if bound.axis else bound.name


def _experiment_text(e: NextExperiment) -> str:
    low, high = e.band
    band = f"{digits(low, 3)} Hz" if low == high else f"{digits(low, 3)}..{digits(high, 3)} Hz"
    waveform = f"the waveform of {e.source} again" if e.source else e.waveform
    together = f"on {e.axis.replace(',', ', ')} at once, " if e.axis and e.several_axes else ""
    rivals = f"{', '.join(e.tells_apart)} apart" if e.tells_apart else "which power of the level softening grows by"
    odds = f"predicted log odds {e.separation:.3g}, names the true one {100 * e.chance:.0f} times in 100"
    record = f"{waveform}, {together}{e.level:.3g} V peak-to-peak about {e.bias:.3g} V, {band}, {e.seconds:.3g} s"
    if e.needs_sensor:
        return f"next, to tell {rivals}: {e.needs_sensor}. No record is likely to; the best would be {record}; {odds}"
    return f"next, to tell {rivals}: {record}; {odds}"


def _cell(cell: Cell) -> dict[str, Any]:
    of_axis = {} if cell.axis is None else {"axis": cell.axis}
    return {"by": cell.by, "cell": cell.cell, "share": cell.share, **of_axis}


def _effect(effect: NamedEffect, sizes: Mapping[str, Estimate | Estimates]) -> dict[str, Any]:
    params = {
        name: {"value": value, "unit": unit, "ci95": list(interval)} for name, (value, unit, interval) in sizes.items()
    }
    return {
        "name": effect.name, "axis": effect.axis, "params": params, "share": effect.share,
        "probability": effect.probability,
    }  # fmt: skip


def _experiment(experiment: NextExperiment | None) -> dict[str, Any] | None:
    if experiment is None:
        return None
    values = dict(vars(experiment))
    for name in ("source", "points"):
        if values[name] is None:
            del values[name]
    values["band"] = list(experiment.band)
    values["tells_apart"] = list(experiment.tells_apart)
    values["separation"] = experiment.separation if math.isfinite(experiment.separation) else None
    return values
