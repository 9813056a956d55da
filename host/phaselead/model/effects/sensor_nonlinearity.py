"""A sensor whose scale is not straight."""

from __future__ import annotations

import numpy as np

from phaselead.model.effects.interface import (
    CheckedParameters,
    Derived,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Scene,
    Signal,
    VirtualAxis,
    columns,
    number,
    with_columns,
)
from phaselead.model.operator import ends_um, range_um

SIZES = ("quadratic", "cubic", "quartic", "linear")
WORST = 0.01
"""Of range: what metal foil and piezoresistive strain gauges are accurate to, the worst sensors that Fleming 2013
compares; capacitive and eddy current sensors have 0.001, LVDTs 0.0025."""
CURVE_POINTS = 401
"""At which the largest error is looked for: within 1e-4 of it."""


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    low, high = ends_um(signal.axis)
    s = (2 * signal.value - (low + high)) / ((high - low) or 1.0)
    return np.asarray(signal.range_um * np.column_stack([_curves(s), (1 + s) / 2]))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    quadratic, cubic, quartic, linear = (given.one(name) for name in SIZES)
    axis.sensor_curve(quadratic, cubic, quartic, linear)


def _curves(s: Samples) -> Samples:
    """(n, 3), of range, for s = -1..1: quadratic, cubic and quartic."""
    bow = 1 - s**2
    return columns(bow, 1.5 * 3**0.5 * s * bow, 4 * s**2 * bow)


def _peak(params: Params, _scene: Scene) -> float:
    curve = _curves(np.linspace(-1, 1, CURVE_POINTS)) @ np.array([number(params, name) for name in SIZES[:3]])
    return float(np.max(np.abs(curve)))


def _peak_um(params: Params, scene: Scene) -> float:
    return _peak(params, scene) * range_um(scene.axis)


EFFECT = Effect(
    name="sensor_nonlinearity",
    listed=140,
    title="Sensor nonlinearity",
    place=Place.SENSOR,
    order=3,
    equation="y = x + X (1 - s^2) (quadratic + 2.6 cubic s + 4 quartic s^2) + X linear (1 + s)/2,  s = -1..1 over the "
    "range; the first three peak at 1 and are 0 at both ends (terminal linearity)",
    source="Fleming 2013, A review of nanometer resolution position sensors (calibration and nonlinearity)",
    parameters=(
        Parameter("quadratic", "of range", 0.002, -0.1, 0.1, known=(-WORST, WORST), doc="bow"),
        Parameter("cubic", "of range", 0.001, -0.1, 0.1, known=(-WORST, WORST), doc="S shape"),
        Parameter("quartic", "of range", 0.001, -0.1, 0.1, known=(-WORST, WORST), doc="W shape"),
        Parameter(
            "linear",
            "of range",
            0.001,
            -WORST,
            WORST,
            absorbed_by_refit=True,
            by_itself="gain_change",
            doc="slope: its maker set the scale elsewhere; by itself it is a change of gain",
        ),
    ),
    derived=(
        Derived("peak_um", "um", _peak_um, doc="largest departure from a straight line over the range"),
        Derived("nonlinearity", "of range", _peak, doc="the same, as data sheets of sensors say it"),
    ),
    shows="an error that depends on the position, not on the voltage: the same on both branches of the loop",
    reveals="a bias ladder of small loops; a second sensor settles it",
    confused_with=("asymmetric_hysteresis", "dac_nonlinearity", "saturation"),
    compensation="None: the controller does not bend the measured position. Feedback cannot find it: the stage follows "
    "its sensor. Only a better sensor shows that the curve is one of the sensor and not of the stage.",
    apply=apply,
    hard_to_tell_from=("gain_change",),
    picture=Picture("difference", {"quadratic": 0.002, "cubic": 0.001}, base="plays"),
    basis=basis,
    virtual=virtual,
)
