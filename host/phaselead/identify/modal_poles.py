"""Poles common to all elements of a frequency response matrix, by vector fitting; those that do not pay are dropped.

Gustavsen and Semlyen 1999, Rational approximation of frequency domain responses by vector fitting; relaxed and
compressed as in Gustavsen 2006 and Deschrijver et al. 2008. Unstable poles are mirrored at every step, so that the
result is stable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.modal_response import FrequencyResponse

Samples = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

ROUNDS = 8
STARTS = (14, 20, 26)
"""Modes to begin with, evenly over the band; the best is taken."""
RELAXATIONS = (0.003, 0.03)
"""Shares of the band where two real poles begin, for what creeps."""
LEAST_ZETA, MOST_ZETA = 0.002, 0.95
"""Lighter damped ones stand for noise on single lines; real poles become well damped modes."""
BEYOND = 2.5
"""Of the highest line: modes above it are left to the direct term."""
OUTSIDE, REST, REST_ZETA = 1.15, 1.6, 0.7
"""A mode at this multiple of the highest line stands for all above the band where none was found there."""


def common_poles(
    response: FrequencyResponse,
    report: Callable[[float], None] | None = None,
    starts: Sequence[int] = STARTS,
) -> Complex:
    """Poles (m,) in 1/s of the upper half plane, by rising frequency; ``starts``: numbers of modes to try."""
    s = 2j * np.pi * response.f_Hz
    elements = response.matrix.reshape(len(s), -1)
    best, best_price = np.zeros(0, dtype=complex), np.inf
    for i, count in enumerate(starts):
        if len(best) and 4 * count > len(s):
            break
        found = _usable(_vector_fit(s, elements, _start(response.f_Hz, count)), response.f_Hz[-1])
        found = _pruned(s, elements, found)
        price = _price(s, elements, found)
        if report is not None:
            report((i + 1) / len(starts))
        if price < best_price:
            best, best_price = found, price
    return best


def _start(f_Hz: Samples, count: int) -> Complex:
    """Lightly damped pairs over the upper nine tenths of the band and two real poles below."""
    w = 2 * np.pi * np.linspace(0.1 * f_Hz[-1], f_Hz[-1], count)
    real = -2 * np.pi * f_Hz[-1] * np.array(RELAXATIONS)
    return np.concatenate([w * (-0.01 + 1j), real.astype(complex)])


def _basis(s: Complex, p: Complex) -> Complex:
    """(lines, states): real-coefficient partial fractions of pairs and of real poles."""
    columns = []
    for q in p:
        near = 1 / (s - q)
        if q.imag == 0:
            columns.append(near)
        else:
            far = 1 / (s - q.conjugate())
            columns += [near + far, 1j * (near - far)]
    return np.stack(columns, axis=1)


def _vector_fit(s: Complex, elements: Complex, p: Complex) -> Complex:
    for _ in range(ROUNDS):
        p = _relocated(s, elements, p)
    return p


def _relocated(s: Complex, elements: Complex, p: Complex) -> Complex:
    """One step: the zeros of sigma(s) = d + sum c/(s - p), which makes sigma H and its fit agree."""
    fractions = _basis(s, p)
    ones = np.ones((len(s), 1))
    own = np.hstack([fractions, ones, s[:, None] / abs(s[-1])])
    shared = np.hstack([fractions, ones])
    parts = []
    for h in elements.T:
        both = np.hstack([own, -h[:, None] * shared])
        triangle = np.asarray(np.linalg.qr(np.vstack([both.real, both.imag]), mode="r"))
        parts.append(triangle[own.shape[1] :, own.shape[1] :])
    weight = float(np.linalg.norm(elements)) / len(s)
    parts.append(weight * shared.real.sum(axis=0)[None])  # sigma is 1 on average: the relaxed constraint
    matrix = np.vstack(parts)
    target = np.zeros(len(matrix))
    target[-1] = weight * len(s)
    scale = np.linalg.norm(matrix, axis=0)
    solution = np.linalg.lstsq(matrix / scale, target, rcond=None)[0] / scale
    return _zeros(p, solution[:-1], float(solution[-1]))


def _zeros(p: Complex, c: Samples, d: float) -> Complex:
    """Eigenvalues of the sigma's inverse, mirrored into the left half plane, one of each pair."""
    size = len(c)
    system, drive = np.zeros((size, size)), np.zeros(size)
    at = 0
    for q in p:
        if q.imag == 0:
            system[at, at], drive[at] = q.real, 1.0
            at += 1
        else:
            system[at : at + 2, at : at + 2] = [[q.real, q.imag], [-q.imag, q.real]]
            drive[at] = 2.0
            at += 2
    found = np.linalg.eigvals(system - np.outer(drive, c) / (d or 1e-12))
    found = -np.abs(found.real) + 1j * found.imag
    paired = found[found.imag > 1e-9 * np.abs(found)]
    real = found[np.abs(found.imag) <= 1e-9 * np.abs(found)].real
    return np.concatenate([paired, real.astype(complex)])


