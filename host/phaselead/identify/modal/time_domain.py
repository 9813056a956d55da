"""Common modes fitted to records in the time domain: poles, how they fall with level, and what shapes the pushes.

The shares of the modes are solved for, everything else is searched (``phaselead.identify.gauss_newton``) in steps of
Levenberg and Marquardt. Records weigh by what the model leaves of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.identify.gauss_newton import descend, ridged
from phaselead.identify.modal.model import Drive, ModalModel
from phaselead.model import Complex
from phaselead.record import Samples

LEAST_ZETA, MOST_ZETA = 0.002, 0.97
"""Range of damping that a step stays in."""
LARGEST_POLE_STEP = 0.1
"""Of a pole, in one step."""
SHIFT_STD = 0.02
"""Prior of how far a level can move a pole, as a share of it: modes that the records hardly show stay."""
LARGEST_SHIFT = 0.3
LEVEL_MARGIN = 2.0
"""Poles stay damped, and shifts below LARGEST_SHIFT, up to this multiple of the highest level of the records."""
ENOUGH_GAIN, FEWEST_STEPS = 1e-3, 6
"""Less than this share of the squares gained in a step, after so many steps: done."""
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-7, 1e5
"""Of a step, as a share of the diagonal of the normal matrix: at first, at least, and where the search gives up."""
CALMER, BOLDER = 8, 5
"""Factors by which the damping grows after a step that gained nothing, and falls after one that did."""
REWEIGHED = (1, 4)
"""Steps before which the records are weighed anew: once the first errors of the start are out, and once more."""
SHARES_RIDGE = 1e-10
"""Of the mean diagonal: keeps shares that the records cannot tell apart from dividing by zero."""
GUARD = 1e-12
"""Of the largest diagonal element: the same for poles, shifts and shaping."""
FIRST_LEFT = 0.05
"""Share of its output that a model is expected to leave before anything is fitted."""

Drives = Callable[[Samples], Sequence[Drive]]
"""Drives for the parameters (k,) that shape the pushes."""
Changes = Callable[[int], Sequence[Samples]]
"""For a record: changes (n, inputs) of its pushes, each for one unit of something."""


@dataclass(frozen=True)
class Shaping:
    """What shapes the pushes: its parameters, steps for their derivatives, bounds, and drives for any value."""

    drives: Drives
    values: Samples
    steps: Samples
    low: Samples
    high: Samples


@dataclass(frozen=True)
class ModalFit:
    """The model, the parameters of the pushes, and how sure they are."""

    model: ModalModel
    shift: Complex | None
    """(m,) relative fall of each pole when all levels are 1, weighed by participation; None where it is not fitted."""
    values: Samples
    weights: Samples
    """(records,) that their squares counted."""
    squares: float
    """Weighted sum of squares that is left, with what the prior adds."""
    pole_std: Samples
    """(2m,): real and imaginary part, as a share of abs(p)."""
    shift_std: Samples
    """(2m,): real and imaginary part."""
    value_std: Samples
    share_std: Samples
    """(inputs (1 + 2m),): of the model's weights, at any output."""


@dataclass(frozen=True)
class Point:
    """Everything a step changes, and what stays."""

    poles: Complex
    shift: Complex | None
    values: Samples
    split: Samples
    """(m, inputs): whose level moves a pole how much."""
    held: ModalModel | None = None
    """The model whose poles and shares stay, and where ``shift`` is None the fall of its poles too; None: all move."""

    @property
    def drop(self) -> Complex | None:
        if self.shift is None:
            return None if self.held is None else self.held.drop
        return np.asarray(self.shift[:, None] * self.split)

    @property
    def fixed(self) -> int:
        """How many of the parameters of the normal equations stay, the first ones."""
        return 0 if self.held is None else 2 * len(self.poles)


@dataclass(frozen=True)
class _Fitted:
    """A point of the search: everything that follows from it, and the damping of the next step."""

    point: Point
    drives: Sequence[Drive]
    model: ModalModel
    squares: float
    """Weighted, with what the prior adds."""
    by_record: Samples
    """Mean weighted square of each record (records,)."""
    weights: Samples
    damping: float


