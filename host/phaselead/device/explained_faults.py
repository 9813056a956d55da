"""Why a fault stops the device and what to do: the paragraphs of the manual's page, which the package carries."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phaselead.device import wire
from phaselead.errors import BadInput
from phaselead.result import Result, Table
from phaselead.source_tree import OWN

PAGE = "faults.md"
"""In the source tree under docs/; setup.py puts it beside this file in what is installed."""
_SECTION = re.compile(r"^## (\w+)\n+(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")


@dataclass(frozen=True)
class FaultPage(Result):
    """What the manual says of one fault."""

    fault: str
    text: str

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead explain --json`` writes it."""
        return {"fault": self.fault, "text": self.text}

    @property
    def columns(self) -> dict[str, list[str]]:
        """One row: fault, text."""
        return {"fault": [self.fault], "text": [self.text]}

    def tables(self) -> list[Table | str]:
        return [f"{self.fault}\n", *self.text.split("\n\n")]


def fault_names() -> list[str]:
    """Every fault of this version, in the order of the wire."""
    return [fault.name.lower() for fault in wire.Fault if fault != wire.Fault.NONE]


def explain_fault(name: str) -> FaultPage:
    """The paragraphs on one fault. Raises BadInput for a name that is none."""
    wanted = name.strip().lower().replace("-", "_")
    if wanted not in fault_names():
        close = difflib.get_close_matches(wanted, fault_names(), n=1)
        meant = f"did you mean {close[0]}?" if close else f"there are {', '.join(fault_names())}"
        raise BadInput(f"{name!r} is no fault of the device; {meant}")
    found = dict(_SECTION.findall(_page()))
    paragraphs = [part.strip() for part in found.get(wanted, "").split("\n\n") if part.strip()]
    return FaultPage(wanted, "\n\n".join(map(_plain, paragraphs)))


def _plain(paragraph: str) -> str:
    """A paragraph on one line, links as their words; examples as they are."""
    if paragraph.startswith("```"):
        return "\n".join(line for line in paragraph.splitlines() if not line.startswith("```"))
    return _LINK.sub(r"\1", " ".join(paragraph.split()))


def _page() -> str:
    own = OWN / "docs" / PAGE
    path = own if own.is_file() else Path(__file__).with_name(PAGE)
    return path.read_text("utf-8")
