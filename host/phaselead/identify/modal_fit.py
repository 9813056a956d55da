"""Common modes fitted to records in the time domain: poles, how they fall with level, and what shapes the pushes.

Separable least squares (Golub and Pereyra 1973): the shares of the modes are solved for, everything else takes
Gauss-Newton steps (Levenberg-Marquardt) on what they leave. Records weigh by what the model leaves of each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.identify.modal_model import Complex, Drive, ModalModel, Samples
from phaselead.model import states

LEAST_ZETA, MOST_ZETA = 0.002, 0.97
LARGEST_STEP = 0.1
"""Of a pole, in one step."""
SHIFT_STD = 0.02
"""Prior of how far a level can move a pole, as a share of it: modes that the records hardly show stay."""
LARGEST_SHIFT = 0.3
MARGIN = 2.0
"""Poles stay damped, and shifts below LARGEST_SHIFT, up to this multiple of the highest level of the records."""
ENOUGH = 1e-3
"""Less than this share of the squares gained in a step: done."""
MOST_DAMPING = 1e5
RIDGE = 1e-10
POWERLESS = 1e-4
"""A change of which poles and shares take up all but this share of its squares cannot be told from them."""
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
    left: float
    """Weighted squares."""
    pole_std: Samples
    """(2m,): real and imaginary part, as a share of abs(p)."""
    shift_std: Samples
    """(2m,): real and imaginary part."""
    value_std: Samples
    share_std: Samples
    """(inputs (1 + 2m),): of the model's weights, at any output."""


@dataclass(frozen=True)
class _Point:
    """Everything a step changes."""

    poles: Complex
    shift: Complex | None
    values: Samples
    split: Samples
    """(m, inputs): whose level moves a pole how much."""

    @property
    def drop(self) -> Complex | None:
        return None if self.shift is None else self.shift[:, None] * self.split


@dataclass(frozen=True)
class _Normal:
    """Reduced normal equations of the nonlinear parameters, and their scores per record and output."""

    matrix: Samples
    slope: Samples
    scores: Samples
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
    report: Callable[[float], None] | None = None,
) -> ModalFit:
    """Fit from ``poles`` (m,), and from ``shift`` (m,) where poles may fall with the levels.

    ``split`` (m, inputs), rows of sum 1: whose level moves a pole; by default all alike.
    """
    drives = shaping.drives(shaping.values)
    inputs = drives[0].push_um.shape[1]
    even = np.full((len(poles), inputs), 1 / inputs)
    point = _Point(poles, shift, shaping.values.copy(), even if split is None else split)
    given = weights
    weights = _first_weights(drives) if given is None else given
    model, left, by_record = _solved(point, drives, weights)
    damping, gained = 1e-3, 1.0
    for step in range(most_steps):
        if given is None and step in (1, 4):  # once the first errors of the start are out
            weights = 1 / np.maximum(by_record / weights, 1e-30)
            model, left, by_record = _solved(point, drives, weights)
        normal = _normal(point, model, drives, weights, _changes_of(shaping, drives, point), len(shaping.values))
        tried = _improved(point, normal, shaping, weights, left, damping)
        if report is not None:
            report((step + 1) / most_steps)
        if tried is None:
            break
        point, drives, model, left_now, by_record, damping = tried
        gained, left = (left - left_now) / left, left_now
        if gained < ENOUGH and step > 4:
            break
    changes = _changes_of(shaping, drives, point)
    return _result(point, model, _normal(point, model, drives, weights, changes, len(shaping.values)), weights, left)


def _first_weights(drives: Sequence[Drive]) -> Samples:
    return np.array([1 / (FIRST_LEFT**2 * float(np.mean(np.var(d.x_um[d.rows], axis=0)))) for d in drives])


def _centred(columns: Samples, rows: slice, weight: float) -> Samples:
    return _weighted(columns[rows].copy(), weight)


def _weighted(columns: Samples, weight: float) -> Samples:
    """About their means, in place: these are the largest arrays there are."""
    columns -= columns.mean(axis=0)
    columns *= np.sqrt(weight)
    return columns


def _solved(point: _Point, drives: Sequence[Drive], weights: Samples) -> tuple[ModalModel, float, Samples]:
    """The model with the best shares, the squares it leaves, and their mean in each record (records,)."""
    inputs = drives[0].push_um.shape[1]
    parts = []
    for drive, weight in zip(drives, weights, strict=True):
        columns = _weighted(drive.scored(point.poles, point.drop), weight)
        x = _centred(drive.x_um, drive.rows, weight)
        parts.append((columns.T @ columns, columns.T @ x, float(np.sum(x**2)), x.size))
    normal = np.sum([p[0] for p in parts], axis=0)
    best = np.asarray(np.linalg.solve(_ridged(normal), np.sum([p[1] for p in parts], axis=0)))
    squares = np.array([p[2] - 2 * np.sum(best * p[1]) + np.sum(best * (p[0] @ best)) for p in parts])
    squares = np.maximum(squares, 1e-30)
    model = ModalModel(point.poles, best, inputs, point.drop)
    sizes = np.array([p[3] for p in parts])
    return model, float(squares.sum()) + _prior(point, drives), squares / sizes


