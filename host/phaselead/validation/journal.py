"""Finished cases, one JSON line each, appended and never rewritten, so that an interrupted campaign can continue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from phaselead.errors import BadInput

Outcome = dict[str, Any]
"""One finished case as plain JSON types: what was hidden, and what was answered. ``trial.try_case`` makes it."""


class Journal:
    """The file of finished cases and their outcomes by name.

    ``code`` is the fingerprint of the code under test. Raises BadInput for cases run with other code, unless ``mix``.
    """

    def __init__(self, path: Path, code: str, *, mix: bool = False) -> None:
        self.path, self.code = path, code
        self.outcomes: dict[str, Outcome] = {}
        for outcome in _read(path):
            if outcome.get("code") != code and not mix:
                raise BadInput(
                    f"{path}: holds cases run with other code ({outcome.get('code')}, now {code}); "
                    "give another folder, or --mix to keep them"
                )
            self.outcomes[outcome["case"]] = outcome

    def add(self, outcome: Outcome) -> None:
        """Append one outcome and flush it."""
        outcome = outcome | {"code": self.code}
        line = json.dumps(outcome, allow_nan=True) + "\n"
        with open(self.path, "a+b") as file:
            if file.tell() and not _ends_whole(self.path):
                line = "\n" + line  # the last writer was killed in the middle of its line
            file.write(line.encode())
            file.flush()
        self.outcomes[outcome["case"]] = outcome


def _ends_whole(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(-1, 2)
        return file.read(1) == b"\n"


def _read(path: Path) -> list[Outcome]:
    """Every whole line. Raises BadInput for a file of something else."""
    if not path.exists():
        return []
    found = []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            outcome = json.loads(line)
        except ValueError:
            continue  # cut short by a kill: that case runs again
        if not isinstance(outcome, dict) or "case" not in outcome:
            raise BadInput(f"{path}: line {number} is no finished case; give another folder")
        found.append(outcome)
    return found
