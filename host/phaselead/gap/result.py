"""What the gap workflow found, as one value: what gap.json says and what the report draws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from phaselead.gap.summary import GapSummary
from phaselead.gap.verify_on import Verification
from phaselead.model import Stage
from phaselead.record import Samples

Interval = tuple[float, float]
Value = tuple[float, str, Interval]
"""Value, unit, 95 % interval."""
Values = tuple[tuple[float, ...], str, tuple[Interval, ...]]
"""One for each of several modes."""


@dataclass(frozen=True)
class NamedEffect:
    """An effect the data demand."""

    name: str
    axis: str | None
    params: Mapping[str, Value | Values]
    share: float
    """Share of the unexplained power of the held-out records that it explains."""
    why: str = ""


@dataclass(frozen=True)
class Cell:
    """One cell of the residual: a part of it by frequency, voltage, time since a step, direction, order or axis."""

    by: str
    cell: str
    share: float
    """Of the unexplained power."""
    sentence: str
    p: float = 1.0
    """Probability of so large a share by chance, over all cells together."""
    axis: str | None = None


@dataclass(frozen=True)
class Bound:
    """The largest size of an effect that the data allow at 95 %."""

    name: str
    upper_95: float
    unit: str
    axis: str | None = None


@dataclass(frozen=True)
class Gap:
    """RMS error over all held-out records, before and after, and the floor that no model is expected to beat."""

    before: float
    after: float
    floor: float
    unit: str = "um"
    floor_from: str = ""


@dataclass(frozen=True)
class NextExperiment:
    """The excitation that would best tell the members of a tie apart."""

    waveform: str
    level: float
    band: tuple[float, float]
    bias: float
    axis: str | None
    seconds: float
    separation: float
    """Predicted smallest squared distance between two members, in standard deviations."""
    needs_sensor: str | None = None


NAMED = "named"
"""Remark of a candidate that was named."""


@dataclass(frozen=True)
class Candidate:
    """How one effect did in one step of the search; ``score`` is in points."""

    step: int
    name: str
    score: float
    held_out_z: float
    rms_um: float
    """RMS residual of the training records after its refit; nan where it was not refitted."""
    remark: str
    axis: str | None = None


@dataclass(frozen=True)
class Trace:
    """One held-out record: (n,) arrays over its scored rows."""

    source: str
    axis: str
    t_s: Samples
    u_V: Samples
    measured_um: Samples
    before_um: Samples
    after_um: Samples


@dataclass(frozen=True)
class Spectrum:
    """Amplitude densities (n,) in um/sqrt(Hz) in which a disturbance shows, of held-out and of reference records."""

    name: str
    axis: str
    f_Hz: Samples
    seen: Samples
    reference: Samples | None


@dataclass(frozen=True, repr=False)
class GapResult(GapSummary):
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
    held-out gap ...
    """

    stage: Stage
    verdicts: tuple[str, ...]
    effects: tuple[NamedEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    excluded: tuple[Bound, ...]
    untestable: tuple[str, ...]
    where: tuple[Cell, ...]
    gap: Gap
    next_experiment: NextExperiment | None
    holdout_sha256: tuple[str, ...]
    candidates: tuple[Candidate, ...] = ()
    traces: tuple[Trace, ...] = ()
    spectra: tuple[Spectrum, ...] = ()
    untestable_why: dict[str, str] = field(default_factory=dict)
    adopted_of_ties: dict[str, str] = field(default_factory=dict)
    """For each tie, by its names joined with " | ", the member that the next stage contains."""
    messages: tuple[str, ...] = ()
    seconds: float = 0.0
    base: Stage | None = None
    """The model that was compared."""
    verification: Verification | None = None
    """What tracking on a device came to, where that was asked for."""

    def as_json(self) -> dict[str, Any]:
        """The content of gap.json."""
        return {
            "verdicts": list(self.verdicts),
            "effects": [_effect(effect) for effect in self.effects],
            "ties": [list(tie) for tie in self.ties],
            "excluded": [{"name": b.name, "upper_95": b.upper_95, "unit": b.unit} for b in self.excluded],
            "untestable": list(self.untestable),
            "where": [{"by": c.by, "cell": c.cell, "share": c.share} for c in self.where],
            "gap": {
                "before": self.gap.before,
                "after": self.gap.after,
                "floor": self.gap.floor,
                "unit": self.gap.unit,
                "floor_from": self.gap.floor_from,
            },
            "next_experiment": _experiment(self.next_experiment),
            "holdout_sha256": list(self.holdout_sha256),
        }


SHOWN = 6
"""Values of a list that are shown in a line of text."""


def brief(params: Mapping[str, Value | Values]) -> list[tuple[str, str, str, str]]:
    """Name, value, interval and unit as text, a list in one line."""
    found = []
    for name, (value, unit, interval) in params.items():
        if isinstance(value, tuple):
            shown = ", ".join(f"{v:.4g}" for v in value[:SHOWN])
            found.append((f"{name} ({len(value)})", shown + (", ..." if len(value) > SHOWN else ""), "", unit))
        else:
            found.append((name, f"{value:.4g}", f"{interval[0]:.4g} .. {interval[1]:.4g}", unit))
    return found


def lines(params: Mapping[str, Value | Values]) -> list[tuple[str, float, float, float, str]]:
    """Name, value, low, high and unit of every number; those of a list are numbered from 1."""
    found = []
    for name, (value, unit, interval) in params.items():
        if isinstance(value, tuple):
            pairs = zip(value, interval, strict=True)
            found += [(f"{name} {i + 1}", v, float(p[0]), float(p[1]), unit) for i, (v, p) in enumerate(pairs)]  # type: ignore[index]
        else:
            found.append((name, value, interval[0], interval[1], unit))  # type: ignore[arg-type]
    return found


def _effect(effect: NamedEffect) -> dict[str, Any]:
    params = {
        name: {"value": value, "unit": unit, "ci95": list(interval)}
        for name, (value, unit, interval) in effect.params.items()
    }
    return {"name": effect.name, "axis": effect.axis, "params": params, "share": effect.share}


def _experiment(experiment: NextExperiment | None) -> dict[str, Any] | None:
    if experiment is None:
        return None
    values = dict(vars(experiment))
    values["band"] = list(experiment.band)
    values["separation"] = experiment.separation if math.isfinite(experiment.separation) else None
    return values
