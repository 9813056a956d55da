"""From recordings to a stage file: experiments, fits, verification."""

from __future__ import annotations

from phaselead.identify.experiment import Identified, identify_device, run_experiment
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import Base, fit
from phaselead.identify.kept import Kept, keeping
from phaselead.identify.modal import (
    Drive,
    Drives,
    JointExperiment,
    ModalFit,
    ModalModel,
    Shaping,
    common_period,
    common_poles,
    fit_modes,
    frequency_response,
    score_test,
)
from phaselead.identify.operator import (
    Turns,
    amounts_before,
    apart_from,
    effective_rows,
    fit_plays,
    fitted_span_V,
    play_thresholds,
    starting_memory,
    way_before,
)
from phaselead.identify.plan import HELD_OUT, Experiment, plan_as_time_allows, plan_of, plan_seconds
from phaselead.identify.runs import DRIVEN_SHARE, SAME_RATE, STILL_V, AxisRun, SineDrive
from phaselead.identify.table import compare_with_table_1
from phaselead.identify.verification import Verification, View, verify
from phaselead.identify.verifications import Verifications, judge
from phaselead.identify.words import noise_um_rms

__all__ = [
    "DRIVEN_SHARE",
    "HELD_OUT",
    "SAME_RATE",
    "STILL_V",
    "AxisRun",
    "Base",
    "Drive",
    "Drives",
    "Experiment",
    "FitResult",
    "Identified",
    "JointExperiment",
    "Kept",
    "ModalFit",
    "ModalModel",
    "Shaping",
    "SineDrive",
    "Turns",
    "Verification",
    "Verifications",
    "View",
    "amounts_before",
    "apart_from",
    "common_period",
    "common_poles",
    "compare_with_table_1",
    "effective_rows",
    "fit",
    "fit_modes",
    "fit_plays",
    "fitted_span_V",
    "frequency_response",
    "identify_device",
    "judge",
    "keeping",
    "noise_um_rms",
    "plan_as_time_allows",
    "plan_of",
    "plan_seconds",
    "play_thresholds",
    "run_experiment",
    "score_test",
    "starting_memory",
    "verify",
    "way_before",
]
