"""What is fitted between the voltage and the modes that axes share: softening of the actuators, and effects beside it.

Each is fitted on every axis by itself: its first size, and its shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from phaselead.gap.several_axes.joint_records import Entries, JointRecord, effect_of
from phaselead.identify import Drive, Shaping
from phaselead.model import Effect, Entry, Parameter
from phaselead.record import Samples

FIRST_TAU_s = 0.3
"""Memory of the level from which a fit begins."""
SIZE_STEP = 0.02
"""Of the typical size, for derivatives."""


def no_shaping(records: Sequence[JointRecord], entries: Entries) -> Shaping:
    """The drives of records for a fit that leaves them as they are."""
    none = np.zeros(0)
    drives = [record.drive(entries) for record in records]
    return Shaping(lambda _: drives, none, none, none, none)


def fitted_parameters(effect: Effect) -> tuple[Parameter, ...]:
    """What is fitted of an effect in front of the modes: its first size and its shapes. Those of softening are tried
    one by one, since its level is slow."""
    return effect.sizes[:1] if effect.shared_modes == "level" else (*effect.sizes[:1], *effect.shapes)


@dataclass(frozen=True)
class InFront:
    """What is fitted in front of the modes: softening of every actuator, and the effects ``others``."""

    axes: tuple[str, ...]
    others: tuple[Effect, ...]
    tau_s: float = FIRST_TAU_s
    exponent: float = 1.0
    softens: bool = True
    """Whether softening is fitted."""
    given: Entries = field(default_factory=dict)
    """By axis: effects in front of them that stay as they are."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Softening first."""
        return (effect_of("level"), *self.others) if self.softens else self.others

    @property
    def first_values(self) -> Samples:
        """From which a fit begins: nothing softens, everything else is as is typical."""
        found = [0.0 if e.shared_modes == "level" else p.typical for e in self.effects for p in fitted_parameters(e)]
        return np.repeat(found, len(self.axes))

    def entries(self, values: Sequence[float]) -> dict[str, list[Entry]]:
        """The effects of every axis for ``values``: each fitted parameter of each effect in turn, axis by axis. How
        softening moves the modes is left to their fit."""
        found: dict[str, list[Entry]] = {axis: list(self.given.get(axis, ())) for axis in self.axes}
        shapes = {"tau_s": self.tau_s, "exponent": self.exponent}
        by_parameter = iter(np.reshape(values, (-1, len(self.axes))).tolist())
        for effect in self.effects:
            given = shapes if effect.shared_modes == "level" else {}
            of_axes = {p.name: next(by_parameter) for p in fitted_parameters(effect)}
            for i, axis in enumerate(self.axes):
                own = {name: values[i] for name, values in of_axes.items()}
                found[axis].append((effect, effect.complete({**given, **own})))
        return found

    def shaping(self, records: Sequence[JointRecord], values: Samples) -> Shaping:
        """The drives of records as a function of the values, from ``values`` on; the last two results are kept."""
        known: dict[bytes, list[Drive]] = {}

        def drives(at: Samples) -> Sequence[Drive]:
            key = at.tobytes()
            if key not in known:
                while len(known) > 1:
                    del known[next(iter(known))]
                known[key] = [s.drive(self.entries(at.tolist())) for s in records]
            return known[key]

        fitted = [p for effect in self.effects for p in fitted_parameters(effect)]
        rows = [(SIZE_STEP * (p.typical or p.high - p.low), p.low, p.high) for p in fitted for _ in self.axes]
        steps, low, high = np.array(rows, dtype=np.float64).T
        return Shaping(drives, values, steps, low, high)
