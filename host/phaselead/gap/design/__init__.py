"""The next experiment: which excitation would tell rival effects apart, and running it on a device."""

from __future__ import annotations

from phaselead.gap.design.excitation import about_limits
from phaselead.gap.design.next_experiment import passes, propose, sensor_for
from phaselead.gap.design.proposal import (
    axis_driven,
    excitation_of,
    modes_crossed_Hz,
    proposal_of,
    read_proposal,
    refuse_other_rate,
    run_proposal,
)

__all__ = [
    "about_limits",
    "axis_driven",
    "excitation_of",
    "modes_crossed_Hz",
    "passes",
    "proposal_of",
    "propose",
    "read_proposal",
    "refuse_other_rate",
    "run_proposal",
    "sensor_for",
]
