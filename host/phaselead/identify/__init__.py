"""From recordings to a stage file: experiments, fits, verification."""

from __future__ import annotations

from phaselead.identify.experiment import (
    HELD_OUT,
    Experiment,
    Identified,
    identify_device,
    parse_axes,
    run_experiment,
)
from phaselead.identify.fitting import Base, FitReport, fit
from phaselead.identify.modal_fit import Drives, ModalFit, Shaping, explained, fit_modes
from phaselead.identify.modal_model import Complex, Drive, ModalModel, Samples
from phaselead.identify.modal_poles import STARTS, common_poles
from phaselead.identify.modal_response import JointExperiment, common_period, frequency_response
from phaselead.identify.operator_design import Basis, FitRun, design, fit_run, nested_basis, time_view
from phaselead.identify.operator_solve import Solved, solved_at
from phaselead.identify.runs import STILL_V, AxisRun, Sine
from phaselead.identify.table import compare_with_table_1
from phaselead.identify.verification import Verification, View, verification_dict, verify

__all__ = [
    "HELD_OUT",
    "STARTS",
    "STILL_V",
    "AxisRun",
    "Base",
    "Basis",
    "Complex",
    "Drive",
    "Drives",
    "Experiment",
    "FitReport",
    "FitRun",
    "Identified",
    "JointExperiment",
    "ModalFit",
    "ModalModel",
    "Samples",
    "Shaping",
    "Sine",
    "Solved",
    "Verification",
    "View",
    "common_period",
    "common_poles",
    "compare_with_table_1",
    "design",
    "explained",
    "fit",
    "fit_modes",
    "fit_run",
    "frequency_response",
    "identify_device",
    "nested_basis",
    "parse_axes",
    "run_experiment",
    "solved_at",
    "time_view",
    "verification_dict",
    "verify",
]
