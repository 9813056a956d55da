"""Loop shaping: the PID and filters with the widest bandwidth whose peak sensitivity stays allowed.

The peak sensitivity is bounded at every local gain and every position of the modes at once, so what is found has its
margin over the whole range (Astrom, Panagopoulos and Hagglund 1998, Automatica 34, 585, for one plant). Among loops
that keep most of the widest bandwidth the one is taken that is soonest over a push on the stage as it was measured, and
with a tenth more and less of its gain. A push meets a held axis, and what that does is small motion, as the measurement
is; the margin is for all the rest.
Both searches are differential evolution (Storn and Price 1997; "current to best", Das and Suganthan 2011, IEEE
Transactions on Evolutionary Computation 15, 4) from a fixed seed, with a simplex after it: the same plant gives the
same gains.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.control.feedback_loop import BANDWIDTH, frequencies, peak_sensitivity, pid_response, plant_response
from phaselead.control.tuning.plant import rings
from phaselead.errors import BadInput
from phaselead.model import TICK_S, Gains, LoopFilter, SmallSignal, roots_z
from phaselead.record import Samples

Response = NDArray[np.complex128]

FILTERS = 2
GAINS = 3
"""Local gains that a design is for: lowest, middle (geometric), highest."""
BELOW = 0.99
"""Of the allowed peak: what rounding the gains to four digits may take."""
KEEPS = 0.82
"""Of the widest bandwidth; see LACKING. The last tenths are dear: with 0.9 the built-in stage is over a push in 12 to
14 ms, with this in 9 to 11."""
CALM_POWER = 3
"""A push y counts by (t^3 y)^2: t^3 exp(-t/tau) is largest at 3 tau, where an exponential is down to 5 %. Its integral
grows as the seventh power of tau."""
GAIN_SHARE = 0.1
"""Of the measured gain, up and down: small motion has another at another place. A loop stands it, and is calm there."""
CALM_TICKS = 1000
"""After a push: 0.2 s, in which a loop of 15 Hz is over it."""
HELD_IN_LOOP = 15.9
"""Of a section's b (firmware/core/loop_filter.h)."""
LOWEST_Hz = 0.5
FASTEST_Hz = 2000.0
POINTS_A_DECADE = 60
SEEDS = (1, 2)
"""Of the evolution, which alone ends in a lesser valley now and then."""
POPULATION, GENERATIONS, RECOMBINED, SIMPLEX, SIMPLEXES = 8, 300, 0.9, 1500, 6
LACKING = 20.0
"""Of a bandwidth below what is kept: 1 % of it must make a push 3 % shorter, with an integral of its 7th power."""
UNSTABLE, OVER_PEAK = 1e3, 1e2
"""Costs, far above those of a loop that has its margin."""


@dataclass(frozen=True)
class Range:
    """What a loop must stand: local gains in um/V, modes at 1 -+ ``mode_shift`` of their frequencies."""

    gain_um_per_V: tuple[float, float]
    mode_shift: float
    peak: float
    most_rate_V_per_um: float = math.inf
    """What white noise of the position may change the output by from tick to tick, rms in V for 1 um rms: an output at
    its slew limit no longer does what the loop asks for, and the margin is gone."""
    most_V_per_um: float = math.inf
    """What it may put into the output, rms in V for 1 um rms: in motion the stage's hysteresis follows its peaks, which
    the modes then no longer keep from the position."""

    def gains(self) -> Samples:
        return np.geomspace(*self.gain_um_per_V, GAINS)

    def plants(self, plant: SmallSignal) -> list[SmallSignal]:
        """With the modes at each of their positions."""
        return [plant.with_modes_at(factor) for factor in (1 - self.mode_shift, 1.0, 1 + self.mode_shift)]


@dataclass(frozen=True)
class Predicted:
    """Of a loop over a range: largest |S|, and the -3 dB bandwidth where it is narrowest and widest."""

    peak_sensitivity: float
    bandwidth_Hz: tuple[float, float]


def predicted(plant: SmallSignal, gains: Gains, over: Range) -> Predicted:
    """Of any gains, on the plant over the range."""
    peak, bandwidths = 0.0, []
    for moved in over.plants(plant):
        f_Hz = frequencies(moved)
        rows = over.gains()[:, None] * plant_response(moved, f_Hz) * pid_response(gains, f_Hz)
        peak = max(peak, peak_sensitivity(rows))
        bandwidths += list(bandwidth_Hz(f_Hz, rows / (1 + rows)))
    return Predicted(peak, (float(min(bandwidths)), float(max(bandwidths))))


