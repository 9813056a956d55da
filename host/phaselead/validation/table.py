"""The results as a Markdown table, placed between two marks of a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from phaselead.errors import BadInput
from phaselead.record import write_text

BEGIN, END = "<!-- campaign table: begin -->", "<!-- campaign table: end -->"


def reached(row: dict[str, Any]) -> str:
    """The reached value of one row in words."""
    value = row["reached"]
    if value is None:
        return "not tried"
    if row["unit"] == "":
        return f"{value} of {row['of']}"
    nearly_all = 99.5 <= value < 100
    digits = f"{value:.0f}" if (value >= 10 and not nearly_all) or value == 0 else f"{value:.{3 if nearly_all else 2}g}"
    return f"{digits} {row['unit']} (of {row['of']})"


def markdown(result: dict[str, Any]) -> str:
    """The table of numbers, that of accuracy by effect and size, and their provenance."""
    lines = ["| | target | reached |", "|---|---|---|"]
    lines += [f"| {row['what']} | {row['target']} | {reached(row)} |" for row in result["numbers"]]
    lines += ["", *_by_size(result["accuracy_by_size"]["mixed"]), "", _provenance(result)]
    return "\n".join(lines) + "\n"


def _by_size(cells: dict[str, dict[str, float]]) -> list[str]:
    sizes = sorted({size for row in cells.values() for size in row}, key=float)
    if not sizes:
        return []
    head = "| one effect, mixed excitation: right at | " + " | ".join(f"{size} x" for size in sizes) + " |"
    lines = [head, "|---" * (len(sizes) + 1) + "|"]
    for name, row in cells.items():
        values = " | ".join(f"{100 * row[size]:.0f} %" if size in row else "-" for size in sizes)
        lines.append(f"| {name} | {values} |")
    return lines


def _provenance(result: dict[str, Any]) -> str:
    run = result["run"]
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(result["by_kind"].items()))
    return (
        f"Set `{run['set']}` ({result['cases']} cases: {kinds}), phaselead {run['version']}, commit "
        f"`{run['commit'] or 'none'}`, code and generator `{run['code']}`, {run['cpu_hours']:.2f} processor hours."
    )


def write_table(path: Path, result: dict[str, Any]) -> None:
    """Replace the text between the two marks of the page. Raises BadInput for a page without them."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); --table takes a page with the two marks") from None
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise BadInput(f"{path}: needs one {BEGIN!r} and one {END!r} after it, between which the table goes")
    before, after = text[: text.index(BEGIN)], text[text.index(END) :]
    write_text(path, f"{before}{BEGIN}\n{markdown(result)}{after}")