@dataclass(frozen=True)
class Normal:
    """Normal equations of the nonlinear parameters (k,), the shares being free to follow."""

    matrix: Samples
    slope: Samples
    scores: Samples
    """(records times outputs, k): what each adds to the slope."""
    share_std: Samples
    """(inputs (1 + 2m),) of the shares at any output."""


def fit_modes(
    poles: Complex,
    shaping: Shaping,
    *,
    shift: Complex | None = None,
    split: Samples | None = None,
    most_steps: int = 12,
    weights: Samples | None = None,
    held: ModalModel | None = None,
    report: Callable[[float], None] | None = None,
) -> ModalFit:
    """Fit from ``poles`` (m,), and from ``shift`` (m,) where poles may fall with the levels.

    ``split`` (m, inputs), rows of sum 1: whose level moves a pole; by default all alike. ``weights`` (records,): of
    their squares; by default estimated on the way. ``held``: a model of these poles that stays as it is, so that only
    ``shift`` and what shapes the pushes are fitted; every record then counts by its output, since where a held model
    errs is not known beforehand.
    """
    drives = shaping.drives(shaping.values)
    inputs = drives[0].push_um.shape[1]
    even = np.full((len(poles), inputs), 1 / inputs)
    point = Point(poles, shift, shaping.values.copy(), even if split is None else split, held)
    start = _fitted(point, drives, _first_weights(drives) if weights is None else weights, FIRST_DAMPING)

    def reweighed(at: _Fitted, step: int) -> _Fitted:
        return at if weights is not None or held is not None or step not in REWEIGHED else _reweighed(at)

    found = descend(
        start,
        lambda at: _trials(at, shaping),
        lambda at: at.squares,
        most_steps,
        enough=ENOUGH_GAIN,
        fewest_steps=FEWEST_STEPS,
        reweighed=reweighed,
        report=report,
    )
    found = found if held is None else _reweighed(found)
    return _result(found, _normal_of(found, shaping))


def _reweighed(at: _Fitted) -> _Fitted:
    """The same with every record weighed by what is left of it."""
    return _fitted(at.point, at.drives, 1 / np.maximum(at.by_record / at.weights, 1e-30), at.damping)


def _first_weights(drives: Sequence[Drive]) -> Samples:
    return np.array([1 / (FIRST_LEFT**2 * float(np.mean(np.var(d.x_um[d.rows], axis=0)))) for d in drives])


def centred(columns: Samples, rows: slice, weight: float) -> Samples:
    return _weighted(columns[rows].copy(), weight)


def _weighted(columns: Samples, weight: float) -> Samples:
    """The columns about their means, times the root of the weight; in place, these are the largest arrays there are."""
    columns -= columns.mean(axis=0)
    columns *= np.sqrt(weight)
    return columns


def _fitted(point: Point, drives: Sequence[Drive], weights: Samples, damping: float) -> _Fitted:
    """The point with the best shares."""
    inputs = drives[0].push_um.shape[1]
    parts = []
    for drive, weight in zip(drives, weights, strict=True):
        columns = _weighted(drive.scored(point.poles, point.drop), weight)
        x = centred(drive.x_um, drive.rows, weight)
        parts.append((columns.T @ columns, columns.T @ x, float(np.sum(x**2)), x.size))
    if point.held is not None:
        best = point.held.weights
    else:
        normal = np.sum([p[0] for p in parts], axis=0)
        best = np.asarray(np.linalg.solve(ridged(normal, SHARES_RIDGE), np.sum([p[1] for p in parts], axis=0)))
    squares = np.array([p[2] - 2 * np.sum(best * p[1]) + np.sum(best * (p[0] @ best)) for p in parts])
    squares = np.maximum(squares, 1e-30)
    model = ModalModel(point.poles, best, inputs, point.drop)
    by_record = squares / np.array([p[3] for p in parts])
    return _Fitted(point, drives, model, float(squares.sum()) + _prior(point, drives), by_record, weights, damping)


def _prior_scale(point: Point, drives: Sequence[Drive]) -> Samples:
    """(m,): one over the standard deviation of a shift."""
    largest = np.max([d.mean_level(point.split) for d in drives], axis=0)
    return np.asarray(largest / SHIFT_STD)


def _prior(point: Point, drives: Sequence[Drive]) -> float:
    """What the shifts add to the squares."""
    if point.shift is None:
        return 0.0
    return float(np.sum(np.abs(point.shift * _prior_scale(point, drives)) ** 2))


