"""The linear plant behind a measured response: static gain, modes, a lag and dead time, at the device's tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.control.feedback_loop import plant_response
from phaselead.errors import BadInput
from phaselead.model import BACKWARDS, HOLD_S, SmallSignal
from phaselead.record import Samples

Response = NDArray[np.complex128]

MOST_MODES = 6
LEAST_DEVIATION = 0.02
"""Of a line, as a share: local slopes of the hysteresis differ by more from place to place."""
SLOWEST_MODE_Hz = 30.0
"""Slower motion is hysteresis and creep. Flexure stages that move 100 um and more have their first mode between 100 and
1000 Hz, levered ones some tens of hertz lower (Devasia, Eleftheriou and Moheimani 2007)."""
LONGEST_DEAD_s, LONGEST_LAG_s = 0.01, 0.005
DAMPING = (0.001, 0.7)
"""Of modes of flexure stages: 0.005 to 0.05 is usual (Devasia, Eleftheriou and Moheimani 2007)."""
RINGS, LEAST_PEAK = 0.3, 0.1
"""A fitted mode is one of the mechanics where its damping is below the one, and its peak above the other, of the static
gain. Hysteresis and creep leave what is damped more or hardly shows; a loop stands a tenth of its gain anyway."""
SHARES = (-0.3, 1.3)
"""Of the motion: a mode beyond the first that carried more would be the first."""
FAR = 2**0.5
"""As a ratio of frequencies: a load that doubles the moving mass takes a mode so far down."""
RESONANCE = 2.0
"""Times the response at rest: a mode of zeta 0.25."""
LARGEST_MISFIT = 0.25
"""Median over the lines: the loop of a peak sensitivity of 2 stands a plant off by half (Skogestad and Postlethwaite
2005, Multivariable Feedback Control, section 7.4)."""


@dataclass(frozen=True)
class FittedPlant:
    """The plant, its gain in um/V, and how far it leaves the measured lines (m,), as shares."""

    plant: SmallSignal
    gain_um_per_V: float
    misfit: Samples


def rings_elsewhere(f_Hz: Samples, measured: Response, plant: SmallSignal) -> str | None:
    """In words where the lines (m,) have a resonance that is at none of the modes of ``plant``, of a stage file."""
    _, at_Hz, _ = _first_mode(f_Hz, measured)
    size, modes_Hz = np.abs(measured), sorted(f for _, f, _ in plant.modes)
    resonates = size[f_Hz == at_Hz].max() > RESONANCE * np.median(size[: max(3, len(f_Hz) // 20)])
    if not resonates or not modes_Hz or any(1 / FAR < at_Hz / mode_Hz < FAR for mode_Hz in modes_Hz):
        return None
    known = " and ".join(f"{mode_Hz:.4g}" for mode_Hz in modes_Hz)
    return (
        f"the stage rings at {at_Hz:.3g} Hz, and its stage file has modes at {known} Hz: is it the file of this stage?"
    )


def fit_plant(f_Hz: Samples, measured: Response, deviation: Samples) -> FittedPlant:
    """As many modes as the lines (m,) ask for by the Bayesian information criterion (Schwarz 1978).

    Raises BadInput for a response that falls with the voltage, or that no such plant has.
    """
    if np.median(measured[: max(3, len(f_Hz) // 20)].real) <= 0:
        raise BadInput(BACKWARDS)
    weight = 1 / np.hypot(deviation, LEAST_DEVIATION)
    from_the_lines = [_first_mode(f_Hz, measured)]
    best, starts = None, [from_the_lines]
    while len(starts[0]) <= MOST_MODES:
        found = min((_descend(f_Hz, measured, weight, modes) for modes in starts), key=lambda one: one.cost)
        if best is not None and not _better(found, best):
            break
        best = found
        # While a mode is missing the others may have moved to where no further one mends it. So the next mode is also
        # tried behind modes as the lines suggest them, which no descent has moved.
        unmoved = _misfit(f_Hz, measured, _start(f_Hz, measured, from_the_lines))
        starts = [[*found.modes, mode] for mode in _next_modes(f_Hz, found.misfit)]
        suggested = [[*from_the_lines, mode] for mode in _next_modes(f_Hz, unmoved)]
        starts += suggested
        from_the_lines = suggested[-1]
    assert best is not None
    fitted = best.fitted()
    if np.median(np.abs(fitted.misfit)) > LARGEST_MISFIT:
        raise BadInput(
            f"the measured response is not that of modes behind a dead time (half of it is off by more than "
            f"{100 * np.median(np.abs(fitted.misfit)):.0f} %); raise the level, or look at the figure of the response"
        )
    return fitted


ModeOf = tuple[float, float, float]


@dataclass(frozen=True)
class _Descended:
    values: Samples
    misfit: Response
    cost: float

    @property
    def modes(self) -> list[ModeOf]:
        return _modes(self.values)

    def fitted(self) -> FittedPlant:
        gain, plant = _plant_of(self.values)
        return FittedPlant(plant, gain, np.asarray(np.abs(self.misfit)))


def _better(found: _Descended, before: _Descended) -> bool:
    lines = 2 * len(found.misfit)
    return bool(lines * np.log(found.cost / before.cost) + 3 * np.log(lines) < 0)


def rings(mode: ModeOf) -> bool:
    """Whether it is a mode of the mechanics."""
    share, _, zeta = mode
    return zeta < RINGS and abs(share) / (2 * zeta) > LEAST_PEAK


def _first_mode(f_Hz: Samples, measured: Response) -> ModeOf:
    return 1.0, float(f_Hz[np.argmax(np.abs(measured) * (f_Hz > SLOWEST_MODE_Hz))]), 0.02


def _next_modes(f_Hz: Samples, misfit: Response) -> list[ModeOf]:
    """Where the plant is furthest off, and where it is most below what was measured: in its own share a mode that is
    missing is off by no more than 1, less than any place where a small response is not met."""
    lacking = -np.log(np.abs(1 + misfit))
    smooth = [np.convolve(part, np.ones(3) / 3, mode="same") for part in (np.abs(misfit), lacking)]
    return [(0.01, float(f_Hz[np.argmax(part)]), 0.01) for part in smooth]


def _modes(values: Samples) -> list[ModeOf]:
    return [(float(c), float(np.exp(f)), float(np.exp(z))) for c, f, z in values[3:].reshape(-1, 3)]


def _plant_of(values: Samples) -> tuple[float, SmallSignal]:
    gain = float(np.exp(values[0]))
    lags = (float(values[2]),) if values[2] > 0 else ()
    return gain, SmallSignal((gain, gain), tuple(_modes(values)), lags, HOLD_S + float(values[1]))


def _descend(f_Hz: Samples, measured: Response, weight: Samples, modes: Sequence[ModeOf]) -> _Descended:
    from scipy.optimize import least_squares  # slow to load, needed here only

    def residual(values: Samples) -> Samples:
        left = _misfit(f_Hz, measured, values) * weight
        return np.concatenate([left.real, left.imag])

    start = _start(f_Hz, measured, modes)
    low, high = [start[0] - 3, 0.0, 0.0], [start[0] + 3, LONGEST_DEAD_s, LONGEST_LAG_s]
    low += [SHARES[0], np.log(SLOWEST_MODE_Hz), np.log(DAMPING[0])] * len(modes)
    high += [SHARES[1], np.log(f_Hz[-1]), np.log(DAMPING[1])] * len(modes)
    found = least_squares(
        residual, np.clip(start, low, high), bounds=(low, high), x_scale="jac", loss="soft_l1", max_nfev=200
    )
    return _Descended(np.asarray(found.x), _misfit(f_Hz, measured, found.x), float(found.cost))


def _start(f_Hz: Samples, measured: Response, modes: Sequence[ModeOf]) -> Samples:
    """Gain, dead time, lag and these modes, inside their bounds, as values to descend from."""
    gain = float(np.median(np.abs(measured[: max(3, len(f_Hz) // 20)])))
    start = [np.log(gain), 1e-5, 5e-5]
    for c, f, zeta in modes:
        inside = float(np.clip(f, 1.01 * SLOWEST_MODE_Hz, 0.99 * f_Hz[-1]))
        start += [c, np.log(inside), np.log(np.clip(zeta, 1.01 * DAMPING[0], 0.99 * DAMPING[1]))]
    return np.array(start)


def _misfit(f_Hz: Samples, measured: Response, values: Samples) -> Response:
    """By how much the plant of these values is off (m,), as shares."""
    gain, plant = _plant_of(values)
    return np.asarray(gain * plant_response(plant, f_Hz) / measured - 1)
