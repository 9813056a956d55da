"""A move that is planned, and one that was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phaselead.result import Result, Table
from phaselead.waveforms import Goto

SETTLE_S = 1.0
"""How long an axis is waited for that does not come to its target; what creep leaves takes longer."""


@dataclass(frozen=True)
class AxisMoved:
    """One axis of a move. Seconds are from its begin."""

    from_um: float
    to_um: float
    duration_s: float
    settled_s: float | None
    """When it was within its window for good; None: it was not."""
    predicted_s: float | None
    """What the rehearsal on the model said; None without one."""
    x_um: float
    window_um: float


@dataclass(frozen=True)
class Moved(Result):
    """A move that was made. Prints as a table."""

    axes: Mapping[str, AxisMoved]
    waited: bool = True
    """For the axes to settle."""

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead move --json`` writes it: figures by axis."""
        return {"axes": {axis: dict(vars(one)) for axis, one in self.axes.items()}}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row an axis."""
        rows = [{"axis": axis, **vars(one)} for axis, one in self.axes.items()]
        return {name: [row[name] for row in rows] for name in rows[0]}

    def tables(self) -> list[Table | str]:
        headings = ("axis", "from (µm)", "to (µm)", "is at (µm)", "move (ms)", "settled (ms)", "window (µm)")
        rows = tuple(
            (
                axis,
                f"{one.from_um:.3f}",
                f"{one.to_um:.3f}",
                f"{one.x_um:.3f}",
                f"{one.duration_s * 1e3:.1f}",
                "not yet" if one.settled_s is None else f"{one.settled_s * 1e3:.1f}",
                f"{one.window_um:.3f}",
            )
            for axis, one in self.axes.items()
        )
        return [Table(headings, rows), *self._unsettled()]

    def _unsettled(self) -> list[str]:
        """Of axes that have not settled although the model has."""
        return [
            f"{axis}: settled after {one.predicted_s * 1e3:.1f} ms on the model, not within {SETTLE_S:g} s of the move "
            "on the stage: it is not what its model says; where it swings, `phaselead tune` measures the response and "
            "shapes gains on it"
            for axis, one in self.axes.items()
            if one.predicted_s is not None and one.settled_s is None and self.waited
        ]


@dataclass(frozen=True)
class Planned:
    """A move that may be made: where each axis starts and ends, and how long all of them take."""

    start_um: Mapping[str, float]
    target_um: Mapping[str, float]
    duration_s: float

    def paths(self) -> dict[str, Goto]:
        """The same as paths."""
        ends = ((axis, self.start_um[axis], target) for axis, target in self.target_um.items())
        return {axis: Goto(target - start, start, "um", 1 / self.duration_s) for axis, start, target in ends}

    def sentences(self, predicted: Mapping[str, float | None]) -> list[str]:
        """What will happen, a line an axis; ``predicted`` as ``rehearse_move`` gives it: of a stage that is all that
        its model says."""
        return [
            f"{axis}: {self.start_um[axis]:.3f} to {self.target_um[axis]:.3f} um in {self.duration_s * 1e3:.1f} ms, "
            + "on the model settled "
            + ("later than a second after it" if seconds is None else f"after {seconds * 1e3:.1f} ms")
            for axis, seconds in predicted.items()
        ]