def normal_equations(
    point: Point, model: ModalModel, drives: Sequence[Drive], weights: Samples, changes: Changes, count: int
) -> Normal:
    """Normal equations of poles, shifts and ``count`` changes of the pushes, with the shares eliminated; where the
    model is held, its shares stay."""
    outputs, basis = model.weights.shape[1], len(model.weights)
    size = poles_size(point) + count
    own, cross = np.zeros((basis, basis)), np.zeros((outputs, basis, size))
    inner, records = np.zeros((size, size)), []
    for d, (drive, weight) in enumerate(zip(drives, weights, strict=True)):
        columns = _weighted(drive.scored(point.poles, point.drop, slopes=True), weight)
        residual = centred(drive.x_um, drive.rows, weight) - columns[:, :basis] @ model.weights
        gram, products = columns.T @ columns, columns.T @ residual
        own += gram[:basis, :basis]
        shaped = _shaped(model, drive, changes(d), weight)
        for i in range(outputs):
            slopes = _pole_map(point, model, drive, i)
            behind = gram[:, basis:] @ slopes
            extra = columns.T @ shaped[i]
            cross[i] += np.hstack([behind[:basis], extra[:basis]])
            mixed = slopes.T @ extra[basis:]
            inner += np.block([[slopes.T @ behind[basis:], mixed], [mixed.T, shaped[i].T @ shaped[i]]])
            records.append((i, products[:basis, i], slopes.T @ products[basis:, i], shaped[i].T @ residual[:, i]))
    inverse = np.linalg.inv(ridged(own, SHARES_RIDGE)) if point.held is None else np.zeros_like(own)
    taken = [inverse @ c for c in cross]
    matrix = inner - np.sum([c.T @ t for c, t in zip(cross, taken, strict=True)], axis=0)
    scores = np.array([np.concatenate([b, c]) - taken[i].T @ a for i, a, b, c in records])
    slope = scores.sum(axis=0)
    if point.shift is not None:
        scale = np.repeat(_prior_scale(point, drives) ** 2, 2)
        at = 2 * len(point.poles)
        matrix[at : 2 * at, at : 2 * at] += np.diag(scale)
        slope[at : 2 * at] -= scale * point.shift.view(np.float64)
    return Normal(matrix, slope, scores, np.sqrt(np.diag(inverse)))


def poles_size(point: Point) -> int:
    return 2 * len(point.poles) * (1 if point.shift is None else 2)


def _pole_map(point: Point, model: ModalModel, drive: Drive, output: int) -> Samples:
    """(inputs 2m, poles and shifts): slopes of the states as they act at one output."""
    m, inputs = len(point.poles), model.inputs
    rho = model.residues[output, :, 0::2] - 1j * model.residues[output, :, 1::2]  # (inputs, m)
    turns = [np.ones(m, dtype=complex)]
    if point.shift is not None:
        turns.append(-point.poles / np.abs(point.poles) * drive.mean_level(point.split))
    found = np.zeros((inputs, m, 2, len(turns), m, 2))
    modes = np.arange(m)
    for t, turn in enumerate(turns):
        for h, unit in enumerate((1.0, 1j)):
            z = rho * turn * unit
            found[:, modes, 0, t, modes, h] = z.real
            found[:, modes, 1, t, modes, h] = -z.imag
    return found.reshape(inputs * m * 2, len(turns) * m * 2)


def _changes_of(shaping: Shaping, drives: Sequence[Drive], point: Point) -> Changes:
    """Derivatives of the pushes in the values that shape them."""
    moved = []
    for k, step in enumerate(shaping.steps):
        values = point.values.copy()
        values[k] += step
        moved.append([(o.push_um - d.push_um) / step for o, d in zip(shaping.drives(values), drives, strict=True)])
    return lambda record: [of_value[record] for of_value in moved]


def _shaped(model: ModalModel, drive: Drive, changes: Sequence[Samples], weight: float) -> list[Samples]:
    """Per output (rows, changes): what the changes do there."""
    scored = len(range(*drive.rows.indices(len(drive.x_um))))
    found = np.zeros((model.weights.shape[1], scored, len(changes)))
    for k, change in enumerate(changes):
        found[:, :, k] = centred(model.moved_by(change, drive), drive.rows, weight).T
    return list(found)


