"""Modes of the mechanics: the first ones of one axis, and those that several axes share."""

from __future__ import annotations

from phaselead.identify.modal.frequency_domain import (
    JointExperiment,
    common_period,
    common_poles,
    frequency_response,
)
from phaselead.identify.modal.model import Drive, ModalModel
from phaselead.identify.modal.one_axis import FittedModes, fit_straight, fit_together, shares_left_by
from phaselead.identify.modal.scoring import score_test
from phaselead.identify.modal.shown_modes import measured_response
from phaselead.identify.modal.time_domain import Drives, ModalFit, Shaping, fit_modes
from phaselead.identify.modal.with_creep import fit_with_creep

__all__ = [
    "Drive",
    "Drives",
    "FittedModes",
    "JointExperiment",
    "ModalFit",
    "ModalModel",
    "Shaping",
    "common_period",
    "common_poles",
    "fit_modes",
    "fit_straight",
    "fit_together",
    "fit_with_creep",
    "frequency_response",
    "measured_response",
    "score_test",
    "shares_left_by",
]
