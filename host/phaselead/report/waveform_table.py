"""Write the table of waveforms into docs/commands.md: ``python -m phaselead.report.waveform_table [docs]``.

With ``--check`` it says whether the table is stale instead."""

from __future__ import annotations

import sys
from pathlib import Path

from phaselead.record import write_text
from phaselead.waveforms import ways

PAGE = "commands.md"
BEGIN = "<!-- Written by python -m phaselead.report.waveform_table; edit the kinds in host/phaselead/waveforms/. -->"
GENERAL = (
    ("`sine:5V@5Hz`, `goto:2V`", "volts, in mode `open` only; `goto` starts at the present output, 50 V/s at most"),
    ("`x=WAVE,y=WAVE`", "several axes, started in the same tick"),
)


def table() -> str:
    """The lines of the table: every kind in its order, then what holds for all."""
    own = [(f"`{how}`", what) for written in ways() for how, what in written]
    rows = "".join(f"| {how} | {what} |\n" for how, what in [*own, *GENERAL])
    return f"{BEGIN}\n\n| WAVE | path |\n|---|---|\n{rows}"


def with_table(text: str) -> str:
    """The page with the table as it would be written today."""
    head, mark, tail = text.partition(BEGIN)
    assert mark, f"{PAGE} has lost the line {BEGIN}"
    return head + table() + "\n" + tail.lstrip("\n").partition("\n\n")[2]


def main(arguments: list[str]) -> int:
    """Write the table, or with --check return 1 if it is stale."""
    page = Path(next((a for a in arguments if not a.startswith("-")), "docs")) / PAGE
    text = page.read_text("utf-8")
    if "--check" not in arguments:
        write_text(page, with_table(text))
        return 0
    if with_table(text) == text:
        return 0
    print(f"{page} is stale; run: python -m phaselead.report.waveform_table {page.parent}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
