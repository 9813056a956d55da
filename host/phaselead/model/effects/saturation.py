"""The amplifier's rails."""

from __future__ import annotations

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.interface import (
    CheckedParameters,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    number,
)


def apply(signal: Signal, params: Params) -> Samples:
    low, high = _rails(params, signal.span_V)
    return np.clip(signal.value, low, high)


def _rails(params: Params, span_V: tuple[float, float]) -> tuple[float, float]:
    """A share of 0 is no rail at all: nobody knows where it is."""
    low, high = span_V
    top, bottom = number(params, "top"), number(params, "bottom")
    return (
        low + bottom * (high - low) if bottom > 0 else -np.inf,
        high - top * (high - low) if top > 0 else np.inf,
    )


def reads(params: Params, axis: AxisModel) -> str:
    if axis.time is None:
        return "no rails"
    low, high = _rails(params, axis.time.u_range_V)
    return f"rails at {low:.4g} and {high:.4g} V"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    top, bottom = given.one("top", low=0.0, below=0.5), given.one("bottom", low=0.0, below=0.5)
    low = axis.span_V[0] + bottom * axis.range_V if bottom else -1e9
    high = axis.span_V[1] - top * axis.range_V if top else 1e9
    if not low < high:
        raise BadInput(f"{given.label}: the rails leave no room between them; lower top or bottom")
    axis.clip(low, high)


EFFECT = Effect(
    name="saturation",
    listed=100,
    title="Saturation",
    place=Place.AMPLIFIER,
    order=2,
    equation="v = min(max(u, U_min + bottom U), U_max - top U)",
    source="by definition",
    parameters=(
        Parameter("top", "of voltage range", 0.05, 0.0, 0.45, doc="lost at the upper end of the voltages of the fit"),
        Parameter("bottom", "of voltage range", 0.05, 0.0, 0.45, doc="lost at the lower end"),
    ),
    shows="flat tops locked to one voltage, whatever the frequency",
    reveals="an amplitude ladder up to both ends of the range",
    confused_with=("slew_limit", "asymmetric_hysteresis", "sensor_nonlinearity"),
    compensation="None: the range is gone. Set `u_min_V` and `u_max_V` of the stage file inside the rails; paths that "
    "need more are then refused.",
    apply=apply,
    exact=True,
    picture=Picture("sine", {"top": 0.15, "bottom": 0.1}),
    reads=reads,
    virtual=virtual,
    repeatable=True,
)