def _usable(p: Complex, highest_Hz: float) -> Complex:
    """Modes only: real poles as well damped ones, nothing far beyond the band, nothing that rings for ever."""
    zeta = -p.real / np.abs(p)
    kept = (np.abs(p) < 2 * np.pi * BEYOND * highest_Hz) & (zeta > LEAST_ZETA) & (np.abs(p) > 0)
    damped = np.minimum(zeta[kept], MOST_ZETA)
    size = np.abs(p[kept])
    if not (size > 2 * np.pi * OUTSIDE * highest_Hz).any():
        size, damped = np.append(size, 2 * np.pi * REST * highest_Hz), np.append(damped, REST_ZETA)
    modes = size * (-damped + 1j * np.sqrt(1 - damped**2))
    return np.asarray(modes[np.argsort(size)])


def _moments(s: Complex, elements: Complex, p: Complex) -> tuple[Samples, Samples]:
    """Real normal matrix (k, k) of the partial fractions and a constant, and their products (k, elements)."""
    columns = np.hstack([_basis(s, p), np.ones((len(s), 1))])
    columns = columns / np.linalg.norm(columns, axis=0)
    return (columns.conj().T @ columns).real, (columns.conj().T @ elements).real


def _price(s: Complex, elements: Complex, p: Complex) -> float:
    """Bayesian information criterion: what the best residues leave, and what the modes cost."""
    normal, products = _moments(s, elements, p)
    rows = 2 * elements.size
    left = _squares(normal, products, float(np.linalg.norm(elements) ** 2))
    return float(rows * np.log(left) + len(p) * _cost(elements))


def _cost(elements: Complex) -> float:
    """Of one mode: a pole and a residue in every element."""
    return float(np.log(2 * elements.size) * (2 + 2 * elements.shape[1]))


def _squares(normal: Samples, products: Samples, total: float) -> float:
    ridge = normal + 1e-12 * np.eye(len(normal))
    explained = float(np.sum(products * np.linalg.solve(ridge, products)))
    return float(max(total - explained, 1e-12 * total))


def _pruned(s: Complex, elements: Complex, p: Complex) -> Complex:
    """Modes dropped one by one while that costs less than their parameters are worth (BIC)."""
    total = float(np.linalg.norm(elements) ** 2)
    normal, products = _moments(s, elements, p)
    rows = 2 * elements.size
    keep = list(range(len(p)))
    left = _squares(normal, products, total)
    while len(keep) > 1:
        costs = []
        for r in keep:
            rest = np.array([i for q in keep if q != r for i in (2 * q, 2 * q + 1)] + [len(normal) - 1])
            costs.append(_squares(normal[np.ix_(rest, rest)], products[rest], total))
        cheapest = int(np.argmin(costs))
        if rows * np.log(costs[cheapest] / left) > _cost(elements):
            break
        left = costs[cheapest]
        del keep[cheapest]
    return p[keep]
