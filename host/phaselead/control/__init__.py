"""Tracking: gains, runs that survive, their figures, and what rounding does to the filters."""

from __future__ import annotations

from phaselead.control.controller import Controller, connect
from phaselead.control.doctor import Diagnosis
from phaselead.control.errors import TrackingError, tracking_error
from phaselead.control.feedback_loop import Loop, loop_of
from phaselead.control.gains import (
    PAPER_GAINS,
    GainsLike,
    are_designed,
    describe_gains,
    describe_unseen,
    gains_of,
    lacking_gains,
    own_loop_warnings,
    parse_gains,
    with_gains,
)
from phaselead.control.held import held_stage, low_gains_warning, unknown_warning
from phaselead.control.hold_and_move import Axis
from phaselead.control.journal import record_open_loop, record_to_file, recover_run, track_to_file
from phaselead.control.keep_alive import HOST_TIMEOUT_S
from phaselead.control.learning import Learned, learn, load_learned
from phaselead.control.modes import MODES
from phaselead.control.moved import Moved, Planned
from phaselead.control.moving import best_mode
from phaselead.control.rehearsal import OnRehearsed, Predicted
from phaselead.control.room import said_of_disk
from phaselead.control.run import Run
from phaselead.control.targets import parse_targets
from phaselead.control.tracking import assumed_limits, loop_warnings, path_warnings, track
from phaselead.control.triggers import parse_outputs
from phaselead.control.true_position import FOLLOWS, Follows
from phaselead.control.tuning import Tuned, tune

__all__ = [
    "FOLLOWS",
    "HOST_TIMEOUT_S",
    "MODES",
    "PAPER_GAINS",
    "Axis",
    "Controller",
    "Diagnosis",
    "Follows",
    "GainsLike",
    "Learned",
    "Loop",
    "Moved",
    "OnRehearsed",
    "Planned",
    "Predicted",
    "Run",
    "TrackingError",
    "Tuned",
    "are_designed",
    "assumed_limits",
    "best_mode",
    "connect",
    "describe_gains",
    "describe_unseen",
    "gains_of",
    "held_stage",
    "lacking_gains",
    "learn",
    "load_learned",
    "loop_of",
    "loop_warnings",
    "low_gains_warning",
    "own_loop_warnings",
    "parse_gains",
    "parse_outputs",
    "parse_targets",
    "path_warnings",
    "record_open_loop",
    "record_to_file",
    "recover_run",
    "said_of_disk",
    "track",
    "track_to_file",
    "tracking_error",
    "tune",
    "unknown_warning",
    "with_gains",
]
