"""Tracking: gains, runs that survive, their figures, and what rounding does to the filters."""

from __future__ import annotations

from phaselead.control.controller import Controller, connect
from phaselead.control.errors import TrackingError, tracking_error
from phaselead.control.gains import PAPER_GAINS, parse_gains
from phaselead.control.journal import record_open_loop, recover_run, track_to_file
from phaselead.control.run import Run
from phaselead.control.tracking import MODES, assumed_limits, track

__all__ = [
    "MODES",
    "PAPER_GAINS",
    "Controller",
    "Run",
    "TrackingError",
    "assumed_limits",
    "connect",
    "parse_gains",
    "record_open_loop",
    "recover_run",
    "track",
    "track_to_file",
    "tracking_error",
]
