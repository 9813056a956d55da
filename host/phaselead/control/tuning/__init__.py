"""A loop with margins: the response is measured, PID and filters are shaped on it, and the loop is measured."""

from __future__ import annotations

from phaselead.control.tuning.course import tune
from phaselead.control.tuning.result import Tuned
from phaselead.control.tuning.tunes import Tunes

__all__ = ["Tuned", "Tunes", "tune"]
