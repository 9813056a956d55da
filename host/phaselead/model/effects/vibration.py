"""The building and its machines, seen by the sensor."""

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
    rms_um = number(params, "rms_um")
    if signal.rng is None or rms_um == 0:
        return signal.value
    n = len(signal.value)
    rate_Hz = 1 / signal.step_s
    density = spectrum(np.fft.rfftfreq(n, signal.step_s).astype(np.float64), params, rate_Hz)
    white = np.fft.rfft(signal.rng.standard_normal(n))
    return signal.value + np.fft.irfft(white * np.sqrt(density * rate_Hz / 2), n)


def variance(signal: Signal, params: Params) -> Samples:
    return np.full(len(signal.value), number(params, "rms_um") ** 2)


def spectrum(f_Hz: Samples, params: Params, rate_Hz: float) -> Samples:
    """White force on a spring and mass: its integral over all frequencies is rms_um^2."""
    rms_um, f0, width = number(params, "rms_um"), number(params, "f_Hz"), number(params, "bandwidth_Hz")
    scale = rms_um**2 * 2 * width * f0**2 / np.pi
    return np.asarray(scale / ((f0**2 - f_Hz**2) ** 2 + (width * f_Hz) ** 2))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    rms_um, f_Hz = given.one("rms_um", low=0.0), given.one("f_Hz", above=0.0)
    axis.vibration(rms_um, f_Hz, given.one("bandwidth_Hz", above=0.0))


EFFECT = Effect(
    name="vibration",
    listed=200,
    title="Vibration",
    place=Place.ENVIRONMENT,
    order=2,
    equation="S(f) = rms_um^2 (2 bandwidth_Hz f_Hz^2 / pi) / ((f_Hz^2 - f^2)^2 + (bandwidth_Hz f)^2)",
    source="response of a spring and mass to a white force, e.g. Preumont 2011, Vibration Control of Active Structures",
    parameters=(
        Parameter("rms_um", "um", 0.01, 0.0, 10.0, log=True, doc="root mean square"),
        Parameter("f_Hz", "Hz", 30.0, 1.0, 5000.0, role="shape", log=True, doc="where the peak is"),
        Parameter("bandwidth_Hz", "Hz", 5.0, 0.1, 5000.0, role="shape", log=True, doc="its width at half power"),
    ),
    shows="peaks, narrow or broad, in the spectrum of idle records; no fixed phase to anything",
    reveals="idle; an accelerometer beside the stage settles it",
    confused_with=("mains_hum", "quantisation", "sampling_jitter"),
    compensation="None: no voltage and no path predicts it. Isolation, or feedback with enough bandwidth below it.",
    kind="disturbance",
    apply=apply,
    seen_as="band",
    picture=Picture("line", {"rms_um": 0.01, "f_Hz": 120.0, "bandwidth_Hz": 20.0}),
    variance=variance,
    spectrum=spectrum,
    virtual=virtual,
)
