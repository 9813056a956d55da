"""The largest current of the amplifier: its voltage cannot change faster than I/C, and comes to that softly."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from phaselead.compiled import kernel_of
from phaselead.model.axis import AxisModel
from phaselead.model.effects.between_rows import nearest_straight, straight
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
"""Points a row: the way into the limit and out of it begins and ends between rows."""


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_slew")
    kernel.stage_slew.argtypes = [ctypes.c_size_t, ctypes.c_void_p, *[ctypes.c_double] * 2, ctypes.c_void_p]
    kernel.stage_slew.restype = None
    return kernel


def slewed(x: ArrayLike, rise: float, loop_rows: float = 0.0) -> Samples:
    """``x`` (n,) with a rate of at most ``rise`` per row, by a loop with a time constant of ``loop_rows``."""
    x = doubles(x)
    y = np.empty_like(x)
    _kernel().stage_slew(len(x), address(x), rise, rise * loop_rows, address(y))
    return y


def apply(signal: Signal, params: Params) -> Samples:
    traverse_s = number(params, "traverse_s")
    if traverse_s <= 0:
        return signal.value
    low, high = signal.span_V
    step_s = signal.step_s / FINE
    fine = straight(signal.value, FINE)
    return nearest_straight(slewed(fine, (high - low) / traverse_s * step_s, number(params, "loop_s") / step_s), FINE)


def reads(params: Params, axis: AxisModel) -> str:
    traverse_s = number(params, "traverse_s")
    if axis.time is None or traverse_s <= 0:
        return "no limit"
    low, high = axis.time.u_range_V
    return f"at most {(high - low) / traverse_s:.4g} V/s"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    if traverse_s := given.one("traverse_s", low=0.0):
        axis.slew(axis.range_V / traverse_s, given.one("loop_s", low=0.0))


EFFECT = Effect(
    name="slew_limit",
    listed=90,
    title="Slew limit",
    place=Place.AMPLIFIER,
    order=0,
    equation="u - v = loop_s (R artanh(p) - dv/dt),  p = (dv/dt) / R,  R = I/C = U / traverse_s: a loop whose current "
    "saturates as that of a differential pair does, I tanh, less the lag that it has at small rates, which belongs to "
    "the base. With loop_s = 0 the limit is sharp, abs(dv/dt) <= R",
    source="Fleming and Leang 2014, Design, Modeling and Control of Nanopositioning Systems (electrical part); Gray, "
    "Hurst, Lewis and Meyer 2009, Analysis and Design of Analog Integrated Circuits, sections 3.5 and 9.6 (the tanh of "
    "a pair, and the slew rate that follows). Piezo amplifiers have small-signal bandwidths from 1.6 kHz, 100 us, into "
    "large loads to 200 kHz, below 1 us",
    parameters=(
        Parameter(
            "traverse_s", "s", 0.01, 0.0, 2.0, log=True, doc="time that the whole voltage range takes at the limit"
        ),
        Parameter(
            "loop_s",
            "s",
            2e-5,
            0.0,
            1e-4,
            role="shape",
            between_forms=True,
            doc="time constant of the loop that runs into the limit: how softly it does",
        ),
    ),
    shows="sines turn into triangles and steps into ramps, all of one slope; far below the onset nothing at all",
    reveals="a ladder of frequency times amplitude: the onset is at one value of pi f U_pp",
    confused_with=("amplifier_lowpass", "saturation", "rate_dependence"),
    compensation="None: no voltage is faster than the amplifier. Set `slew_V_per_s` of the stage file below it; the "
    "device then keeps to a rate that the amplifier can follow.",
    apply=apply,
    picture=Picture("sine", {"traverse_s": 0.05}),
    reads=reads,
    virtual=virtual,
    repeatable=True,
)
