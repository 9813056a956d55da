"""Parameters of an effect: what they are called, their bounds, and how their values are taken."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from phaselead.errors import BadInput
from phaselead.record import Samples

Value = float | Sequence[float]
Params = Mapping[str, Value]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. All parameters of role "size" at 0 make the effect vanish; shapes say how it looks."""

    name: str
    unit: str
    typical: float
    low: float
    high: float
    role: Literal["size", "shape"] = "size"
    log: bool = False
    """Whether its scale is logarithmic: scan it in equal ratios."""
    doc: str = ""
    between_forms: bool = False
    """Of a shape: whether both ends of its range are forms of the effect, no limits of what a stage can be."""
    may_be_highest: bool = False
    """Of a shape: whether an ordinary stage may have the highest value, beyond which geometry leaves nothing to see."""
    absorbed_by_refit: bool = False
    """Whether a base that is refitted together with the effect takes it over. It is then fitted only where the base is
    frozen or held by reference records."""

    by_itself: str = ""
    """Of a size by which the effect does not bear its name: the effect that it is where the others are nothing."""

    known: tuple[float, float] | None = None
    """The lowest and the highest that any stage is known to have, where a stage file may give more; gap names none
    beyond."""

    needs_modes: int = 0
    """Of a shape: modes without which a model has nothing that it could change."""

    def as_known(self) -> Parameter:
        """The parameter with the bounds of what is known of stages."""
        return self if self.known is None else replace(self, low=self.known[0], high=self.known[1])

    def as_sampled(self, highest_Hz: float) -> Parameter:
        """The parameter, a frequency no higher than what a sampling can show."""
        if self.unit != "Hz" or not self.low < highest_Hz < self.high:
            return self
        return replace(self, high=highest_Hz, typical=min(self.typical, highest_Hz))

    @property
    def left_out(self) -> float:
        """Its value where nobody gives one."""
        return 0.0 if self.role == "size" else self.typical


def number(params: Params, name: str) -> float:
    """A parameter that is a single number. Raises BadInput when it is a list of several."""
    value = params[name]
    if isinstance(value, Sequence):
        if len(value) != 1:
            raise BadInput(f"effect parameter {name} is a list of {len(value)}; give one number")
        return float(value[0])
    return float(value)


def numbers(params: Params, name: str) -> Samples:
    """A parameter that may be a list, as (m,)."""
    return np.atleast_1d(np.asarray(params[name], dtype=np.float64))


class CheckedParameters:
    """The parameters of one effect of a stage file, checked as they are taken.

    ``label`` names the stage, the axis and the effect, for messages. Every method raises BadInput in one line.
    """

    def __init__(self, label: str, complete: Params, written: Params) -> None:
        self.label, self._params, self._written = label, complete, written

    def __contains__(self, name: str) -> bool:
        return name in self._params

    def many(self, name: str) -> list[float]:
        """A parameter that may be a list."""
        if name not in self._params:
            raise BadInput(f"{self.label} has no parameter {name}; add it")
        value = self._params[name]
        return [float(v) for v in value] if isinstance(value, Sequence) else [float(value)]

    def one(self, name: str, *, low: float = -math.inf, above: float = -math.inf, below: float = math.inf) -> float:
        """A parameter that is one number within bounds; ``low`` itself is allowed."""
        values = self.many(name)
        if len(values) != 1:
            raise BadInput(f"{self.label}: {name} has {len(values)} terms; the simulator takes one")
        self._within(name, values, low, above, below)
        return values[0]

    def written(self, name: str) -> float | None:
        """A number as the stage file has it, in whatever form the effect accepts; None where it is not there."""
        value = self._written.get(name)
        return float(value) if isinstance(value, (int, float)) else None

    def alike(self, *names: str, most: int) -> list[list[float]]:
        """Lists of one length, of at most ``most`` elements."""
        lists = [self.many(name) for name in names]
        for name, values in zip(names, lists, strict=True):
            if len(values) != len(lists[0]):
                raise BadInput(
                    f"{self.label}: {name} has {len(values)} terms, its partner has {len(lists[0])}; give one for each"
                )
            if len(values) > most:
                raise BadInput(f"{self.label}: {name} has {len(values)} terms, the simulator takes {most}")
        return lists

    def positive(self, name: str, values: Sequence[float], below: float = math.inf) -> None:
        """Refuse what is not above 0."""
        self._within(name, values, -math.inf, 0.0, below)

    def _within(self, name: str, values: Sequence[float], low: float, above: float, below: float) -> None:
        for value in values:
            if not (math.isfinite(value) and value >= low and value > above and value < below):
                bounds = [f"at least {low:g}"] * (low > -math.inf) + [f"above {above:g}"] * (above > -math.inf)
                bounds += [f"below {below:g}"] * (below < math.inf)
                raise BadInput(f"{self.label}: {name} must be {' and '.join(bounds) or 'finite'}; it is {value:g}")
