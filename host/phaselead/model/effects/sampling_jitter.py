"""Samples taken a little early or late."""

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
    """With ``rng``, one realisation. Without, the expectation: the signal itself."""
    rms_s = number(params, "rms_s")
    if signal.rng is None or rms_s == 0:
        return signal.value
    return signal.value + rms_s * signal.rng.standard_normal(len(signal.value)) * _rate(signal)


def variance(signal: Signal, params: Params) -> Samples:
    return np.asarray((number(params, "rms_s") * _rate(signal)) ** 2)


def _rate(signal: Signal) -> Samples:
    """um/s."""
    if len(signal.value) < 2:
        return np.zeros(len(signal.value))
    return np.gradient(signal.value, signal.step_s)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.jitter(given.one("rms_s", low=0.0))


EFFECT = Effect(
    name="sampling_jitter",
    listed=230,
    title="Sampling jitter",
    place=Place.SENSOR,
    order=4,
    equation="y(t) = x(t + e),  e random with rms_s: variance rms_s^2 (dx/dt)^2",
    source="Kester 2005, The Data Conversion Handbook (aperture jitter)",
    parameters=(Parameter("rms_s", "s", 2e-6, 0.0, 1e-3, log=True, doc="root mean square of the time error"),),
    shows="noise that grows with the speed: none at the turning points, most in between",
    reveals="fast large sines against idle",
    confused_with=("vibration", "quantisation"),
    compensation="None: each sample's time error is random. The device samples at the tick edge by hardware; a host "
    "that polls does not.",
    kind="disturbance",
    apply=apply,
    seen_as="speed",
    picture=Picture("sine", {"rms_s": 1e-3}),
    variance=variance,
    virtual=virtual,
)