def _ridged(normal: Samples) -> Samples:
    return np.asarray(normal + RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal)))


def _prior_scale(point: _Point, drives: Sequence[Drive]) -> Samples:
    """(m,): one over the standard deviation of a shift."""
    largest = np.max([_mean_level(d, point.split) for d in drives], axis=0)
    return np.asarray(largest / SHIFT_STD)


def _prior(point: _Point, drives: Sequence[Drive]) -> float:
    if point.shift is None:
        return 0.0
    return float(np.sum(np.abs(point.shift * _prior_scale(point, drives)) ** 2))


def _mean_level(drive: Drive, split: Samples) -> Samples:
    """(m,) level that moves each mode, over the scored rows."""
    if drive.level is None:
        return np.zeros(len(split))
    return np.asarray(split @ drive.level[drive.rows].mean(axis=0))


def _normal(
    point: _Point, model: ModalModel, drives: Sequence[Drive], weights: Samples, changes: Changes, count: int
) -> _Normal:
    """Normal equations of poles, shifts and ``count`` changes of the pushes, with the shares eliminated."""
    outputs, basis = model.weights.shape[1], len(model.weights)
    size = _poles_size(point) + count
    own, cross = np.zeros((basis, basis)), np.zeros((outputs, basis, size))
    inner, records = np.zeros((size, size)), []
    for d, (drive, weight) in enumerate(zip(drives, weights, strict=True)):
        columns = _weighted(drive.scored(point.poles, point.drop, slopes=True), weight)
        left = _centred(drive.x_um, drive.rows, weight) - columns[:, :basis] @ model.weights
        gram, products = columns.T @ columns, columns.T @ left
        own += gram[:basis, :basis]
        shaped = _shaped(model, drive, changes(d), weight)
        for i in range(outputs):
            slopes = _pole_map(point, model, drive, i)
            behind = gram[:, basis:] @ slopes
            extra = columns.T @ shaped[i]
            cross[i] += np.hstack([behind[:basis], extra[:basis]])
            mixed = slopes.T @ extra[basis:]
            inner += np.block([[slopes.T @ behind[basis:], mixed], [mixed.T, shaped[i].T @ shaped[i]]])
            records.append((i, products[:basis, i], slopes.T @ products[basis:, i], shaped[i].T @ left[:, i]))
    inverse = np.linalg.inv(_ridged(own))
    taken = [inverse @ c for c in cross]
    matrix = inner - np.sum([c.T @ t for c, t in zip(cross, taken, strict=True)], axis=0)
    scores = np.array([np.concatenate([b, c]) - taken[i].T @ a for i, a, b, c in records])
    slope = scores.sum(axis=0)
    if point.shift is not None:
        scale = np.repeat(_prior_scale(point, drives) ** 2, 2)
        at = 2 * len(point.poles)
        matrix[at : 2 * at, at : 2 * at] += np.diag(scale)
        slope[at : 2 * at] -= scale * point.shift.view(np.float64)
    return _Normal(matrix, slope, scores, np.sqrt(np.diag(inverse)))


def _poles_size(point: _Point) -> int:
    return 2 * len(point.poles) * (1 if point.shift is None else 2)


def _pole_map(point: _Point, model: ModalModel, drive: Drive, output: int) -> Samples:
    """(inputs 2m, poles and shifts): slopes of the states as they act at one output."""
    m, inputs = len(point.poles), model.inputs
    rho = model.residues[output, :, 0::2] - 1j * model.residues[output, :, 1::2]  # (inputs, m)
    turns = [np.ones(m, dtype=complex)]
    if point.shift is not None:
        turns.append(-point.poles / np.abs(point.poles) * _mean_level(drive, point.split))
    found = np.zeros((inputs, m, 2, len(turns), m, 2))
    modes = np.arange(m)
    for t, turn in enumerate(turns):
        for h, unit in enumerate((1.0, 1j)):
            z = rho * turn * unit
            found[:, modes, 0, t, modes, h] = z.real
            found[:, modes, 1, t, modes, h] = -z.imag
    return found.reshape(inputs * m * 2, len(turns) * m * 2)


def _changes_of(shaping: Shaping, drives: Sequence[Drive], point: _Point) -> Changes:
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
        found[:, :, k] = _centred(through_modes(model, drive, change), drive.rows, weight).T
    return list(found)


