"""What a change of the reference does to the measured position, as the model has it and as trials show it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from phaselead.control.feedback_loop import local_gains, pid_response, plant_response
from phaselead.control.gains import MODE_SHIFT, UNSEEN_MODE
from phaselead.control.learning.lines import MOST_LINES, Amplitudes
from phaselead.model import AxisModel, Gains, SmallSignal, compensation, small_signal
from phaselead.record import Samples

GAIN_ERROR = 0.2
"""Of the local gain, up and down: that of a piezo stage changes by so much with level, load and temperature."""
LEAST_GAIN = 0.2
"""Where the stage follows a smaller share of the reference the inverse has given up: a correction would be more than
five times its error."""
UNSEEN_AT = 3.0
"""Times the first mode: where a fit's figures are not to be trusted any more. A second mode of 3 % of the motion and a
damping of 0.01, as flexure stages have it from there on, is as large as all of the rest at its peak."""
PEAK_POINTS = 4 * MOST_LINES
STILL = 1e-9
"""Of the swing, from point to point: rounding, no motion."""


@dataclass(frozen=True)
class Response:
    """Complex gain (m,) at each line, and its deviation (m,)."""

    gain: Amplitudes
    deviation: Samples
    voltage: Amplitudes
    """What a change of the reference becomes in the voltage, as a static position, (m,)."""
    bends: Samples
    """With how much of the largest change of the voltage by all others a line answers, (m,): hysteresis keeps what an
    extreme of the voltage changes for the whole way to the next, and no model has all of it."""

    followed: NDArray[np.bool_]
    """Lines (m,) that the model has the stage follow."""

    @property
    def doubt(self) -> Samples:
        """Two deviations, as a share of the gain, (m,)."""
        return 2 * self.deviation / np.maximum(np.abs(self.gain), np.finfo(float).tiny)

    def measured(self, change: Amplitudes, answer: Amplitudes, variance: Samples) -> Self:
        """Corrected by one more trial: ``change`` of the reference, ``answer`` of the position, each (m,), and the
        variance of the answer's noise (Kalman's formula, line by line)."""
        leak = self.bends * others_peak(change * self.voltage)
        share = self.deviation**2 * np.abs(change) ** 2
        weight = share / np.maximum(share + variance + leak**2, np.finfo(float).tiny)
        innovation = answer - self.gain * change
        safe = np.where(change == 0, 1, change)
        return replace(
            self,
            gain=self.gain + weight * innovation / safe * (change != 0),
            deviation=self.deviation * np.sqrt(1 - weight),
        )


def others_peak(amplitude: Amplitudes) -> Samples:
    """For each line (m,) the largest value of the sum of all others over a period."""
    turns = np.exp(2j * np.pi * np.outer(np.arange(len(amplitude)), np.arange(PEAK_POINTS) / PEAK_POINTS))
    each = (amplitude[:, None] * turns).real
    return np.asarray(np.abs(each.sum(axis=0) - each).max(axis=1))


def turns_of(values: Samples) -> int:
    """How often one period (n,) changes its direction, begins to move or stops."""
    steps = np.diff(np.append(values, values[0]))
    sign = np.where(np.abs(steps) > STILL * np.ptp(values), np.sign(steps), 0)
    return int(np.count_nonzero(sign != np.roll(sign, 1)))


def model_response(
    axis: AxisModel, gains: Gains | None, f_Hz: Samples, turns: int = 2, mode_shift: float = MODE_SHIFT
) -> Response:
    """At the frequencies (m,), for modes ``inverse`` (``gains`` None) and ``inverse+pid``.

    The deviation is half of the largest change over local gains 20 % off and modes ``mode_shift`` off, for one and the
    same inverse, and of what no model shows: as much as the response at three times the first mode, less below it.
    Raises BadInput for a model without an inverse. ``turns`` of the path in a period: what it keeps from an extreme of
    the voltage jumps at each, so that the line k has at most 2 turns / (pi k) of that.
    """
    plant = small_signal(axis)
    found = compensation(axis)
    inverse = found.shape_response(f_Hz) * found.drive.response(f_Hz) * np.exp(2j * np.pi * f_Hz * found.preview_s)
    lowest, middle, highest = local_gains(plant)
    nominal = _response(inverse, plant, gains, f_Hz, middle)
    ways = itertools.product((1 - mode_shift, 1.0, 1 + mode_shift), (1 - GAIN_ERROR, 1.0, 1 + GAIN_ERROR))
    others = [
        _response(inverse, plant.with_modes_at(shift), gains, f_Hz, local, share)
        for shift, share in ways
        for local in (lowest, highest)
    ]
    furthest = np.max(np.abs(np.array(others) - nominal), axis=0)
    first_Hz = min((mode[1] for mode in plant.modes), default=UNSEEN_MODE[1])
    unseen = np.abs(nominal) * f_Hz / (UNSEEN_AT * first_Hz)
    plays = (highest - lowest) / (highest + lowest)
    jumps = np.minimum(1, 2 * turns / (np.pi * np.maximum(np.arange(len(f_Hz)), 1)))
    bends = GAIN_ERROR * plays * jumps * np.minimum(1, np.abs(plant_response(plant, f_Hz)))
    return Response(nominal, (furthest + unseen) / 2, inverse, bends, np.abs(nominal) >= LEAST_GAIN)


def _response(
    inverse: Amplitudes, plant: SmallSignal, gains: Gains | None, f_Hz: Samples, local: float, share: float = 1.0
) -> Amplitudes:
    """``inverse`` (m,): of the dynamics; ``share``: the stage's gain against what the inverse takes it for."""
    dynamics = plant_response(plant, f_Hz) * share
    forward = dynamics * inverse
    if gains is None:
        return np.asarray(forward)
    loop = local * dynamics * pid_response(gains, np.maximum(f_Hz, 1e-3))
    return np.asarray((forward + loop) / (1 + loop))


