"""Where model and measurement disagree, what is missing, how sure, and which experiment comes next."""

from __future__ import annotations

from phaselead.gap.native import keep_freed_memory
from phaselead.gap.perform import excitation_of, perform, proposal_of, read_proposal
from phaselead.gap.result import NAMED, Bound, Candidate, Cell, GapResult, NamedEffect, Spectrum, Trace, brief, lines
from phaselead.gap.run import run_gap
from phaselead.gap.told import LEVEL, excludes, headline, percent, typical_of, unit_of
from phaselead.gap.verify_on import Tracked, Verification, reachable, verify_on

__all__ = [
    "LEVEL",
    "NAMED",
    "Bound",
    "Candidate",
    "Cell",
    "GapResult",
    "NamedEffect",
    "Spectrum",
    "Trace",
    "Tracked",
    "Verification",
    "brief",
    "excitation_of",
    "excludes",
    "headline",
    "keep_freed_memory",
    "lines",
    "percent",
    "perform",
    "proposal_of",
    "reachable",
    "read_proposal",
    "run_gap",
    "typical_of",
    "unit_of",
    "verify_on",
]
