"""How much feedback a learned path is worth.

A loop takes out what no table can, since it does not repeat, and moves the stage by its sensor's noise. What a sensor
of white noise shows of an error that does not repeat has the power of that noise and of the true error, which the noise
of the same tick cannot be in yet: the loop that leaves least in the measured position leaves least in the true one.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from phaselead.control.feedback_loop import open_loop, peak_sensitivity
from phaselead.control.gains import WARN_ABOVE
from phaselead.model import TICK_S, AxisModel, Gains, small_signal
from phaselead.record import Samples

HALVINGS = 2
"""Of the gains, at most, before trials have shown how the stage answers: with an eighth, 10 um at 200 Hz fell out of
reach on a stage whose mode had gone from 200 to 180 Hz, which feedback alone had kept following."""
LEFT_OF_DRIFT = 0.1
"""Of what is as slow as the part of a trial that is looked at, which that cannot tell."""
BY_CHANCE = 3.0
"""Deviations by which two mean squares differ before they are called different."""


def scaled(gains: Gains, share: float) -> Gains:
    """The same loop with ``share`` of its gain."""
    origin = None if gains.origin is None else f"{gains.origin}, times {share:g} for a learned path"
    parts = {name: share * getattr(gains, name) for name in ("kp_V_per_um", "ki_V_per_um_s", "kd_V_s_per_um")}
    return gains.model_copy(update=parts | {"origin": origin})


def share_of(gains: Gains, asked: Gains) -> float:
    """By how much ``asked`` was scaled to give ``gains``; 1 where none of it is any feedback."""
    return next((part / whole for part, whole in zip(_parts(gains), _parts(asked), strict=True) if whole), 1.0)


def _parts(gains: Gains) -> tuple[float, float, float]:
    return gains.ki_V_per_um_s, gains.kp_V_per_um, gains.kd_V_s_per_um


def quieter(model: AxisModel, gains: Gains, seen_s: float, halvings: int | None = HALVINGS) -> Gains:
    """The gains, halved for as long as the loop still takes out what changes more slowly than within ``seen_s``, which
    trials do not tell, and has a margin; at most so many times, None: for ever."""
    plant = small_signal(model)
    f_Hz = np.geomspace(1 / seen_s, 0.5 / TICK_S, 400)
    found = gains
    for halving in itertools.count(1) if halvings is None else range(1, halvings + 1):
        tried = scaled(gains, 0.5**halving)
        loops = open_loop(plant, tried, f_Hz)
        slow = np.abs(1 / (1 + loops[:, 0])).max()
        if slow > LEFT_OF_DRIFT or peak_sensitivity(loops) > WARN_ABOVE:
            break
        found = tried
    return found


def louder(gains: Gains, at_most: Gains) -> Gains:
    """Twice the gains, and ``at_most`` all of these."""
    share = min(2 * share_of(gains, at_most), 1.0)
    return scaled(at_most, share) if share < 1 else at_most


def larger(rest_um: Samples, than_um: Samples) -> bool:
    """Whether an error (n,) that does not repeat is larger than another (n,), and not by chance."""
    before, after = (float(np.mean(one**2)) for one in (than_um, rest_um))
    deviation = math.sqrt(2 / len(than_um) + 2 / len(rest_um)) * before
    return after - before > BY_CHANCE * deviation
