"""Motion of the other axes in this one."""

from __future__ import annotations

import numpy as np

from phaselead.effects.effect import Effect, Parameter, Params, Picture, Place, Samples, Signal, columns, number
from phaselead.effects.filters import relaxed

AXES = ("x", "y", "z")


def apply(signal: Signal, params: Params) -> Samples:
    y = np.array(signal.value)
    for axis, moved in signal.others_um.items():
        share = number(params, f"from_{axis}")
        if share:
            y += share * relaxed(moved, number(params, "lag_s"), signal.step_s)
    return y


def basis(signal: Signal, params: Params) -> Samples:
    still = np.zeros(len(signal.value))
    lag_s = number(params, "lag_s")
    return columns(*(relaxed(signal.others_um.get(axis, still), lag_s, signal.step_s) for axis in AXES))


def untestable(signal: Signal) -> str | None:
    if any(np.ptp(moved) > 0 for moved in signal.others_um.values()):
        return None
    return "no other axis moves in these records; record all axes while one is driven at a time"


EFFECT = Effect(
    name="cross_coupling",
    title="Cross-coupling",
    place=Place.COUPLING,
    equation="y_i = x_i + sum_j from_j (x_j - x_j,rest) / (1 + s lag_s)",
    source="Xu and Li 2010 (parasitic motion of a parallel XYZ stage, up to 4 %)",
    parameters=(
        *(Parameter(f"from_{axis}", "um/um", 0.02, -3.0, 3.0, doc=f"share of the motion of {axis}") for axis in AXES),
        Parameter("lag_s", "s", 0.0, 0.0, 0.01, role="shape", doc="time constant of the way from there to here"),
    ),
    shows="this axis moves when its own voltage stands still and another axis moves",
    reveals="one axis driven at a time, all recorded",
    confused_with=("vibration", "thermal_drift"),
    compensation="The inverse of the 3 x 3 matrix in front of the axes' feed-forward and feedback (decoupling).",
    apply=apply,
    picture=Picture("neighbour", {"from_y": 0.04}),
    basis=basis,
    untestable=untestable,
)
