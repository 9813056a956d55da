"""The source tree, where there is one: what builds the firmware, and for which boards."""

from __future__ import annotations

import configparser
from pathlib import Path

OWN = Path(__file__).resolve().parents[2]
ENVIRONMENT = "env:"


def source_tree() -> Path | None:
    """The source tree in the current folder, else the one that this package is in, else None."""
    for root in (Path.cwd(), OWN):
        if (root / "platformio.ini").is_file() and (root / "firmware" / "build_id.py").is_file():
            return root
    return None


def boards() -> tuple[str, ...]:
    """The boards of platformio.ini, in its order; none without a source tree."""
    root = source_tree()
    if root is None:
        return ()
    project = configparser.ConfigParser(interpolation=None)
    project.read(root / "platformio.ini", "utf-8")
    names = [section for section in project.sections() if section.startswith(ENVIRONMENT)]
    return tuple(name.removeprefix(ENVIRONMENT) for name in names)
