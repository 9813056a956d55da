"""The best operator of a given basis: slopes of plays and segments, delay, memory at rest, and the modes behind it.

At a given delay, rest fraction and given modes the model is linear with no negative coefficient and is solved for; the
others are searched (``phaselead.identify.gauss_newton``), all together: an operator fitted without the modes would take
up part of the ringing, and modes fitted behind such an operator would be what it left of theirs. Everything is done on
weighted sums over rows, the moments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import nnls

from phaselead.errors import BadInput
from phaselead.identify.gauss_newton import descend, least_in_box, ridged
from phaselead.identify.operator.regressors import Basis, FitRun, Turns, design_matrix, time_view, without_idle_plays
from phaselead.model import Mode, TimeView, behind_modes, resonant
from phaselead.record import Samples

SLOPES_RIDGE = 1e-8
"""Of the mean diagonal: keeps neighbouring plays that the data cannot tell apart from dividing by zero."""
REVERSIBLE = 0.2
"""Least share of the mean slope that is without memory: a piezo at a turning point does not stand still, and without
the bound a lag that no delay explains would make it."""
GUESS_STRIDE = 4
"""The first guess looks at every so-manieth row."""
GUESSED_DELAYS, GUESSED_RESTS = (0.0, 0.1, 0.3, 0.6), (-0.4, 0.0, 0.4, 0.8)
"""Grid of the first guess: shares of the longest delay, and rest fractions."""
MOST_OPERATOR_STEPS, STEP_SHARES, LEAST_ERROR_GAIN = 10, (1.0, 0.5, 0.2, 0.05), 1e-5
"""Steps of the search, shares of a step that are tried until one gains, and the least relative gain of the error."""
DELAY_STEP = 0.3
"""Of a row, for the slope of the error over the delay: voltages run straight between rows, and the error has a kink at
every row that a smaller step takes for a minimum."""
REST_STEP = 0.02
"""Of the rest fraction, for the slope of the error over it: towards 0, away from its bounds."""
DAMPING = 0.01
"""Of the squared error: what a step across the whole range must gain. Settled rows do not know the memory at rest."""
UNFELT = 1e-12
"""Of the squared error: a move that changes the answer by less is rounding."""
EXACT = 1e-9
"""Of the range: an error below this is rounding, and leaves nothing to search for."""
PART_PAYS = 0.9
"""A mode, a memory that fades, or a bend of the field, stays in when it leaves less than this share of the squared
residual without it."""
CHANCE_GAIN = 2.71
"""Twice the log likelihood that one parameter gains by chance in one of twenty cases where it cannot be negative: in
half of them it gains nothing (Chernoff 1954)."""
SHARE_RANGE, ZETA_RANGE = (-2.0, 2.0), (0.002, 0.5)
"""Ranges of the share of the motion and of the damping of a mode, as in the catalogue of effects."""
MOST_MOVED = 1.65
"""Factor in frequency between where the records showed a mode and where it is fitted: about what ten steps of one
search may go. Chosen, with stages in sight whose creep drew a mode down by a factor of three and more."""
MODE_REACH = (0.3, 0.05, 0.7)
"""Largest change of a mode in one step: of its share, and of the logarithms of its frequency and its damping."""
FIRST_OF_RATE = 0.9
"""Of the sampling rate: the highest frequency of a mode. One beyond half of the rate is not seen to ring, but it raises
the response below it, by (f/f_Hz)^2."""
TIGHT = 1e-12
"""Width of the box where a parameter may not move."""
MODE_STEP = 1e-5
"""Relative, for the slope over a frequency or a damping."""
DRIFT = 0.01
"""Of the range: by so much creep and drift move a record among others of its session."""
LEAST_OFFSET_WEIGHT = (0.001 / DRIFT) ** 2
"""Of offsets of one session: what drift makes of them beside the thousandth of the range that an operator leaves."""
LAG_SLOPE_STEP = 0.01
"""Relative, for the slope over a time constant."""


@dataclass(frozen=True)
class Solution:
    """An operator: slopes [segments, plays, fading plays] (s + m + k,) in um/V of ``basis`` at one delay and rest
    fraction.

    ``at_rest_um`` is the position at rest at 0 V, ``error`` the relative rms error over the records.
    """

    basis: Basis
    delay_s: float
    rest_fraction: float
    slopes: Samples
    at_rest_um: float
    error: float
    modes: tuple[Mode, ...] = ()

    def residual(self, fit: FitRun) -> Samples:
        """Measured minus model (rows,) in um."""
        columns = design_matrix(fit, self.basis, self.delay_s, self.rest_fraction, self.modes)
        return np.asarray(fit.position() - self.at_rest_um - columns @ self.slopes)

    def residuals_of(self, fit: FitRun) -> Callable[[Turns], Samples]:
        """Measured minus model (rows,) in um of a record, for where it may have turned round before it.

        Another start moves the plays slowly, with the voltage: the modes have little part in the difference, and it is
        worked out without them, in a third of the time.
        """
        stood = replace(fit, turned_V=())
        stood_um, left_um = self._still_um(stood), self.residual(stood)
        return lambda turned_V: left_um - (self._still_um(replace(fit, turned_V=turned_V)) - stood_um)

    def _still_um(self, fit: FitRun) -> Samples:
        """(rows,): how far the operator goes without its modes, from rest."""
        return np.asarray(design_matrix(fit, self.basis, self.delay_s, self.rest_fraction) @ self.slopes)

    def fading(self) -> tuple[Samples, Samples]:
        """Thresholds in V and weights in um/V, each (m,), of the fading plays that have weight."""
        weight = self.slopes[len(self.slopes) - len(self.basis.fading_r_V) :]
        kept = weight > 0
        return self.basis.fading_r_V[kept], weight[kept]

    def time_view(self, rate_Hz: float, residuals_um: list[Samples]) -> TimeView:
        """As a stage file keeps it, with the sampling rate of the records and what it leaves of each (rows,)."""
        view = time_view(self.basis, self.slopes, self.at_rest_um, self.delay_s, self.rest_fraction, rate_Hz)
        rms = float(np.sqrt(np.mean(np.concatenate(residuals_um) ** 2)))
        return TimeView(**{**view.model_dump(), "residual_um_rms": rms})


def group_numbers(fits: list[FitRun]) -> list[int]:
    """The groups that have rows, ascending."""
    return sorted({group for f in fits for group, _ in f.stretches})


def moments(
    fits: list[FitRun], basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = ()
) -> Samples:
    """Weighted moments (group, k, k) of the columns [segments, plays, fading plays, 1, position], k =
    basis.size + 2."""
    in_C = basis.in_C(rest_fraction)
    room = np.empty((max(len(f.rows) for f in fits), basis.size + 2))

    def columns() -> Iterator[Samples]:
        for f in fits:
            f.fill(room, delay_s, basis, rest_fraction, in_C, modes)
            yield room

    return moments_of(fits, columns(), basis.size + 2)


def moments_of(fits: list[FitRun], columns: Iterable[Samples], size: int) -> Samples:
    """Weighted moments (group, size, size) of the ``columns`` (rows, size) of each record."""
    present = group_numbers(fits)
    found = np.zeros((len(present), size, size))
    at = dict(zip(present, found, strict=True))
    for f, of_record in zip(fits, columns, strict=True):
        for group, part in f.stretches:
            piece = of_record[part]
            at[group] += f.weight * (piece.T @ piece)
    return found


def centred(moments: Samples) -> Samples:
    """Moments (..., k, k) about the mean of every column, matrix by matrix: each then has an offset of its own."""
    ones = moments[..., :, -2]
    return np.asarray(moments - ones[..., :, None] * ones[..., None, :] / moments[..., -2, -2, None, None])


def of_records(fits: list[FitRun], of_groups: Samples) -> Samples:
    """Moments (record, k, k) of whole records from those of their groups (group, k, k), which rise from record to
    record; every record has rows."""
    first = np.cumsum([0, *(len(f.stretches) for f in fits[:-1])])
    return np.asarray(np.add.reduceat(of_groups, first, axis=0))


def together(moments: Samples, offset_weight: float) -> Samples:
    """Moments (k, k) of all records from those of each (record, k, k), where what their offsets differ by counts so
    much beside the rest: 0 is an offset of its own for each, 1 one for all."""
    own = centred(moments).sum(axis=0)
    return np.asarray(own + offset_weight * (centred(moments.sum(axis=0)) - own))


def weight_of_offsets(offsets: Sequence[float], shapes: Sequence[float]) -> float:
    """How much the offsets of records count that differ by these shares of their ranges, where the model leaves
    ``shapes`` of them about their means: in full where they are no larger than that, and else as the variance that they
    are seen to have makes it likeliest. Counted in full, what creeps would bend the loop."""
    seen, left = (float(np.mean(np.square(values))) for values in (offsets, shapes))
    return min(1.0, max(LEAST_OFFSET_WEIGHT, left / seen)) if seen > 0 else 1.0


def solve_slopes(
    moments: Samples, n_segments: int, offset_weight: float, noise: float = 0.0
) -> tuple[Samples, float, float]:
    """Slopes (k - 2,), position at rest and relative rms error from weighted moments (record, k, k).

    Bounded least squares; ``offset_weight`` as for ``together``. ``noise``: relative rms error of the
    position by which a prior of the weights of plays counts, whose deviation is the mean slope; 0 is without a prior.
    Raises BadInput for moments that determine nothing.
    """
    total = moments.sum(axis=0)
    ones = total[:, -2]
    total = together(moments, offset_weight)
    inner, right = total[:-2, :-2], total[:-2, -1]
    size = len(right)
    least = np.zeros(size)
    straight = float(inner[:n_segments, :n_segments].sum())
    mean_slope = max(float(right[:n_segments].sum()) / straight, 0.0) if straight > 0 else 0.0
    least[:n_segments] = REVERSIBLE * mean_slope
    if not np.isfinite(total).all():
        raise BadInput("the fit is singular: voltage or position hardly move; record a larger swing")
    held = ridged(inner, SLOPES_RIDGE)
    if noise > 0 and mean_slope > 0:
        held = held + (noise / mean_slope) ** 2 * np.diag(np.arange(size) >= n_segments)
    try:
        root = np.linalg.cholesky(held)
        above, _ = nnls(root.T, np.linalg.solve(root, right - inner @ least), maxiter=50 * size)
    except (np.linalg.LinAlgError, RuntimeError):
        raise BadInput("the fit is singular; record a larger swing, over several levels") from None
    slopes = above + least
    squares = float(total[-1, -1] - 2 * right @ slopes + slopes @ inner @ slopes)
    at_rest = float((ones[-1] - ones[:-2] @ slopes) / ones[-2])
    return slopes, at_rest, float(np.sqrt(max(squares, 0.0)))


def best_slopes(
    fits: list[FitRun],
    basis: Basis,
    delay_s: float,
    rest_fraction: float,
    offset_weight: float,
    modes: tuple[Mode, ...] = (),
) -> Solution:
    """The best operator of ``basis`` at a given delay and rest fraction, behind it the ``modes``.

    Raises BadInput as ``solve_slopes`` does.
    """
    each = of_records(fits, moments(fits, basis, delay_s, rest_fraction, modes))
    solved = solve_slopes(each, basis.n_segments, offset_weight)
    return Solution(basis, delay_s, rest_fraction, *solved, modes)


def best_operator(
    fits: list[FitRun],
    basis: Basis,
    longest_delay_s: float,
    offset_weight: float,
    start: tuple[float, float],
    modes: tuple[Mode, ...] = (),
    *,
    whole: bool = False,
) -> Solution:
    """The best operator of ``basis``, searched from ``start`` (delay in s, rest fraction) and, with it, the ``modes``.

    A start with a rest fraction of 0 knows nothing of the memory: a grid is tried first. ``whole``: a single mode
    carries all of the motion. Raises BadInput as ``solve_slopes`` does.
    """

    def at(delay_s: float, rest_fraction: float, modes: tuple[Mode, ...]) -> Solution:
        return best_slopes(fits, basis, delay_s, rest_fraction, offset_weight, modes)

    def trials(point: Solution) -> Iterator[Solution]:
        if point.error < EXACT:
            return
        move = _gauss_newton_step(fits, point, longest_delay_s, offset_weight, whole)
        for share in STEP_SHARES:
            delay_s = max(point.delay_s + share * move[0], 0.0)
            yield at(delay_s, point.rest_fraction + share * move[1], _moved(point.modes, share * move[2:]))

    first = at(*_first_guess(fits, basis, longest_delay_s, offset_weight, start, modes), modes)
    return descend(first, trials, lambda point: point.error, MOST_OPERATOR_STEPS, least_gain=LEAST_ERROR_GAIN)


def _first_guess(
    fits: list[FitRun],
    basis: Basis,
    longest_delay_s: float,
    offset_weight: float,
    start: tuple[float, float],
    modes: tuple[Mode, ...],
) -> tuple[float, float]:
    """The start or, where that knows nothing of the memory, the best of it and a grid on a part of the rows."""
    if start[1] != 0.0:
        return start
    few = [replace(f, rows=f.rows[::GUESS_STRIDE], groups=f.groups[::GUESS_STRIDE]) for f in fits]
    grid = [(longest_delay_s * share, rest) for share, rest in product(GUESSED_DELAYS, GUESSED_RESTS)]
    return min([start, *grid], key=lambda at: best_slopes(few, basis, at[0], at[1], offset_weight, modes).error)


def _moved(modes: tuple[Mode, ...], change: Samples) -> tuple[Mode, ...]:
    """``change`` (3m,): of the share and of the logarithms of frequency and damping of every mode."""
    return tuple(
        (c + float(dc), f_Hz * float(np.exp(df)), zeta * float(np.exp(dz)))
        for (c, f_Hz, zeta), (dc, df, dz) in zip(modes, change.reshape(-1, 3), strict=True)
    )


def strayed(modes: tuple[Mode, ...], began: tuple[Mode, ...]) -> int | None:
    """Which of the modes no longer is the one that the search of it began with (``began``, in the same order), but
    stands for creep or for how hysteresis changes with frequency: the one that moved furthest or, where all stayed,
    one that went to the highest damping beside others. None where there is none."""
    moved = [abs(float(np.log(mode[1] / first[1]))) for mode, first in zip(modes, began, strict=True)]
    if moved and max(moved) > np.log(MOST_MOVED):
        return int(np.argmax(moved))
    highest = ZETA_RANGE[1]
    went = [first[2] < highest <= mode[2] * (1 + MODE_STEP) for mode, first in zip(modes, began, strict=True)]
    return went.index(True) if len(modes) > 1 and True in went else None


def _reach(modes: tuple[Mode, ...], highest_Hz: float, whole: bool) -> tuple[Samples, Samples]:
    """Smallest and largest change (3m,) that one step may make."""
    low, high = [], []
    for c, f_Hz, zeta in modes:
        at = np.array([c, np.log(f_Hz), np.log(zeta)])
        shares = (c, c) if whole and len(modes) == 1 else SHARE_RANGE
        box = np.array([shares, (-np.inf, np.log(max(highest_Hz, f_Hz))), np.log(ZETA_RANGE)])
        low.append(np.clip(box[:, 0] - at, -np.array(MODE_REACH), 0.0))
        high.append(np.clip(box[:, 1] - at, 0.0, np.array(MODE_REACH)))
    return np.array(low).reshape(-1), np.array(high).reshape(-1)


def _gauss_newton_step(
    fits: list[FitRun], point: Solution, longest_delay_s: float, offset_weight: float, whole: bool
) -> Samples:
    """Change of delay, rest fraction and modes (2 + 3m,) for the least error of the linearised model, inside their
    bounds."""
    step_s = DELAY_STEP * min(f.run.step_s for f in fits)
    searched = 2 + 3 * len(point.modes)
    size = int(np.count_nonzero(point.slopes > 0)) + searched + 2
    each = of_records(fits, moments_of(fits, (linearised(f, point, step_s) for f in fits), size))
    total = together(each, offset_weight)
    n = size - searched - 2
    unit = np.ones(searched + 2)
    unit[0] = longest_delay_s
    total[n:] *= unit[:, None]
    total[:, n:] *= unit
    rest = total[n:, n:] - total[n:, :n] @ np.linalg.solve(ridged(total[:n, :n], SLOPES_RIDGE), total[:n, n:])
    curvature = rest[:searched, :searched] + DAMPING * point.error**2 * np.eye(searched)
    place = np.array([point.delay_s / longest_delay_s, point.rest_fraction])
    low, high = _reach(point.modes, FIRST_OF_RATE / max(f.run.step_s for f in fits), whole)
    low, high = np.concatenate([np.array([0.0, -1.0]) - place, low]), np.concatenate([1.0 - place, high])
    move = least_in_box(curvature, rest[:searched, -1], low, np.maximum(high, low + TIGHT))
    changes = np.diag(rest)[:searched] * move**2 > UNFELT * point.error**2
    return np.asarray(changes * move * unit[:searched])


def linearised(fit: FitRun, point: Solution, delay_step_s: float) -> Samples:
    """The model about a solution, (rows, slopes that are not 0 + 4 + 3m).

    Columns: a unit of each of those slopes, of the delay, of the rest fraction, of the share and the logarithms of
    frequency and damping of each mode, 1, and the measured position. The column of the delay is a difference over
    ``delay_step_s``.
    """
    basis, slopes = without_idle_plays(point.basis, point.slopes)
    free, modes = slopes > 0, point.modes
    delay_s, rest, n = point.delay_s, point.rest_fraction, int(np.count_nonzero(free))
    near = rest + (REST_STEP if rest < 0 else -REST_STEP)
    columns = np.empty((len(fit.rows), n + 4 + 3 * len(modes)))
    columns[:, :n] = design_matrix(fit, basis, delay_s, rest, modes)[:, free]
    every = fit.of_every_row if modes else fit  # a mode rings of all rows, not of those alone that count
    answer = design_matrix(every, basis, delay_s, rest) @ slopes
    late = design_matrix(every, basis, delay_s + delay_step_s, rest) @ slopes
    other = design_matrix(every, basis, delay_s, near) @ slopes
    changes = np.stack([(late - answer) / delay_step_s, (other - answer) / (near - rest)], axis=1)
    if modes:
        step_s = fit.run.step_s
        columns[:, n + 2 : -2] = _mode_columns(answer, modes, step_s)[fit.rows]
        changes = behind_modes(changes, modes, step_s)[fit.rows]
    columns[:, n : n + 2] = changes
    columns[:, -2] = 1.0
    columns[:, -1] = fit.position()
    return columns


def lag_column(fit: FitRun, point: Solution) -> Samples:
    """(rows,): what a second more of the time constant in front of the operator adds to the position, in um."""
    step_s = LAG_SLOPE_STEP * fit.lag_s
    slower = replace(fit, lag_s=fit.lag_s + step_s)
    return np.asarray((point.residual(fit) - point.residual(slower)) / step_s)


def _mode_columns(answer: Samples, modes: tuple[Mode, ...], step_s: float) -> Samples:
    """(n, 3m): what the share of each mode and the logarithms of its frequency and damping add to an answer (n,)."""
    columns = []
    for c, f_Hz, zeta in modes:
        through = resonant(answer, f_Hz, zeta, step_s)
        faster = resonant(answer, f_Hz * (1 + MODE_STEP), zeta, step_s)
        damped = resonant(answer, f_Hz, zeta * (1 + MODE_STEP), step_s)
        columns += [through - answer, c * (faster - through) / MODE_STEP, c * (damped - through) / MODE_STEP]
    return np.stack(columns, axis=1)
