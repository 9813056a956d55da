"""Common modes in the frequency domain: the response matrix of a stage whose axes move together, and its poles.

Steady periods of multisines give the matrix line by line (Pintelon and Schoukens 2012, section 2.7: as many experiments
as inputs, orthogonal or not); anything else by cross-spectra (H1 estimate).

Poles common to all its elements come from vector fitting (Gustavsen and Semlyen 1999; relaxed and compressed as in
Gustavsen 2006 and Deschrijver et al. 2008); unstable poles are mirrored at every step, so that the result is stable.
Modes that do not pay are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.errors import BadInput
from phaselead.model import Complex
from phaselead.record import Samples

REPEATS = 0.02
"""A drive whose periods differ by less than this share of their rms repeats."""
EXCITED = 0.05
"""A line counts as excited where the weakest direction of the drive has this share of a strong line's amplitude."""
SEGMENTS = 8
SHORTEST_SEGMENT = 256
"""About so many segments are averaged, of at least so many rows."""
WELCH_LINES = 0.9
"""Of the Nyquist frequency, as far as cross-spectra are used."""

ROUNDS = 8
"""Of vector fitting, each of which moves the poles."""
STARTS = (14, 20, 26)
"""Modes to begin with, evenly over the band; the best is taken."""
RELAXATIONS = (0.003, 0.03)
"""Shares of the band where two real poles begin, for what creeps."""
DAMPED = (0.002, 0.95)
"""Range of damping. Lighter damped ones stand for noise on single lines; real poles become well damped modes."""
BEYOND = 2.5
"""Of the highest line: modes above it are left to the direct term."""
OUTSIDE_BAND, REST, REST_ZETA = 1.15, 1.6, 0.7
"""A mode at this multiple of the highest line stands for all above the band where none was found there."""


@dataclass(frozen=True)
class JointExperiment:
    """One record of all axes: voltages (n, inputs), positions (n, outputs), and the rows to use."""

    u_V: Samples
    x_um: Samples
    rows: slice
    step_s: float


@dataclass(frozen=True)
class FrequencyResponse:
    """``matrix`` (lines, outputs, inputs) in um/V at ``f_Hz`` (lines,); ``variance`` (lines,): mean square error of an
    element, nan where there are no more experiments than inputs."""

    f_Hz: Samples
    matrix: Complex
    variance: Samples
    period_rows: int | None


def frequency_response(experiments: Sequence[JointExperiment]) -> FrequencyResponse:
    """The response matrix. Raises BadInput when the drives do not tell the inputs apart."""
    period = common_period(experiments)
    return _cross_spectra(experiments) if period is None else _lines(experiments, period)


def common_period(experiments: Sequence[JointExperiment]) -> int | None:
    """Rows after which every drive repeats, with a period to settle before the rows to use, or None."""
    found: set[int] = set()
    for e in experiments:
        start, stop, _ = e.rows.indices(len(e.u_V))
        period = _period(e.u_V[:stop])
        if period is None or stop - start < period or start < period:
            return None
        found.add(period)
    return found.pop() if len(found) == 1 else None


