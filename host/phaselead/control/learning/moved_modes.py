"""Modes that have moved since the model was made: what the first trial says of them, and the model that has them there.

The inverse of a mode gives almost no voltage at it. Where the stage's mode is elsewhere, a path near the model's asks
for many times its swing in the reference, or for much feedback; with the mode where it is, for neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.control.feedback_loop import local_gains, plant_response
from phaselead.control.gains import MODE_SHIFT
from phaselead.control.learning.law import MARGIN
from phaselead.control.learning.lines import Amplitudes, Lines, error_lines
from phaselead.control.learning.response import GAIN_ERROR, UNSEEN_AT, others_peak
from phaselead.model import (
    AdoptedEffect,
    AxisModel,
    SmallSignal,
    Stage,
    compensation,
    respond,
    rest_plays,
    small_signal,
)
from phaselead.record import Samples

TRIED = np.exp(np.linspace(-3 * MODE_SHIFT, 3 * MODE_SHIFT, 601))
"""Times the modes' frequencies: six deviations of what is known of them either way, in steps of a thousandth."""
SURE = 2.0
"""Deviations by which modes must have moved."""


@dataclass(frozen=True)
class Moved:
    """By which factor the modes of an axis have moved, and its deviation."""

    factor: float
    deviation: float
    astray: float = 0.0
    """By which share of what the model has of it the path's lines answer otherwise, at most."""

    @property
    def surely(self) -> bool:
        """And so far that what is learned by the model as it is would not surely converge."""
        return abs(self.factor - 1) > SURE * self.deviation and self.astray > 1 - MARGIN


def moved_modes(
    model: AxisModel, t_s: Samples, u_V: Samples, x_um: Samples, f_Hz: float, turns: int, rate_Hz: float
) -> Moved:
    """From the voltage and the measured position (n,) of a settled path of ``f_Hz``, all modes moving together.

    The operator of the model makes a static position V of the voltage, and X = g D(s) V line by line, with a gain g off
    by ``GAIN_ERROR`` and the dynamics D of the model with its modes at s times their frequency, s off by
    ``MODE_SHIFT`` (both two deviations). What the plays keep of an extreme of the voltage, and what the model does not
    show of the dynamics, is as uncertain as in ``model_response``.
    """
    plant = small_signal(model)
    view = compensation(model).view
    still_um = respond(view, u_V, rest_plays(view))[0]
    first_Hz = min((f for _, f, _ in plant.modes), default=0.0)
    count = int(min(UNSEEN_AT * first_Hz, rate_Hz / 2) / f_Hz * (1 - 1e-9))
    if count < 1:
        return Moved(1.0, 0.0)
    asked, moved = (error_lines(t_s, one, f_Hz, count, rate_Hz) for one in (still_um, x_um))
    return _posterior(plant, f_Hz * asked.number.astype(np.float64), asked, moved, turns)


def _posterior(plant: SmallSignal, f_Hz: Samples, asked: Lines, moved: Lines, turns: int) -> Moved:
    lowest, _, highest = local_gains(plant)
    plays = GAIN_ERROR * (highest - lowest) / (highest + lowest)
    jumps = np.minimum(1, 2 * turns / (np.pi * np.maximum(asked.number, 1)))
    size = np.abs(asked.amplitude)
    kept = plays * jumps * others_peak(np.where(asked.number == 0, 0, asked.amplitude))
    unseen = f_Hz / (UNSEEN_AT * min(f for _, f, _ in plant.modes))
    doubt = asked.variance + (kept / 2) ** 2 + (plays**2 + unseen**2) * size**2 / 4
    told = (asked.number > 0) & (size > kept)
    evidence = [
        _log_evidence(plant_response(plant.with_modes_at(factor), f_Hz[told]), asked, moved, doubt, told)
        for factor in TRIED
    ]
    log_share = np.array(evidence) - 0.5 * (np.log(TRIED) / (MODE_SHIFT / 2)) ** 2
    share = np.exp(log_share - log_share.max())
    share /= share.sum()
    mean = float(share @ TRIED)
    there, before = (plant_response(plant.with_modes_at(factor), f_Hz[told]) for factor in (mean, 1.0))
    astray = float(np.abs(1 - there / before).max(initial=0.0))
    return Moved(mean, float(np.sqrt(share @ (TRIED - mean) ** 2)), astray)


def _log_evidence(dynamics: Amplitudes, asked: Lines, moved: Lines, doubt: Samples, told: NDArray[np.bool_]) -> float:
    """Of one place of the modes, over all gains: Gaussian. ``doubt`` (m,): variance of what is asked."""
    by, seen = dynamics * asked.amplitude[told], moved.amplitude[told]
    variance = moved.variance[told] + np.abs(dynamics) ** 2 * doubt[told]
    prior = (GAIN_ERROR / 2) ** -2
    precision = prior + 2 * np.sum(np.abs(by) ** 2 / variance)
    along = prior + 2 * np.sum((by.conj() * seen).real / variance)
    squares = prior + 2 * np.sum(np.abs(seen) ** 2 / variance)
    return float(-np.sum(np.log(variance)) - 0.5 * (squares - along**2 / precision) - 0.5 * np.log(precision))


def with_modes_at(model: AxisModel, factor: float) -> AxisModel:
    """The same model with every mode at ``factor`` times its frequency."""
    return model.model_copy(update={"effects": tuple(_moved(one, factor) for one in model.effects)})


def stage_with_modes_at(stage: Stage, factors: Mapping[str, float]) -> Stage:
    """The same stage with the modes of each axis at so many times their frequency; itself where nothing moves."""
    moved = {axis: with_modes_at(stage.axis(axis), factor) for axis, factor in factors.items() if factor != 1}
    return stage.model_copy(update={"axes": {**stage.axes, **moved}}) if moved else stage


def _moved(effect: AdoptedEffect, factor: float) -> AdoptedEffect:
    if effect.name != "resonance":
        return effect
    f_Hz = effect.params["f_Hz"]
    there = tuple(factor * one for one in f_Hz) if isinstance(f_Hz, Sequence) else factor * float(f_Hz)
    ci95 = {name: interval for name, interval in effect.ci95.items() if name != "f_Hz"}
    return effect.model_copy(update={"params": effect.params | {"f_Hz": there}, "ci95": ci95})
