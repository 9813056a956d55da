"""docs/gcs.md names every command that is spoken, and none that is not as done."""

from __future__ import annotations

import re
from pathlib import Path

from phaselead.gcs.commands import COMMANDS

PAGE = Path(__file__).parents[2] / "docs" / "gcs.md"


def test_the_table_of_commands_is_true():
    rows = re.findall(r"^\| (`.*`) \| (\w+) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    named: dict[str, set[str]] = {}
    for cells, state in rows:
        named.setdefault(state, set()).update(re.findall("`([^`]+)`", cells))
    assert named["done"] | named["refused"] == set(COMMANDS)
    assert not named["no"] & set(COMMANDS)
