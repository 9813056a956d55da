"""The functions of ``import phaselead``, by the words of the command line; each imports what it needs when called."""

from __future__ import annotations

from phaselead.api.devices import explain, flash, gcs, ports, replay, scope, sim, stop
from phaselead.api.gaps import gap, gap_next, write_report
from phaselead.api.models import fit, load, loop, predict, verify
from phaselead.api.recordings import export, import_recordings, plot, read, recording, recover
from phaselead.api.trials import campaign, demo

__all__ = [
    "campaign",
    "demo",
    "explain",
    "export",
    "fit",
    "flash",
    "gap",
    "gap_next",
    "gcs",
    "import_recordings",
    "load",
    "loop",
    "plot",
    "ports",
    "predict",
    "read",
    "recording",
    "recover",
    "replay",
    "scope",
    "sim",
    "stop",
    "verify",
    "write_report",
]