def other_loop(axis: AxisModel, before: Gains, after: Gains, f_Hz: Samples) -> Amplitudes:
    """By what a path's error changes at each of its lines (m,) with other gains: (1 + L)/(1 + L'), on the model at its
    middle local gain. The level, which both hold, stays."""
    plant = plant_response(small_signal(axis), f_Hz)
    loops = [1 + plant * controller for controller in _controllers(axis, (before, after), f_Hz)]
    return np.where(f_Hz > 0, loops[0] / loops[1], 1.0)


def same_voltage(
    axis: AxisModel, loops: tuple[Gains, Gains], f_Hz: Samples, voltage: Amplitudes, apart_um: Amplitudes
) -> Amplitudes:
    """What to add to the reference (m,) for the voltage to stay what it was when the gains change from the first of
    ``loops`` to the second. ``voltage`` (m,): as in ``Response``; ``apart_um`` (m,): reference less position. The level
    stays.

    The controller alone decides that, C (r - x) + F r, whatever the stage is.
    """
    before, after = _controllers(axis, loops, f_Hz)
    return np.where(f_Hz > 0, (before - after) * apart_um / _safe(voltage + after), 0)


def in_other_loop(
    axis: AxisModel, loops: tuple[Gains, Gains], f_Hz: Samples, known: Response, of_model: Response
) -> Response:
    """What is ``known`` with the first gains of ``loops``, with the second: by the plant P that it tells of, as
    (F + C) P / (1 + C P). ``of_model``: what the model has of these."""
    before, after = _controllers(axis, loops, f_Hz)
    forward, left = known.voltage + before, _safe(known.voltage + before - before * known.gain)
    plant = known.gain / left
    closed = _safe(1 + after * plant)
    slope = np.abs(forward * (known.voltage + after) / (left * closed) ** 2)
    return replace(
        of_model,
        gain=plant * (known.voltage + after) / closed,
        deviation=np.minimum(of_model.deviation, known.deviation * slope),
    )


def _controllers(axis: AxisModel, loops: tuple[Gains, Gains], f_Hz: Samples) -> list[Amplitudes]:
    """Times the middle local gain."""
    middle = local_gains(small_signal(axis))[1]
    return [np.asarray(middle * pid_response(gains, np.maximum(f_Hz, 1e-3))) for gains in loops]


def _safe(divisor: Amplitudes) -> Amplitudes:
    return np.where(np.abs(divisor) < STILL, STILL, divisor)
