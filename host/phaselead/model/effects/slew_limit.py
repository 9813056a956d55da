"""The largest current of the amplifier: its voltage cannot change faster than I/C."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from phaselead.compiled import kernel_of
from phaselead.model.axis import AxisModel
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


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_slew")
    kernel.stage_slew.argtypes = [ctypes.c_size_t, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
    kernel.stage_slew.restype = None
    return kernel


def slewed(x: ArrayLike, rise: float) -> Samples:
    """``x`` (n,) with a rate of at most ``rise`` per row."""
    x = doubles(x)
    y = np.empty_like(x)
    _kernel().stage_slew(len(x), address(x), rise, address(y))
    return y


def apply(signal: Signal, params: Params) -> Samples:
    traverse_s = number(params, "traverse_s")
    if traverse_s <= 0:
        return signal.value
    low, high = signal.span_V
    return slewed(signal.value, (high - low) / traverse_s * signal.step_s)


def reads(params: Params, axis: AxisModel) -> str:
    traverse_s = number(params, "traverse_s")
    if axis.time is None or traverse_s <= 0:
        return "no limit"
    low, high = axis.time.u_range_V
    return f"at most {(high - low) / traverse_s:.4g} V/s"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    if traverse_s := given.one("traverse_s", low=0.0):
        axis.slew(axis.range_V / traverse_s)


EFFECT = Effect(
    name="slew_limit",
    listed=90,
    title="Slew limit",
    place=Place.AMPLIFIER,
    order=0,
    equation="abs(dv/dt) <= I/C = U / traverse_s",
    source="Fleming and Leang 2014, Design, Modeling and Control of Nanopositioning Systems (electrical part)",
    parameters=(
        Parameter(
            "traverse_s", "s", 0.01, 0.0, 2.0, log=True, doc="time that the whole voltage range takes at the limit"
        ),
    ),
    shows="sines turn into triangles and steps into ramps, all of one slope; below the onset nothing at all",
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