def bandwidth_Hz(f_Hz: Samples, complementary: Response) -> Samples:
    """Where |T| (k, m) first falls below -3 dB, (k,), between lines as a straight line goes."""
    size = np.abs(complementary)
    below = size < BANDWIDTH
    first = np.maximum(np.where(below.any(axis=1), np.argmax(below, axis=1), len(f_Hz) - 1), 1)
    rows = np.arange(len(size))
    before, after = size[rows, first - 1], size[rows, first]
    share = np.clip((before - BANDWIDTH) / np.maximum(before - after, 1e-9), 0.0, 1.0)
    return np.asarray(f_Hz[first - 1] + share * (f_Hz[first] - f_Hz[first - 1]))


def shape(plant: SmallSignal, over: Range, on_progress: Callable[[float], None] | None = None) -> Gains:
    """The gains and filters for a plant over a range. Raises BadInput where none has its margin."""
    search = _Search(plant, over, on_progress)
    widest = search.best(search.narrowness)
    if widest.cost >= OVER_PEAK:
        low, high = over.gain_um_per_V
        raise BadInput(
            f"no PID with {FILTERS} filters keeps a peak sensitivity of {over.peak:g} with local gains of {low:.3g} to "
            f"{high:.3g} um/V and modes {100 * over.mode_shift:g} % up and down; allow a higher peak (--peak) or less"
        )
    least_Hz = KEEPS * math.exp(-widest.cost)
    return search.gains_of(search.best(lambda values: search.unrest(values, least_Hz), widest.values).values)


@dataclass(frozen=True)
class _Found:
    values: Samples
    cost: float


class _Controller:
    """PID and filters of a search's values: ``numerator`` (2 FILTERS + 3,) over ``denominator`` (2 FILTERS + 2,), the
    coefficients of powers of s = 1 - 1/z, the lowest first. At low frequencies powers of 1/z would be small differences
    of large numbers."""

    def __init__(self, values: Samples) -> None:
        ki, kp, kd = np.exp(values[:3])
        filters = [(roots_z(*row[:2]), roots_z(*row[2:])) for row in np.exp(values[3:]).reshape(-1, 4).tolist()]
        self.numerator, self.denominator = np.array([ki * TICK_S, kp, kd / TICK_S]), np.array([0.0, 1.0])
        for zeros, poles in filters:
            self.numerator = np.convolve(self.numerator, _with_roots(zeros))
            self.denominator = np.convolve(self.denominator, _with_roots(poles))
        self.largest_b = max(_largest_b(zeros, poles) for zeros, poles in filters)


class _Grid:
    """Frequencies (m,), and what controllers are there."""

    def __init__(self, f_Hz: Samples) -> None:
        self.f_Hz = f_Hz
        self.back = np.exp(-2j * np.pi * f_Hz * TICK_S)
        powers = (1 - self.back) ** np.arange(3 + 2 * FILTERS)[:, None]
        self._powers = powers.view(np.float64)  # (k, 2m): coefficients are real

    def response(self, controller: _Controller) -> Response:
        """(m,), in V/um."""
        coefficients = np.zeros((2, len(self._powers)))
        coefficients[0, : len(controller.numerator)] = controller.numerator
        coefficients[1, : len(controller.denominator)] = controller.denominator
        # not @: the last bits of BLAS depend on the processor, and what a search ends at on these
        above, below = np.einsum("ck,km->cm", coefficients, self._powers).view(np.complex128)
        return np.asarray(above / below)


def _grid_Hz(plant: SmallSignal) -> Samples:
    """Even by decades, and finer about the modes."""
    near = frequencies(plant)
    decades = np.log10(near[-1] / LOWEST_Hz)
    coarse = np.geomspace(LOWEST_Hz, near[-1], int(POINTS_A_DECADE * decades))
    fine = [near[(near > 0.8 * f) & (near < 1.2 * f)] for _, f, _ in plant.modes]
    return np.unique(np.concatenate([coarse, *fine]))


