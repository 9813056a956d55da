"""Controllers that others have published, for the comparison in docs/compare.md: evidence, no part of the product.

Each is made from the same records (``evidence``), in double precision, and driven against the same simulated stage at
the same ticks (``bench``) along the same paths (``paths``). A file says in its docstring what it follows.

The originals of three of them could not be read: they are made from what Xu and Li 2010 and later work say of them,
and from the theory they rest on. Each file says what is taken from where.
"""

from __future__ import annotations

from rivals.bench import Controller, Driven, drive
from rivals.evidence import Evidence, Sine
from rivals.lead_lookup import LeadLookUp
from rivals.paths import PATHS, Path, paths_for
from rivals.prandtl_ishlinskii import RateDependentInverse
from rivals.smith_predictor import SmithPredictor
from rivals.xu_li import FeedForward, FeedForwardPid, Pid

RIVALS = {
    "FF": FeedForward,
    "PID": Pid,
    "FF+PID": FeedForwardPid,
    "lead look-up": LeadLookUp,
    "Smith predictor": SmithPredictor,
    "PI inverse": RateDependentInverse,
}
"""By their names in the tables."""

__all__ = [
    "PATHS",
    "RIVALS",
    "Controller",
    "Driven",
    "Evidence",
    "FeedForward",
    "FeedForwardPid",
    "LeadLookUp",
    "Path",
    "Pid",
    "RateDependentInverse",
    "Sine",
    "SmithPredictor",
    "drive",
    "paths_for",
]
