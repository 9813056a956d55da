"""Where model and measurement disagree, what is missing, how sure, and which experiment comes next."""

from __future__ import annotations

from phaselead.gap.design import (
    axis_driven,
    excitation_of,
    modes_crossed_Hz,
    proposal_of,
    read_proposal,
    refuse_other_rate,
    run_proposal,
)
from phaselead.gap.error_rates import ERROR_RATE, SURE
from phaselead.gap.findings import (
    NAMED,
    PROVISIONAL,
    Bound,
    Candidate,
    Cell,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
    parameter_rows,
)
from phaselead.gap.locate import excludes, explained, headline, typical_of, unit_of
from phaselead.gap.posterior import MOST_STATED
from phaselead.gap.residual import left_um
from phaselead.gap.result import GapResult
from phaselead.gap.run import run_gap, verified_on
from phaselead.gap.verify_on import TrackedPath, TrackingComparison, check_port

__all__ = [
    "ERROR_RATE",
    "MOST_STATED",
    "NAMED",
    "PROVISIONAL",
    "SURE",
    "Bound",
    "Candidate",
    "Cell",
    "GapResult",
    "NamedEffect",
    "NextExperiment",
    "Spectrum",
    "Trace",
    "TrackedPath",
    "TrackingComparison",
    "axis_driven",
    "check_port",
    "excitation_of",
    "excludes",
    "explained",
    "headline",
    "left_um",
    "modes_crossed_Hz",
    "parameter_rows",
    "proposal_of",
    "read_proposal",
    "refuse_other_rate",
    "run_gap",
    "run_proposal",
    "typical_of",
    "unit_of",
    "verified_on",
]
