"""What executing a run again came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from phaselead.result import Result, Table


@dataclass(frozen=True)
class Replay(Result):
    """A run that was executed again. True when every DAC code is the same."""

    run: str
    ticks: int
    first_difference: int | None
    """The first tick whose DAC code differs."""

    @property
    def equal(self) -> bool:
        """Whether every DAC code is the same."""
        return self.first_difference is None

    def __bool__(self) -> bool:
        return self.equal

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead replay --json`` writes it."""
        return {"run": self.run, "ticks": self.ticks, "equal": self.equal, "first_difference": self.first_difference}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row."""
        return {name: [value] for name, value in self.as_dict().items()}

    def tables(self) -> list[Table | str]:
        if self.equal:
            return [f"{self.run}: {self.ticks} ticks executed again, every DAC code is the same"]
        return [f"{self.run}: the DAC code of tick {self.first_difference} differs; it is the first that does"]
