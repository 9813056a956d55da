"""The feedback that a learned path needs: against what drifts, and with the least motion from noise.

What repeats is in the table, and what changes within a trial is seen there. Only what drifts more slowly is left to the
loop. The parts of a PID that make it quick pass the sensor's noise on to the mode; an integrator as slow as drift
allows, behind a low-pass below the mode, does not, and the low-pass turns what is left of it at the mode into damping,
which calms what the steps of the output converter shake there, as far as these are noise: feedback that passes on none
does not dither them either, so that trials tell whether it leaves less.
"""

from __future__ import annotations

import math

import numpy as np

from phaselead.control.feedback_loop import frequencies, local_gains, open_loop, peak_sensitivity, plant_response
from phaselead.control.gains import MODE_SHIFT, PEAK_SENSITIVITY
from phaselead.control.learning.quieter import LEFT_OF_DRIFT
from phaselead.model import AxisModel, Gains, LoopFilter, SmallSignal, small_signal

CORNERS = np.geomspace(1 / 16, 1.0, 17)
"""Of the low-pass, times the frequency of the first mode: four octaves, in quarters."""
FLAT = 2**-0.5
"""Its damping: Butterworth's."""


def drift_loop(model: AxisModel, gains: Gains, seen_s: float) -> Gains | None:
    """An integrator that leaves ``LEFT_OF_DRIFT`` of what changes as slowly as within ``seen_s`` at the lowest local
    gain, behind the low-pass below the first mode with which noise moves the stage least; modes anywhere ``MODE_SHIFT``
    off. None where these gains have no more of an integral part than that, or no such loop has the margin that gains
    are designed for."""
    plant = small_signal(model)
    ki = 2 * math.pi / seen_s * math.sqrt(LEFT_OF_DRIFT**-2 - 1) / float(local_gains(plant)[0])
    if not plant.modes or ki >= gains.ki_V_per_um_s:
        return None
    first_Hz = min(f for _, f, _ in plant.modes)
    origin = "against drift alone, for a learned path"
    tried = [
        Gains(
            kp_V_per_um=0.0, ki_V_per_um_s=ki, kd_V_s_per_um=0.0, filters=(_lowpass(share * first_Hz),), origin=origin
        )
        for share in CORNERS
    ]
    moved_um, best = min(((_worst_um(model, plant, one), one) for one in tried), key=lambda pair: pair[0])
    return best if math.isfinite(moved_um) else None


def _lowpass(corner_Hz: float) -> LoopFilter:
    return LoopFilter(zeros_Hz=0.0, zeros_zeta=0.0, poles_Hz=corner_Hz, poles_zeta=FLAT)


def _worst_um(model: AxisModel, plant: SmallSignal, gains: Gains) -> float:
    """By how much noise moves the stage, um rms, at most; infinite where it has no margin."""
    return max(_moved_um(model, plant.with_modes_at(s), gains) for s in (1 - MODE_SHIFT, 1.0, 1 + MODE_SHIFT))


def _moved_um(model: AxisModel, plant: SmallSignal, gains: Gains) -> float:
    """At the middle local gain, by the noise of the sensor and the steps of the output converter, both white."""
    f_Hz = frequencies(plant)
    loops = open_loop(plant, gains, f_Hz)
    if peak_sensitivity(loops) > PEAK_SENSITIVITY:
        return math.inf
    output, sensitivity = model.actuator, 1 / (1 + loops[1])
    step_V = (output.u_max_V - output.u_min_V) / 2**output.bits / math.sqrt(12)
    shaken_um = step_V * local_gains(plant)[1] * plant_response(plant, f_Hz)
    heard_um = model.sensor.noise_um_rms * loops[1]
    density = np.abs(sensitivity) ** 2 * (np.abs(shaken_um) ** 2 + np.abs(heard_um) ** 2) / f_Hz[-1]
    return math.sqrt(float(np.trapezoid(density, f_Hz)))
