"""The page of a learning: error against trial, and what was added to the path."""

from __future__ import annotations

import os

from phaselead.control import Learned
from phaselead.report.page import write_page


def write_learning_report(path: str | os.PathLike[str], wave: str, learned: Learned) -> None:
    """Writes the page, whole or not at all."""
    table, reason = learned.tables()
    write_page(os.fspath(path), "learning.html", wave=wave, table=table, reason=reason, figure=learned.plot())
