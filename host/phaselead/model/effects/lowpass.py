"""What the low-pass effects share: a corner frequency in place of the time constant, and how they are simulated."""

from __future__ import annotations

import math

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.parameters import CheckedParameters, Params, number
from phaselead.model.effects.virtual import VirtualAxis


def from_corner(params: Params) -> Params:
    """``corner_Hz`` as ``tau_s``. Raises BadInput when it is not above 0."""
    if "corner_Hz" not in params:
        return params
    corner_Hz = number(params, "corner_Hz")
    if not corner_Hz > 0 or "tau_s" in params:
        raise BadInput("a low-pass effect takes tau_s, or corner_Hz above 0, and not both")
    return {"tau_s": 1 / (2 * math.pi * corner_Hz)}


def corner_reads(params: Params, axis: AxisModel) -> str:
    """The corner, for people."""
    tau_s = number(params, "tau_s")
    return f"corner at {1 / (2 * math.pi * tau_s):.4g} Hz" if tau_s > 0 else "no corner"


def virtual_lowpass(axis: VirtualAxis, given: CheckedParameters) -> None:
    """One pole at the place of the effect."""
    axis.lowpass(given.one("tau_s", low=0.0), given.written("corner_Hz"))
