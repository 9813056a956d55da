"""The amplifier's rails."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel
from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number


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


EFFECT = Effect(
    name="saturation",
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
    picture=Picture("sine", {"top": 0.15, "bottom": 0.1}),
    compensated=False,
    reads=reads,
)
