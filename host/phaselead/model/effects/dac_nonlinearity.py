"""Integral nonlinearity of the output converter, in its own codes."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel
from phaselead.model.effects.code_grid import CodeGrid, calibrated
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

TOP_BITS = 5
"""Bits with a weight of their own, from the first (MSB) on: where the weights of a ladder scatter with the root of
their size, 94 % of the squared error is theirs."""
BITS = tuple(f"bit{i + 1}_LSB" for i in range(TOP_BITS))
SIZES = ("bow_LSB", *BITS)
MOST_LSB = 16.0
"""What 16-bit converters are sold with at the most."""
INL_CODES = 2**12
"""At which the largest error is looked for: within 1/128 of a segment from its ends."""


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    """In volts; the error at 0 V belongs to the offset."""
    grid = signal.code_grid
    at, zero = (_errors(grid.codes(v), grid.bits) for v in (signal.value, np.zeros(1)))
    return np.asarray(grid.step_V * (at - zero))


def _errors(codes: Samples, bits: int) -> Samples:
    """(n, 1 + TOP_BITS) in LSB for one LSB of each size, 0 at the first code and at the last."""
    share = codes / (2**bits - 1)
    whole = codes.astype(np.int64)
    weights = [(whole >> max(bits - i - 1, 0)) % 2 * (i < bits) for i in range(TOP_BITS)]
    return columns(4 * share * (1 - share), *(bit - share * (i < bits) for i, bit in enumerate(weights)))


def predistorted(axis: AxisModel, params: Params, u_V: Samples) -> Samples:
    """The voltages (n,) to ask for so that a converter with this error, calibrated as ``axis`` says, puts out ``u_V``
    (n,) as nearly as its codes can, but for a constant."""
    grid = calibrated(axis.actuator)
    out_V = grid.volts + grid.step_V * _error_LSB(params, grid)
    order = np.argsort(out_V, kind="stable")
    rising = out_V[order]
    above = np.clip(np.searchsorted(rising, u_V), 1, len(rising) - 1)
    nearest = np.where(u_V - rising[above - 1] < rising[above] - u_V, above - 1, above)
    return np.asarray(grid.volts[order[nearest]])


def _error_LSB(params: Params, grid: CodeGrid) -> Samples:
    """(2^bits,) at every code, less that at 0 V."""
    sizes = np.array([number(params, name) for name in SIZES])
    zero = _errors(grid.codes(np.zeros(1)), grid.bits)
    return np.asarray((_errors(np.arange(2.0**grid.bits), grid.bits) - zero) @ sizes)


def _inl_LSB(params: Params, scene: Scene) -> float:
    """The largest departure from the straight line through the first code and the last."""
    sizes = np.array([number(params, name) for name in SIZES])
    bits = INL_CODES.bit_length() - 1
    return float(np.max(np.abs(_errors(np.arange(float(INL_CODES)), bits) @ sizes)))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    bow_LSB, *bits_LSB = (given.one(name) for name in SIZES)
    axis.converter_errors(bow_LSB, bits_LSB)


EFFECT = Effect(
    name="dac_nonlinearity",
    listed=240,
    title="DAC nonlinearity",
    place=Place.CONVERTER,
    equation="u' = u + LSB (4 bow_LSB s (1 - s) + sum_i biti_LSB (b_i - s)),  b_i: bit i of the code, bit 1 the most "
    "significant, s = 0..1 over all codes; less its value at 0 V. The codes are those of the voltages' common step, "
    "or those of the stage file's actuator",
    source="Kester 2005, The Data Conversion Handbook (integral nonlinearity by the end-point method; weight errors of "
    "the bits of an R-2R ladder and of the segments of a segmented converter)",
    parameters=(
        Parameter("bow_LSB", "LSB", 2.0, -MOST_LSB, MOST_LSB, doc="bow over all codes"),
        *(
            Parameter(name, "LSB", 1.0, -MOST_LSB, MOST_LSB, doc=f"excess weight of bit {i + 1}")
            for i, name in enumerate(BITS)
        ),
    ),
    derived=(Derived("inl_LSB", "LSB", _inl_LSB, doc="largest error over all codes, as a data sheet says it"),),
    shows="an error fixed to the code: the same at every visit of a voltage, whatever the speed and history; jumps "
    "at halves, quarters and eighths of the converter's span",
    reveals="slow ramps over the same positions reached from two offsets",
    confused_with=("sensor_nonlinearity", "asymmetric_hysteresis"),
    compensation="A table over the code takes it out (`dac_nonlinearity.predistorted` gives the codes to ask for); at "
    "1-4 LSB it is below the other errors and the device leaves it to feedback.",
    apply=apply,
    picture=Picture("difference", {"bow_LSB": 2.0, "bit2_LSB": 2.0, "bit3_LSB": -1.5}),
    basis=basis,
    virtual=virtual,
)