class _Held:
    """The stage as it was measured, in small motion: what a push on it comes to, and what noise does to the output."""

    def __init__(self, plant: SmallSignal) -> None:
        f_Hz = np.arange(1, CALM_TICKS // 2 + 1) / (CALM_TICKS * TICK_S)
        middle = math.sqrt(math.prod(plant.gain_um_per_V))
        self._grid, self._shape = _Grid(f_Hz), plant_response(plant, f_Hz)
        # the measured gain first: noise is counted at that
        self._plants = middle * np.array([[1.0], [1 - GAIN_SHARE], [1 + GAIN_SHARE]]) * self._shape
        self._weight = (np.arange(CALM_TICKS) * TICK_S) ** (2 * CALM_POWER)

    def noise_V_per_um(self, controller: _Controller) -> tuple[float, float]:
        """What white noise of the position puts into the output, and by what it changes that from tick to tick; rms."""
        response = self._grid.response(controller)
        output = response / (1 + self._plants[0] * response)
        size, rate = (float(np.sqrt((np.abs(one) ** 2).mean())) for one in (output, output * (1 - self._grid.back)))
        return size, rate

    def unrest(self, controller: _Controller) -> float:
        """log of the weighted integral of the position's square after a step of force, which would move it by 1, at the
        gain where it is largest."""
        loops = self._plants * self._grid.response(controller)
        pushes = np.insert(self._shape / (1 + loops), 0, 0.0, axis=1)
        ways = np.cumsum(np.fft.irfft(pushes, CALM_TICKS), axis=1)
        ways -= ways[:, -CALM_TICKS // 20 :].mean(axis=1, keepdims=True)  # the loop takes all of the push back
        return math.log(float((self._weight * ways**2).sum(axis=1).max()))


class _Search:
    """Costs of loops by the logarithms of Ki, Kp, Kd and, of each filter, f and zeta of zeros and poles."""

    def __init__(self, plant: SmallSignal, over: Range, on_progress: Callable[[float], None] | None) -> None:
        self._over, self._on_progress, self._evaluated = over, on_progress, 0
        plants = over.plants(plant)
        each_Hz = [_grid_Hz(moved) for moved in plants]
        shapes = [plant_response(moved, f_Hz) for moved, f_Hz in zip(plants, each_Hz, strict=True)]
        self._grid = _Grid(np.concatenate(each_Hz))  # of all positions of the modes, one after the other
        self._plants = over.gains()[:, None] * np.concatenate(shapes)
        self._begins = np.cumsum([0, *map(len, each_Hz[:-1])])  # by position
        self._held = _Held(plant)
        ringing = sorted(mode[1] for mode in plant.modes if rings(mode))
        self._modes_Hz = ringing or sorted(f for _, f, _ in plant.modes)
        middle, w = over.gains()[1], 2 * np.pi * self._modes_Hz[0]
        pid = [(0.005 * w, 3 * w), (1e-4, 10.0), (1e-3 / w, 10 / w)]
        fastest_Hz = min(10 * self._modes_Hz[0], FASTEST_Hz)
        zeros, poles = (0.3 * self._modes_Hz[0], fastest_Hz), (0.5 * self._modes_Hz[0], fastest_Hz)
        self._pid = np.log(np.array(pid) / middle)
        self._filter = np.log(np.array([zeros, (0.02, 2.0), poles, (0.3, 1.5)]))

    def best(self, cost: Callable[[Samples], float], start: Samples | None = None) -> _Found:
        """From what evolution finds (twice, without a ``start``), from a notch at the first mode beside another filter,
        and from ``start``."""
        starts = [self._evolve(cost, seed) for seed in (SEEDS if start is None else SEEDS[:1])]
        starts += [
            np.concatenate([self._notched(), self._neutral(f)]) for f in (*self._modes_Hz[1:3], self._modes_Hz[0])
        ]
        starts += [start] if start is not None else []
        return min((self._descend(cost, values) for values in starts), key=lambda found: found.cost)

    def _notched(self) -> Samples:
        """An integrator behind a notch at the first mode."""
        first_Hz = self._modes_Hz[0]
        slow = [self._pid[0].mean() - 1, *self._pid[1:, 0]]
        return np.concatenate([slow, np.log([first_Hz, 0.1, first_Hz, 1.0])])

    def _neutral(self, f_Hz: float) -> Samples:
        """A filter that does nothing yet."""
        inside = min(f_Hz, 0.9 * float(np.exp(self._filter[2, 1])))
        return np.log([inside, 0.7, inside, 0.7])

    @property
    def _room(self) -> Samples:
        return np.vstack([self._pid, *[self._filter] * FILTERS])

    def _evolve(self, cost: Callable[[Samples], float], seed: int) -> Samples:
        from scipy.optimize import differential_evolution  # slow to load, needed here only

        found = differential_evolution(
            self._counted(cost),
            self._room,
            strategy="currenttobest1bin",
            recombination=RECOMBINED,
            seed=seed,
            popsize=POPULATION,
            maxiter=GENERATIONS,
            tol=1e-4,
            polish=False,
        )
        return np.asarray(found.x)

    def _descend(self, cost: Callable[[Samples], float], start: Samples) -> _Found:
        """A simplex, begun again for as long as that brings 1 %."""
        from scipy.optimize import minimize

        within = self._room.T
        counted = self._counted(cost)
        found = _Found(np.clip(start, *within), cost(np.clip(start, *within)))
        for _ in range(SIMPLEXES):
            done = minimize(
                lambda values: counted(np.clip(values, *within)),
                found.values,
                method="Nelder-Mead",
                options={"maxfev": SIMPLEX, "adaptive": True, "xatol": 1e-4, "fatol": 1e-5},
            )
            better = _Found(np.clip(done.x, *within), float(done.fun))
            ended, found = better.cost > found.cost - 0.01, better
            if ended:
                break
        return found

    def _counted(self, cost: Callable[[Samples], float]) -> Callable[[Samples], float]:
        expected = 3 * POPULATION * len(self._room) * (GENERATIONS + 1) + 13 * SIMPLEX

        def counted(values: Samples) -> float:
            self._evaluated += 1
            if self._on_progress is not None and self._evaluated % 100 == 0:
                self._on_progress(min(self._evaluated / expected, 1.0))
            return cost(values)

        return counted

    def narrowness(self, values: Samples) -> float:
        """-log of the narrowest bandwidth."""
        sensitivity = self._sensitivity(_Controller(values))
        return sensitivity if isinstance(sensitivity, float) else -math.log(self._narrowest_Hz(sensitivity))

    def unrest(self, values: Samples, least_Hz: float) -> float:
        """After a push; a bandwidth below ``least_Hz`` is worth it only for much more calm."""
        controller = _Controller(values)
        sensitivity = self._sensitivity(controller)
        if isinstance(sensitivity, float):
            return sensitivity
        lacking = max(math.log(least_Hz / self._narrowest_Hz(sensitivity)), 0.0)
        return self._held.unrest(controller) + LACKING * lacking

    def _narrowest_Hz(self, sensitivity: Response) -> float:
        each = (np.split(one, self._begins[1:], axis=-1) for one in (self._grid.f_Hz, 1 - sensitivity))
        return float(min(bandwidth_Hz(f_Hz, complementary).min() for f_Hz, complementary in zip(*each, strict=True)))

    def _sensitivity(self, controller: _Controller) -> Response | float:
        """S (gains, m) over all positions of the modes, or the cost of a loop that has not its margin."""
        amplified = controller.largest_b / HELD_IN_LOOP
        if amplified > 1:
            return UNSTABLE + 1000 * min(amplified, 50)
        distance = 1 + self._plants * self._grid.response(controller)
        turns = distance.copy()
        turns[:, 1:] *= distance[:, :-1].conj()
        turns[:, self._begins] = distance[:, self._begins]
        turned = np.add.reduceat(np.angle(turns), self._begins, axis=1)
        unstable = int((np.abs(turned) >= np.pi / 2).sum())
        if unstable:
            return UNSTABLE + 100 * unstable
        beyond = 1 / float(np.abs(distance).min()) - BELOW * self._over.peak
        if beyond <= 0:
            size, rate = self._held.noise_V_per_um(controller)
            beyond = max(size / self._over.most_V_per_um, rate / self._over.most_rate_V_per_um) - 1
        return OVER_PEAK + 10 * min(beyond, 50.0) if beyond > 0 else np.asarray(1 / distance)

    def gains_of(self, values: Samples) -> Gains:
        """In four digits, as a stage file shows them."""
        ki, kp, kd = (_rounded(value) for value in np.exp(values[:3]))
        low, high = self._over.gain_um_per_V
        origin = (
            f"tuned on the measured response for peak sensitivity {self._over.peak:.1f} (local gains of {low:.3g} to "
            f"{high:.3g} um/V, modes +-{100 * self._over.mode_shift:g} %)"
        )
        return Gains(
            kp_V_per_um=kp,
            ki_V_per_um_s=ki,
            kd_V_s_per_um=kd,
            origin=origin,
            filters=tuple(_filter(row) for row in np.exp(values[3:]).reshape(-1, 4)),
        )


Roots = tuple[complex, complex]
"""In z, real or one the conjugate of the other."""


def _with_roots(roots: Roots) -> list[float]:
    """Powers of s = 1 - 1/z (3,) of the polynomial that is 1 at s = 0."""
    one, other = roots
    return [1.0, (one / (1 - one) + other / (1 - other)).real, (one * other / ((1 - one) * (1 - other))).real]


def _largest_b(zeros: Roots, poles: Roots) -> float:
    """Of the coefficients of a section: the device holds less than 16."""
    b0 = abs((1 - poles[0]) * (1 - poles[1])) / abs((1 - zeros[0]) * (1 - zeros[1]))
    return float(b0 * max(1.0, abs(zeros[0] + zeros[1])))


def _filter(row: Samples) -> LoopFilter:
    zeros_Hz, zeros_zeta, poles_Hz, poles_zeta = map(_rounded, row)
    return LoopFilter(zeros_Hz=zeros_Hz, zeros_zeta=zeros_zeta, poles_Hz=poles_Hz, poles_zeta=poles_zeta)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