def through_modes(model: ModalModel, drive: Drive, change_um: Samples) -> Samples:
    """(n, outputs): what a change (n, inputs) of the pushes does, at the levels of the record."""
    answer = change_um @ model.direct.T
    level = drive.level if model.drop is not None else None
    for j in range(model.inputs):
        if np.any(change_um[:, j]):
            seen = states(change_um[:, j], model.poles, drive.step_s, level, None if level is None else model.drop)
            answer = answer + seen @ model.residues[:, j].T
    return np.asarray(answer)


_Tried = tuple[_Point, Sequence[Drive], ModalModel, float, Samples, float]


def _improved(
    point: _Point, normal: _Normal, shaping: Shaping, weights: Samples, left: float, damping: float
) -> _Tried | None:
    """The next point that leaves less, with its damping; None when there is none."""
    scale = np.diag(normal.matrix)
    guard = 1e-12 * scale.max() * np.eye(len(scale))
    highest = MARGIN * max(
        (float(d.level.max()) for d in shaping.drives(point.values) if d.level is not None), default=0
    )
    while damping < MOST_DAMPING:
        change = np.linalg.solve(normal.matrix + damping * np.diag(scale) + guard, normal.slope)
        after = _moved(point, change, shaping, highest)
        drives = shaping.drives(after.values)
        model, now, by_record = _solved(after, drives, weights)
        if now < left:
            return after, drives, model, now, by_record, max(damping / 5, 1e-7)
        damping *= 8
    return None


def _moved(point: _Point, change: Samples, shaping: Shaping, highest: float) -> _Point:
    m = len(point.poles)
    turn = np.ascontiguousarray(change[: 2 * m]).view(np.complex128)
    turn = turn / np.maximum(1.0, np.abs(turn) / LARGEST_STEP)
    shift = point.shift
    if shift is not None:
        shift = shift + np.ascontiguousarray(change[2 * m : 4 * m]).view(np.complex128)
    values = np.clip(point.values + change[_poles_size(point) :], shaping.low, shaping.high)
    poles = stable(point.poles + np.abs(point.poles) * turn)
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


def _result(point: _Point, model: ModalModel, normal: _Normal, weights: Samples, left: float) -> ModalFit:
    """Standard deviations: the larger of what white residuals give and of the scatter of the scores between records
    and outputs (White 1980)."""
    inverse = _inverse(normal.matrix)
    influence = normal.scores @ inverse
    white, scattered = np.diag(inverse), (influence**2).sum(axis=0)
    std, m = np.sqrt(np.maximum(np.maximum(white, scattered), 0.0)), len(point.poles)
    coloured = np.sqrt(max(1.0, float(np.median(scattered[: 2 * m] / np.maximum(white[: 2 * m], 1e-300)))))
    at = _poles_size(point)
    return ModalFit(
        model, point.shift, point.values, weights, left, std[: 2 * m], std[2 * m : at], std[at:],
        coloured * normal.share_std,
    )  # fmt: skip


def _inverse(matrix: Samples) -> Samples:
    guard = 1e-12 * float(np.diag(matrix).max()) * np.eye(len(matrix))
    return np.asarray(np.linalg.inv(matrix + guard))


@dataclass(frozen=True)
class Explained:
    """Per change: its best amount, the deviation of that, and the share of the squares left that it would explain."""

    amounts: Samples
    std: Samples
    share: Samples


def explained(
    fit: ModalFit, split: Samples, drives: Sequence[Drive], weights: Samples, changes: Changes, count: int
) -> Explained:
    """Score test of changes of the pushes, each by itself, poles and shares being free to follow."""
    point = _Point(fit.model.poles, fit.shift, np.zeros(0), split)
    normal = _normal(point, fit.model, drives, weights, changes, count)
    at = _poles_size(point)
    cross = normal.matrix[:at, at:]
    taken = _inverse(normal.matrix[:at, :at]) @ cross
    power = np.diag(normal.matrix[at:, at:]) - np.sum(cross * taken, axis=0)
    scores = normal.scores[:, at:] - normal.scores[:, :at] @ taken
    slope = normal.slope[at:] - taken.T @ normal.slope[:at]
    seen = power > POWERLESS * np.maximum(np.diag(normal.matrix[at:, at:]), 1e-300)
    power = np.where(seen, power, np.inf)
    amounts = slope / power
    variance = np.maximum(1.0, (scores**2).sum(axis=0) / power) / power
    left = _left_of(fit.model, drives, weights)
    return Explained(amounts, np.where(seen, np.sqrt(variance), np.inf), slope * amounts / left)


def _left_of(model: ModalModel, drives: Sequence[Drive], weights: Samples) -> float:
    total = 0.0
    for drive, weight in zip(drives, weights, strict=True):
        total += float(np.sum(_centred(drive.x_um - model.answer(drive), drive.rows, weight) ** 2))
    return total
