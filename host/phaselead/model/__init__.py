"""The model of a stage: the stage file, the operator, the effects, simulation, prediction and what undoes them."""

from __future__ import annotations

from phaselead.model.axis import Actuator, AdoptedEffect, AxisModel, Gains, Limits, Sensor, TimeView
from phaselead.model.chain import Chain, Extra, simulate
from phaselead.model.effects import (
    Effect,
    Entry,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    catalogue,
    effect,
    number,
)
from phaselead.model.effects.filters import Mode, behind_modes, mode_coefficients, resonant, second_order_left
from phaselead.model.effects.interface import CheckedParameters, VirtualAxis
from phaselead.model.effects.mode_bank import modes_of, shares, states, states_and_slopes
from phaselead.model.effects.softening import push_level
from phaselead.model.effects.virtual import NotPlayed
from phaselead.model.fields import explained
from phaselead.model.inverse import KNOTS, PLAYS, SECTIONS, TERMS, Compensation, compensation, coupling
from phaselead.model.operator import ends_um, plays, predict_time_view, respond, rest_plays, rest_position_um
from phaselead.model.prediction import predict
from phaselead.model.sections import TICK_S, Section
from phaselead.model.stage_file import DataSource, Provenance, Stage, load_stage, parse_stage, save_stage, stage_text
from phaselead.model.table import XU_LI_2010, TablePoint, TableView

__all__ = [
    "KNOTS",
    "PLAYS",
    "SECTIONS",
    "TERMS",
    "TICK_S",
    "XU_LI_2010",
    "Actuator",
    "AdoptedEffect",
    "AxisModel",
    "Chain",
    "CheckedParameters",
    "Compensation",
    "DataSource",
    "Effect",
    "Entry",
    "Extra",
    "Gains",
    "Limits",
    "Mode",
    "NotPlayed",
    "Parameter",
    "Params",
    "Picture",
    "Place",
    "Provenance",
    "Samples",
    "Section",
    "Sensor",
    "Signal",
    "Stage",
    "TablePoint",
    "TableView",
    "TimeView",
    "VirtualAxis",
    "behind_modes",
    "catalogue",
    "compensation",
    "coupling",
    "effect",
    "ends_um",
    "explained",
    "load_stage",
    "mode_coefficients",
    "modes_of",
    "number",
    "parse_stage",
    "plays",
    "predict",
    "predict_time_view",
    "push_level",
    "resonant",
    "respond",
    "rest_plays",
    "rest_position_um",
    "save_stage",
    "second_order_left",
    "shares",
    "simulate",
    "stage_text",
    "states",
    "states_and_slopes",
]
