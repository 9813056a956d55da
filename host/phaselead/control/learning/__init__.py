"""Iterative learning: what repeats of a path's error is taken out of it, trial by trial."""

from __future__ import annotations

from phaselead.control.learning.learned import Learned, LearnedPath, Trial, load_learned
from phaselead.control.learning.trials import learn

__all__ = ["Learned", "LearnedPath", "Trial", "learn", "load_learned"]
