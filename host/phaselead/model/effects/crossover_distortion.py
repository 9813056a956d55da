"""The dead zone of an amplifier's output stage, as the amplifier's own feedback leaves it."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from phaselead.compiled import kernel_of
from phaselead.model.effects.between_rows import band_limited, derivative_at_rows
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
from phaselead.model.operator import address, doubles

FINE = 4
"""Points a row: a reversal between two rows crosses the dead zone too."""


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_crossover")
    kernel.stage_crossover.argtypes = [ctypes.c_size_t, ctypes.c_void_p, *[ctypes.c_double] * 2, ctypes.c_void_p]
    kernel.stage_crossover.restype = None
    return kernel


def _stood_off(u: Samples, width_V: float, ratio: float) -> Samples:
    """z (n,) for a step of ``ratio`` times tau."""
    u = doubles(u)
    z = np.empty_like(u)
    _kernel().stage_crossover(len(u), address(u), width_V / 2, ratio, address(z))
    return z


def apply(signal: Signal, params: Params) -> Samples:
    width_V, tau_s = number(params, "width_V"), number(params, "tau_s")
    if width_V <= 0 or np.ptp(signal.value) == 0:
        return signal.value
    z = _stood_off(band_limited(signal.value, FINE), width_V, signal.step_s / (FINE * tau_s))
    return np.asarray(signal.value - tau_s * derivative_at_rows(z, FINE, signal.step_s))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.crossover(given.one("width_V", low=0.0) / 2, given.one("tau_s", above=0.0))


EFFECT = Effect(
    name="crossover_distortion",
    title="Crossover distortion",
    place=Place.AMPLIFIER,
    order=-1,
    equation="v = u - tau_s dz/dt,  z = d - play_r[d],  tau_s dd/dt = u - play_r[d],  2 r = width_V: the output stage "
    "holds its voltage while its drive d crosses the dead zone, and the loop that drives it needs tau_s. What the same "
    "loop does to a small signal without a dead zone, 1 / (1 + s tau_s), is `amplifier_lowpass`",
    source="Gray, Hurst, Lewis and Meyer 2009, Analysis and Design of Analog Integrated Circuits, section 5.4 (class B "
    "output stages, and what feedback leaves of their dead zone); a capacitive load holds its voltage meanwhile, as a "
    "play does. Between the rows the voltage is taken as band-limited, with nothing above half the sampling rate",
    parameters=(
        Parameter("width_V", "V", 0.02, 0.0, 0.5, log=True, doc="dead zone, in volts of the input"),
        Parameter(
            "tau_s", "s", 1e-4, 1e-5, 0.01, role="shape", log=True, doc="of the loop: 1 / (2 pi its bandwidth in Hz)"
        ),
    ),
    shows="after each reversal the voltage stands still for a moment: of one size in volts, nothing at rest or in slow "
    "motion, growing with frequency up to the bandwidth of the amplifier",
    reveals="one multisine up to the bandwidth of the amplifier at several levels down to a few times the width",
    confused_with=("dead_band", "backlash", "amplifier_lowpass"),
    alone_as="backlash",
    compensation="None: it takes an amplifier with more quiescent current, or a faster loop.",
    apply=apply,
    fitted_with_modes=True,
    picture=Picture("loop", {"width_V": 2.0, "tau_s": 5e-3}),
    virtual=virtual,
    repeatable=True,
)
