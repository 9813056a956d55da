"""A structure whose stiffness changes with its deflection."""

from __future__ import annotations

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
    columns,
    with_columns,
)

SIZES = ("square", "cube")


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    z = signal.displacement_um / signal.range_um
    return columns(signal.range_um * z**2, signal.range_um * z**3)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    square, cube = (given.one(name) for name in SIZES)
    axis.stiffness(square, cube)


EFFECT = Effect(
    name="stiffness_nonlinearity",
    title="Stiffness nonlinearity",
    place=Place.MECHANICS,
    order=3,
    equation="y = x + X (square z^2 + cube z^3),  z = (x - x_rest)/X, of the position as it moves, modes included",
    source="Nayfeh and Mook 1979, Nonlinear Oscillations (quadratic and cubic stiffness; first order of the series in "
    "the deflection, the modes taken as before it)",
    parameters=(
        Parameter("square", "1", 0.01, -0.5, 0.5, doc="deflection added at the whole range, as a share of it: even"),
        Parameter("cube", "1", 0.01, -0.5, 0.5, doc="the same, odd: above 0 the structure softens"),
    ),
    shows="second and third harmonics that grow with the square and the cube of the motion, resonances included",
    reveals="one multisine at several levels and biases, with a mode strongly excited",
    confused_with=("asymmetric_hysteresis", "saturation", "softening"),
    hard_to_tell_from=("sensor_nonlinearity",),
    alone_as="sensor_nonlinearity",
    compensation="None: the device bends voltages, not positions. Feedback takes it out, since the stage does move "
    "that way.",
    apply=apply,
    picture=Picture("difference", {"square": 0.01, "cube": -0.015}, base="plays"),
    basis=basis,
    virtual=virtual,
)
