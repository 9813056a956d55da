"""What an answer of the gap workflow is made of: named effects, bounds, cells, candidates, traces, spectra."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from phaselead.model import AdoptedStatus
from phaselead.record import Samples

Interval = tuple[float, float]
Estimate = tuple[float, str, Interval]
"""Value, unit, 95 % interval."""
Estimates = tuple[tuple[float, ...], str, tuple[Interval, ...]]
"""One for each of several modes."""


@dataclass(frozen=True)
class Posterior:
    """Of the parameters of an effect, as a normal distribution."""

    params: Mapping[str, float]
    """The most likely ones; those that are adopted predict best."""
    covariance: Samples
    """(k, k) in their units, in order."""


@dataclass(frozen=True)
class NamedEffect:
    """An effect the data demand."""

    name: str
    params: Mapping[str, Estimate | Estimates]
    share: float
    """Share of the unexplained power of the held-out records that it explains."""
    why: str = ""
    probability: float = 1.0
    """That it is there, and not one of its rivals or nothing."""
    axis: str | None = None
    """As in everything below: None where the data have a single one."""
    posterior: Posterior | None = field(default=None, compare=False, repr=False)
    """Of the parameters; None where it is not known."""


@dataclass(frozen=True)
class Adopted:
    """An effect that the next model has, and whether its name is vouched for."""

    name: str
    status: AdoptedStatus
    axis: str | None = None


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
class Detectable:
    """The size of an effect from which these records are expected to name it, whatever they show."""

    name: str
    size: float
    unit: str
    axis: str | None = None


CLEARLY_ABOVE_FLOOR = 2.0
"""Times the floor from which more is left of the held-out records than what was found can account for: it may also
shift their means."""


@dataclass(frozen=True)
class GapSize:
    """RMS error over all held-out records, before and after, and the floor that no model is expected to beat."""

    before: float
    after: float
    floor: float
    unit: str = "um"
    floor_from: str = ""
    """What the floor is, for a person."""
    floor_is_after: bool = False
    """Whether the floor is ``after`` itself, since nothing is known to leave less: then what is left above it is 0 by
    definition and says nothing."""

    @property
    def clearly_above_floor(self) -> bool:
        """Whether far more is left than no model is expected to beat."""
        return self.after > self.floor and self.after >= CLEARLY_ABOVE_FLOOR * self.floor

    @classmethod
    def below(cls, before: float, after: float, level: float, level_from: str) -> GapSize:
        """The gap in um whose floor is a ``level`` of other records, or ``after`` where the next model leaves less."""
        if level < after:
            return cls(before, after, level, "um", level_from)
        return cls(before, after, after, "um", f"what the next model leaves itself; {level_from} is no less", True)


@dataclass(frozen=True)
class NextExperiment:
    """The excitation that would best tell the members of one tie apart."""

    waveform: str
    level: float
    band: tuple[float, float]
    bias: float
    seconds: float
    separation: float
    """Least log odds between two members that it is expected to bring for the true one."""
    chance: float
    """Probability that the true member is named with it."""
    needs_sensor: str | None = None
    source: str | None = None
    """File of the record whose waveform it repeats."""
    points: tuple[float, ...] | None = None
    """One period of that waveform as shares of the level."""
    tells_apart: tuple[str, ...] = ()
    """Names of the effects that it tells apart, those of one tie. Empty where it tells which power of the level
    softening grows by."""
    drives: str | None = None
    """The axis, or axes, that it is for, also where ``axis`` is None because the data have a single one."""
    axis: str | None = None

    @property
    def several_axes(self) -> bool:
        """Whether it drives several axes at once."""
        return self.axis is not None and "," in self.axis


NAMED: Final = "named"
"""Remark of a candidate that was named, and status of an adopted effect that was."""
NOT_NAMED: Final = "most probable, not named"
"""Remark of the most probable candidate where none is named."""
WITHDRAWN: Final = "withdrawn: too much is left that the voltage predicts"
"""Remark of a candidate that would have been named."""
PROVISIONAL: Final = "provisional"
"""Status of an adopted effect whose name is not vouched for."""


@dataclass(frozen=True)
class Candidate:
    """How one set of effects did in the last contest."""

    step: int
    """Effects in the set."""
    name: str
    """Its effects, joined by " + "."""
    score: float
    """Log evidence over nothing; of axes that share modes the per cent of the rest that the effect would explain."""
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


SHOWN_VALUES = 6
"""Values of a list that are shown in a line of text."""


def parameter_texts(params: Mapping[str, Estimate | Estimates]) -> list[tuple[str, str, str, str]]:
    """Name, value, interval and unit as text, a list in one line."""
    found = []
    for name, (value, unit, interval) in params.items():
        if isinstance(value, tuple):
            shown = ", ".join(f"{v:.4g}" for v in value[:SHOWN_VALUES])
            found.append((f"{name} ({len(value)})", shown + (", ..." if len(value) > SHOWN_VALUES else ""), "", unit))
        else:
            found.append((name, f"{value:.4g}", f"{interval[0]:.4g} .. {interval[1]:.4g}", unit))
    return found


def parameter_rows(params: Mapping[str, Estimate | Estimates]) -> list[tuple[str, float, float, float, str]]:
    """Name, value, low, high and unit of every number; those of a list are numbered from 1."""
    found = []
    for name, (value, unit, interval) in params.items():
        if isinstance(value, tuple):
            pairs = zip(value, interval, strict=True)
            found += [(f"{name} {i + 1}", v, float(p[0]), float(p[1]), unit) for i, (v, p) in enumerate(pairs)]  # type: ignore[index]
        else:
            found.append((name, value, interval[0], interval[1], unit))  # type: ignore[arg-type]
    return found