def _normal_of(at: _Fitted, shaping: Shaping) -> Normal:
    changes = _changes_of(shaping, at.drives, at.point)
    return normal_equations(at.point, at.model, at.drives, at.weights, changes, len(shaping.values))


def _trials(at: _Fitted, shaping: Shaping) -> Iterator[_Fitted]:
    """Points a damped Gauss-Newton step away, ever more damped."""
    normal, damping, fixed = _normal_of(at, shaping), at.damping, at.point.fixed
    matrix = normal.matrix[fixed:, fixed:]
    scale = np.diag(matrix)
    guard = GUARD * scale.max() * np.eye(len(scale))
    highest = LEVEL_MARGIN * max((float(d.level.max()) for d in at.drives if d.level is not None), default=0)
    while damping < MOST_DAMPING:
        change = np.zeros(len(normal.slope))
        change[fixed:] = np.linalg.solve(matrix + damping * np.diag(scale) + guard, normal.slope[fixed:])
        after = _moved(at.point, change, shaping, highest)
        bolder = max(damping / BOLDER, LEAST_DAMPING)
        yield _fitted(after, shaping.drives(after.values), at.weights, bolder)
        damping *= CALMER


def _moved(point: Point, change: Samples, shaping: Shaping, highest: float) -> Point:
    m = len(point.poles)
    turn = np.ascontiguousarray(change[: 2 * m]).view(np.complex128)
    turn = turn / np.maximum(1.0, np.abs(turn) / LARGEST_POLE_STEP)
    shift = point.shift
    if shift is not None:
        shift = shift + np.ascontiguousarray(change[2 * m : 4 * m]).view(np.complex128)
    values = np.clip(point.values + change[poles_size(point) :], shaping.low, shaping.high)
    poles = stable(point.poles + np.abs(point.poles) * turn) if point.held is None else point.poles
    if shift is not None:
        shift = stable_shift(poles, shift, highest)
    return replace(point, poles=poles, shift=shift, values=values)


def stable(p: Complex) -> Complex:
    """The poles with their damping inside what a mode can have."""
    size = np.abs(p)
    zeta = np.clip(-p.real / size, LEAST_ZETA, MOST_ZETA)
    return np.asarray(size * (-zeta + 1j * np.sqrt(1 - zeta**2)))


def stable_shift(p: Complex, shift: Complex, level: float) -> Complex:
    """Shifts (m,) halved until every pole keeps the least damping up to ``level``."""
    for _ in range(20):
        moved = p * (1 - shift * level)
        bad = (-moved.real < LEAST_ZETA / 2 * np.abs(moved)) | (np.abs(shift) * level > LARGEST_SHIFT)
        if not bad.any():
            break
        shift = np.where(bad, shift / 2, shift)
    return shift


def _result(at: _Fitted, normal: Normal) -> ModalFit:
    """Standard deviations: the larger of what white residuals give and of the scatter of the scores between records
    and outputs (White 1980)."""
    point, fixed = at.point, at.point.fixed
    inverse = np.zeros_like(normal.matrix)
    inverse[fixed:, fixed:] = inverse_of(normal.matrix[fixed:, fixed:])
    influence = normal.scores @ inverse
    white, scattered = np.diag(inverse), (influence**2).sum(axis=0)
    std, m = np.sqrt(np.maximum(np.maximum(white, scattered), 0.0)), len(point.poles)
    coloured = np.sqrt(max(1.0, float(np.median(scattered[: 2 * m] / np.maximum(white[: 2 * m], 1e-300)))))
    end = poles_size(point)
    return ModalFit(
        model=at.model,
        shift=point.shift,
        values=point.values,
        weights=at.weights,
        squares=at.squares,
        pole_std=std[: 2 * m],
        shift_std=std[2 * m : end],
        value_std=std[end:],
        share_std=coloured * normal.share_std,
    )


def inverse_of(matrix: Samples) -> Samples:
    """The inverse of a normal matrix (k, k), guarded."""
    guard = GUARD * float(np.diag(matrix).max(initial=0.0)) * np.eye(len(matrix))
    return np.asarray(np.linalg.inv(matrix + guard))
