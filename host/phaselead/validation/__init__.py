"""Blind trials of the gap workflow: effects are hidden in independent simulations, and the answers are scored."""

from __future__ import annotations

from phaselead.validation.campaign import CampaignPlan, run_campaign
from phaselead.validation.result import CampaignResult
from phaselead.validation.summary import FAILED, NOTHING, UNKNOWN
from phaselead.validation.table import reached, write_table
from phaselead.validation.truth import KINDS, ON_REQUEST

__all__ = [
    "FAILED",
    "KINDS",
    "NOTHING",
    "ON_REQUEST",
    "UNKNOWN",
    "CampaignPlan",
    "CampaignResult",
    "reached",
    "run_campaign",
    "write_table",
]