def _period(u: Samples) -> int | None:
    """Rows after which the drives (n, inputs) repeat: the best peak of their autocorrelation that truly repeats."""
    n = len(u)
    u = u - u.mean(axis=0)
    power = float(np.mean(u**2))
    if not power > 0:
        return None
    spectrum = (np.abs(np.fft.rfft(u, 2 * n, axis=0)) ** 2).sum(axis=1)
    rho = np.fft.irfft(spectrum)[: n // 2 + 1] / np.arange(n, n - n // 2 - 1, -1)
    below = np.flatnonzero(rho < 0.5 * rho[0])
    if not len(below):
        return None
    first = int(below[0])
    period = first + int(np.argmax(rho[first:]))
    change = float(np.mean((u[period:] - u[:-period]) ** 2))
    return period if change < REPEATS**2 * power else None


def _lines(experiments: Sequence[JointExperiment], period: int) -> FrequencyResponse:
    """Least squares over the experiments at every line that they excite in all directions."""
    drives, answers = [], []
    for e in experiments:
        u, x = (_mean_period(v[e.rows], period) for v in (e.u_V, e.x_um))
        scale = float(np.sqrt(np.mean(u**2)))
        drives.append(np.fft.rfft(u, axis=0) / (scale * period))
        answers.append(np.fft.rfft(x, axis=0) / (scale * period))
    U, X = np.stack(drives, axis=2), np.stack(answers, axis=2)  # (lines, channels, experiments)
    inputs, count = U.shape[1], U.shape[2]
    if count < inputs:
        raise BadInput(f"{count} experiments do not tell {inputs} inputs apart; record as many as there are inputs")
    sizes = np.linalg.svd(U, compute_uv=False)
    strongest = float(np.median(np.sort(sizes[:, 0])[len(sizes) // 2 :]))
    lines = np.flatnonzero(sizes[:, -1] > EXCITED * strongest)
    lines = lines[lines > 0]
    if not strongest > 0 or len(lines) < 8 * inputs:
        raise BadInput("the experiments drive the axes always in the same proportion; drive them with other phases")
    U, X = U[lines], X[lines]
    matrix = np.asarray(X @ np.linalg.pinv(U), dtype=complex)
    squares = np.abs(X - matrix @ U) ** 2
    free = count - inputs
    spread = np.mean(np.linalg.norm(np.linalg.pinv(U), axis=1) ** 2, axis=1)
    variance = squares.sum(axis=2).mean(axis=1) / free * spread if free else np.full(len(lines), np.nan)
    return FrequencyResponse(lines / (period * experiments[0].step_s), matrix, variance, period)


def _mean_period(x: Samples, period: int) -> Samples:
    whole = len(x) // period
    return np.asarray(x[len(x) - whole * period :].reshape(whole, period, -1).mean(axis=0))


def _cross_spectra(experiments: Sequence[JointExperiment]) -> FrequencyResponse:
    rows = min(len(range(*e.rows.indices(len(e.u_V)))) for e in experiments)
    length = max(SHORTEST_SEGMENT, 2 ** int(np.log2(max(rows // SEGMENTS, 2))))
    if rows < 2 * length:
        raise BadInput(f"{rows} rows are too few for a frequency response; record at least {2 * SHORTEST_SEGMENT}")
    inputs, lines = experiments[0].u_V.shape[1], length // 2 + 1
    spectra = zip(*(_spectra(e, length) for e in experiments), strict=True)
    Suu, Sxu = (np.sum(of_experiments, axis=0)[:lines] for of_experiments in spectra)
    sizes = np.linalg.eigvalsh(Suu)
    keep = np.arange(1, int(WELCH_LINES * lines))
    keep = keep[sizes[keep, 0] > EXCITED**2 * float(np.median(np.sort(sizes[:, -1])[lines // 2 :]))]
    if len(keep) < 8 * inputs:
        raise BadInput("the records drive the axes always in the same proportion, or in too narrow a band")
    matrix = np.asarray(Sxu[keep] @ np.linalg.inv(Suu[keep]), dtype=complex)
    return FrequencyResponse(keep / (length * experiments[0].step_s), matrix, np.full(len(keep), np.nan), None)


def _spectra(e: JointExperiment, length: int) -> tuple[Complex, Complex]:
    """Two-sided spectra from half-overlapping segments of ``length`` rows.

    Of the voltages (lines, inputs, inputs), and between positions and voltages (lines, outputs, inputs). Experiments
    count by how many segments they have, not by how strong they are.
    """
    from scipy.signal import csd  # here, since it is slow to import and a fit of one axis does without

    u, x = e.u_V[e.rows] - e.u_V[e.rows].mean(axis=0), e.x_um[e.rows] - e.x_um[e.rows].mean(axis=0)
    segments = (len(u) - length) // (length // 2) + 1
    scale = float(np.mean(u**2)) or 1.0
    window = np.hanning(length)

    def spectrum(v: Samples) -> Complex:
        _, found = csd(
            u[:, None, :], v[:, :, None], window=window, nperseg=length, detrend=False, return_onesided=False, axis=0
        )
        return np.asarray(found * (segments / scale))

    return spectrum(u), spectrum(x)


def common_poles(
    response: FrequencyResponse,
    report: Callable[[float], None] | None = None,
    known: int = 0,
) -> Complex:
    """Poles (m,) in 1/s of the upper half plane, by rising frequency.

    ``known``: how many other records have shown; then only one start is tried, with as many modes or more.
    """
    starts = (max(known, STARTS[0]),) if known else STARTS
    s = np.asarray(2j * np.pi * response.f_Hz, dtype=np.complex128)
    elements = response.matrix.reshape(len(s), -1)
    best, least = np.zeros(0, dtype=complex), np.inf
    for i, count in enumerate(starts):
        if len(best) and 4 * count > len(s):
            break
        found = _usable(_vector_fit(s, elements, _first_poles(response.f_Hz, count)), response.f_Hz[-1])
        found = _pruned(s, elements, found)
        criterion = _criterion(s, elements, found)
        if report is not None:
            report((i + 1) / len(starts))
        if criterion < least:
            best, least = found, criterion
    return best


def _first_poles(f_Hz: Samples, count: int) -> Complex:
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
    """Poles moved from ``p`` to where all elements (lines, elements) have theirs."""
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
    kept = (np.abs(p) < 2 * np.pi * BEYOND * highest_Hz) & (zeta > DAMPED[0]) & (np.abs(p) > 0)
    damped = np.minimum(zeta[kept], DAMPED[1])
    size = np.abs(p[kept])
    if not (size > 2 * np.pi * OUTSIDE_BAND * highest_Hz).any():
        size, damped = np.append(size, 2 * np.pi * REST * highest_Hz), np.append(damped, REST_ZETA)
    modes = size * (-damped + 1j * np.sqrt(1 - damped**2))
    return np.asarray(modes[np.argsort(size)])


def _moments(s: Complex, elements: Complex, p: Complex) -> tuple[Samples, Samples]:
    """Real normal matrix (k, k) of the partial fractions and a constant, and their products (k, elements)."""
    columns = np.hstack([_basis(s, p), np.ones((len(s), 1))])
    columns = columns / np.linalg.norm(columns, axis=0)
    return (columns.conj().T @ columns).real, (columns.conj().T @ elements).real


def _criterion(s: Complex, elements: Complex, p: Complex) -> float:
    """Bayesian information criterion (BIC) of the best residues for these poles."""
    normal, products = _moments(s, elements, p)
    rows = 2 * elements.size
    squares = _squares(normal, products, float(np.linalg.norm(elements) ** 2))
    return float(rows * np.log(squares) + len(p) * _penalty(elements))


def _penalty(elements: Complex) -> float:
    """What one mode adds to the criterion: a pole and a residue in every element."""
    return float(np.log(2 * elements.size) * (2 + 2 * elements.shape[1]))


def _squares(normal: Samples, products: Samples, total: float) -> float:
    """What the best residues leave of the ``total`` squares of the elements."""
    ridge = normal + 1e-12 * np.eye(len(normal))
    explained = float(np.sum(products * np.linalg.solve(ridge, products)))
    return float(max(total - explained, 1e-12 * total))


def _pruned(s: Complex, elements: Complex, p: Complex) -> Complex:
    """The poles without those that the criterion (BIC) does not want, dropped one by one."""
    total = float(np.linalg.norm(elements) ** 2)
    normal, products = _moments(s, elements, p)
    rows = 2 * elements.size
    keep = list(range(len(p)))
    squares = _squares(normal, products, total)
    while len(keep) > 1:
        costs = []
        for r in keep:
            rest = np.array([i for q in keep if q != r for i in (2 * q, 2 * q + 1)] + [len(normal) - 1])
            costs.append(_squares(normal[np.ix_(rest, rest)], products[rest], total))
        cheapest = int(np.argmin(costs))
        if rows * np.log(costs[cheapest] / squares) > _penalty(elements):
            break
        squares = costs[cheapest]
        del keep[cheapest]
    return p[keep]
