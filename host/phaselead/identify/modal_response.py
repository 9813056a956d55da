"""The frequency response matrix of a stage whose axes are driven together, from the records of several experiments.

Steady periods of multisines give it line by line (Pintelon and Schoukens 2012, section 2.7: as many experiments as
inputs, orthogonal or not); anything else by cross-spectra (H1 estimate).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput

Samples = NDArray[np.float64]
Complex = NDArray[np.complex128]

REPEATS = 0.02
"""A drive whose periods differ by less than this share of their rms repeats."""
EXCITED = 0.05
"""A line counts as excited where the weakest direction of the drive has this share of a strong line's amplitude."""
SEGMENTS = 8
SHORTEST_SEGMENT = 256
WELCH_LINES = 0.9
"""Of the Nyquist frequency, as far as cross-spectra are used."""


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
    """Estimate it. Raises BadInput when the drives do not tell the inputs apart."""
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
    left = float(np.mean((u[period:] - u[:-period]) ** 2))
    return period if left < REPEATS**2 * power else None


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
    left = np.abs(X - matrix @ U) ** 2
    free = count - inputs
    spread = np.mean(np.linalg.norm(np.linalg.pinv(U), axis=1) ** 2, axis=1)
    variance = left.sum(axis=2).mean(axis=1) / free * spread if free else np.full(len(lines), np.nan)
    return FrequencyResponse(lines / (period * experiments[0].step_s), matrix, variance, period)


def _mean_period(x: Samples, period: int) -> Samples:
    whole = len(x) // period
    return np.asarray(x[len(x) - whole * period :].reshape(whole, period, -1).mean(axis=0))


def _cross_spectra(experiments: Sequence[JointExperiment]) -> FrequencyResponse:
    rows = min(len(range(*e.rows.indices(len(e.u_V)))) for e in experiments)
    length = max(SHORTEST_SEGMENT, 2 ** int(np.log2(max(rows // SEGMENTS, 2))))
    if rows < 2 * length:
        raise BadInput(f"{rows} rows are too few for a frequency response; record at least {2 * SHORTEST_SEGMENT}")
    inputs, outputs = experiments[0].u_V.shape[1], experiments[0].x_um.shape[1]
    lines = length // 2 + 1
    Suu = np.zeros((lines, inputs, inputs), dtype=complex)
    Sxu = np.zeros((lines, outputs, inputs), dtype=complex)
    window = np.hanning(length)[:, None]
    for e in experiments:
        u, x = e.u_V[e.rows] - e.u_V[e.rows].mean(axis=0), e.x_um[e.rows] - e.x_um[e.rows].mean(axis=0)
        scale = float(np.sqrt(np.mean(u**2))) or 1.0
        for at in range(0, len(u) - length + 1, length // 2):
            U, X = (np.fft.rfft(window * v[at : at + length], axis=0) / scale for v in (u, x))
            Suu += U[:, :, None] * U[:, None, :].conj()
            Sxu += X[:, :, None] * U[:, None, :].conj()
    sizes = np.linalg.eigvalsh(Suu)
    keep = np.arange(1, int(WELCH_LINES * lines))
    keep = keep[sizes[keep, 0] > EXCITED**2 * float(np.median(np.sort(sizes[:, -1])[lines // 2 :]))]
    if len(keep) < 8 * inputs:
        raise BadInput("the records drive the axes always in the same proportion, or in too narrow a band")
    matrix = np.asarray(Sxu[keep] @ np.linalg.inv(Suu[keep]), dtype=complex)
    return FrequencyResponse(keep / (length * experiments[0].step_s), matrix, np.full(len(keep), np.nan), None)
