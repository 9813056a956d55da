"""A campaign as a result."""

from __future__ import annotations

from typing import Any

from phaselead.result import Result, Table
from phaselead.validation.table import reached


class CampaignResult(Result, dict[str, Any]):
    """The content of campaign.json, as a dictionary that prints its numbers beside their targets."""

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each number: what, target, reached, unit, of (cases)."""
        names = ("what", "target", "reached", "unit", "of")
        return {name: [row[name] for row in self["numbers"]] for name in names}

    def tables(self) -> list[Table | str]:
        rows = tuple((row["what"], reached(row), str(row["target"])) for row in self["numbers"])
        return [f"{self['cases']} cases", Table(("number", "reached", "target"), rows)]

    def __repr__(self) -> str:
        return f"<CampaignResult: {self['cases']} cases>"
