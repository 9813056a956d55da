"""Sessions that a command left running: the next command on the same port goes on with them.

A device belongs to one session. `phaselead move` ends with the stage held, so it writes down the session's number and
how the axes are held; `where`, `hold`, `park` and the next `move` take it up.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from phaselead.record import write_text
from phaselead.serial_ports import is_virtual

IDS_RESERVED = 8192
"""For a command that takes a session up and does not live to say how many it needed; half of all are told apart."""


@dataclass(frozen=True)
class LeftRunning:
    """A session that goes on without its host."""

    nonce: int
    last_id: int
    """Of its requests: the device carries out none that lies behind."""
    mode: str
    axes: str
    model: str | None
    """Path of the stage file it was begun with."""
    gains: dict[str, dict[str, Any]] | None = None
    """By axis, as stage files have them; None: written by a version that did not say."""


def _file() -> Path:
    folder = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(folder) / "phaselead" / "sessions.json"


def _all() -> dict[str, dict[str, object]]:
    try:
        found = json.loads(_file().read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _port(url: str) -> str:
    return url if "://" in url else os.path.realpath(url)


def recall(url: str) -> LeftRunning | None:
    """The session left running on this port, None when there is none that can be read."""
    try:
        return LeftRunning(**_all()[_port(url)])  # type: ignore[arg-type]
    except (KeyError, TypeError):
        return None


def remember(url: str, left: LeftRunning | None) -> None:
    """Writes the session down, or that there is none any more. Nothing for a virtual port."""
    if is_virtual(url):
        return
    sessions = _all()
    before = sessions.pop(_port(url), None)
    if left is not None:
        sessions[_port(url)] = asdict(left)
    if left is None and before is None:
        return
    _file().parent.mkdir(parents=True, exist_ok=True)
    write_text(str(_file()), json.dumps(sessions, indent=1))
