"""Integral nonlinearity of the output converter."""

from __future__ import annotations

import numpy as np

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
    number,
    with_columns,
)

SIZES = ("bow_LSB", "s_LSB", "segment_LSB")
MOST_LSB = 16.0
"""What 16-bit converters are sold with at the most."""


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    """In volts; the error at 0 V belongs to the offset."""
    actuator = signal.axis.actuator
    low, high = actuator.u_min_V, actuator.u_max_V
    lsb_V = (high - low) / 2**actuator.bits
    code, zero = ((2 * v - (low + high)) / (high - low) for v in (signal.value, np.zeros(1)))
    segments = number(params, "segments")
    return np.asarray(lsb_V * (_curves(code, segments) - _curves(zero, segments)))


def _curves(code: Samples, segments: float) -> Samples:
    """(n, 3) for codes -1..1."""
    bow = 1 - code**2
    return columns(bow, 1.5 * 3**0.5 * code * bow, np.sin(np.pi * segments * code))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    actuator = axis.model.actuator
    V_per_code = (actuator.u_max_V - actuator.u_min_V) / 2**actuator.bits
    bow_V, s_V, segment_V = (given.one(name) * V_per_code for name in SIZES)
    axis.converter_curve(bow_V, s_V, segment_V, given.one("segments"))


EFFECT = Effect(
    name="dac_nonlinearity",
    listed=240,
    title="DAC nonlinearity",
    place=Place.CONVERTER,
    equation="u' = u + LSB (bow_LSB (1 - s^2) + 2.6 s_LSB s (1 - s^2) + segment_LSB sin(pi segments s)),  s = -1..1 "
    "over all codes, less its value at 0 V",
    source="Kester 2005, The Data Conversion Handbook (integral nonlinearity of segmented converters)",
    parameters=(
        Parameter("bow_LSB", "LSB", 2.0, -MOST_LSB, MOST_LSB, doc="bow over all codes"),
        Parameter("s_LSB", "LSB", 1.0, -MOST_LSB, MOST_LSB, doc="S shape over all codes"),
        Parameter("segment_LSB", "LSB", 1.0, -MOST_LSB, MOST_LSB, doc="repeats in every segment"),
        Parameter("segments", "1", 16.0, 2.0, 64.0, role="shape", log=True, doc="waves over all codes"),
    ),
    shows="an error fixed to the code: the same at every visit of a voltage, whatever the speed and history",
    reveals="slow ramps over the same positions reached from two offsets",
    confused_with=("sensor_nonlinearity", "asymmetric_hysteresis"),
    compensation="A table over the code could take it out; at 1-4 LSB it is below the other errors and the device "
    "leaves it to feedback.",
    apply=apply,
    picture=Picture("difference", {"bow_LSB": 3.0, "segment_LSB": 1.0}),
    basis=basis,
    virtual=virtual,
)
