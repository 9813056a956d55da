"""Tracking: gains, runs that survive, their figures, and what rounding does to the filters."""

from __future__ import annotations

from phaselead.control.errors import TrackingError, tracking_error
from phaselead.control.gains import PAPER_GAINS, parse_gains
from phaselead.control.journal import journalled_listen, journalled_track, recover_run
from phaselead.control.tracking import MODES, Run, assumed_limits, track

__all__ = [
    "MODES",
    "PAPER_GAINS",
    "Run",
    "TrackingError",
    "assumed_limits",
    "journalled_listen",
    "journalled_track",
    "parse_gains",
    "recover_run",
    "track",
    "tracking_error",
]
