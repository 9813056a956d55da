"""What no voltage predicts: hum, vibration, quantisation, sampling jitter, and a zero that moves between sessions."""

from __future__ import annotations

from phaselead.gap.disturbances.disturbance import Disturbance, Residuals
from phaselead.gap.disturbances.disturbance_search import find_disturbances
from phaselead.gap.disturbances.session_offset import RecordOffset, Shift, best_explained, session_shifts
from phaselead.gap.disturbances.spectra import disturbance_spectra
from phaselead.gap.disturbances.vibration import louder_at_rest

__all__ = [
    "Disturbance",
    "RecordOffset",
    "Residuals",
    "Shift",
    "best_explained",
    "disturbance_spectra",
    "find_disturbances",
    "louder_at_rest",
    "session_shifts",
]
