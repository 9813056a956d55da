"""What rounding to the device's formats does to its filter sections, computed by the device's own code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.device import AXES, device_model, inverse_refusal, wire
from phaselead.errors import BadInput
from phaselead.model import TICK_S, Stage, compensation
from phaselead.sim import load_library

TICKS = 1 << 16
"""Of the impulse response: 13 s, by when a mode of 30 Hz and a damping of 0.005 has decayed to a millionth."""
IMPULSE_um = 64.0


@dataclass(frozen=True)
class ShapeResponse:
    """Complex gain (m,) of the sections on the position, at frequencies (m,): as designed, and as the device has it."""

    f_Hz: NDArray[np.float64]
    designed: NDArray[np.complex128]
    held: NDArray[np.complex128]


def shape_response(stage: Stage, axis: str, f_Hz: ArrayLike) -> ShapeResponse:
    """Raises BadInput when the axis has no inverse, or the device cannot hold a coefficient."""
    frequencies = np.atleast_1d(np.asarray(f_Hz, dtype=np.float64))
    reason = inverse_refusal(stage.axis(axis), axis)
    if reason is not None:
        raise BadInput(f"{axis}: {reason}")
    designed = compensation(stage.axis(axis)).shape_response(frequencies)
    sections = wire.Model.unpack(device_model(stage)).axes[AXES.index(axis)].shape
    return ShapeResponse(frequencies, designed, held_response(sections, frequencies))


def held_response(sections: tuple[wire.Biquad, ...], f_Hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The Fourier transform, at the frequencies (m,), of what compiled sections make of an impulse."""
    rows = [(s.b0_q26, s.b1_q26, s.b2_q26, s.a1_q26, s.a2_q26) for s in sections]
    coefficients = np.ascontiguousarray(rows, dtype=np.int32)
    values = np.zeros(TICKS, dtype=np.int64)
    values[0] = round(IMPULSE_um * 2**40)
    load_library().host_run_sections(coefficients.ctypes.data, len(rows), values.ctypes.data, TICKS)
    turns = np.exp(-2j * np.pi * np.outer(f_Hz * TICK_S, np.arange(TICKS)))
    return np.asarray(turns @ (values / (IMPULSE_um * 2.0**40)))
