"""Steps of the sensor's converter."""

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
    number,
)


def apply(signal: Signal, params: Params) -> Samples:
    """With ``rng``, rounded. Without, the expectation: under noise of half a step and more that is the signal."""
    lsb_um = number(params, "lsb_um")
    if signal.rng is None or lsb_um <= 0:
        return signal.value
    return np.asarray(np.round(signal.value / lsb_um) * lsb_um)


def variance(signal: Signal, params: Params) -> Samples:
    return np.full(len(signal.value), number(params, "lsb_um") ** 2 / 12)


def spectrum(f_Hz: Samples, params: Params, rate_Hz: float) -> Samples:
    """White up to half the sampling rate."""
    return np.full(len(f_Hz), number(params, "lsb_um") ** 2 / 12 * 2 / rate_Hz)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.steps(given.one("lsb_um", low=0.0))


EFFECT = Effect(
    name="quantisation",
    listed=170,
    title="Quantisation",
    place=Place.SENSOR,
    order=5,
    equation="y = lsb_um round(x / lsb_um);  variance lsb_um^2 / 12, white when the signal crosses many steps",
    source="Widrow and Kollar 2008, Quantization Noise",
    parameters=(Parameter("lsb_um", "um", 0.008, 0.0, 10.0, log=True, doc="step of the converter"),),
    shows="plateaus; all values lie on a grid",
    reveals="idle and very slow ramps",
    confused_with=("vibration",),
    compensation="None below a step. Noise of half a step and averaging get below it; the Kalman or low-pass filter of "
    "the measurement does so at the price of delay.",
    kind="disturbance",
    apply=apply,
    seen_as="grid",
    picture=Picture("ramp", {"lsb_um": 0.008}),
    variance=variance,
    spectrum=spectrum,
    virtual=virtual,
)
