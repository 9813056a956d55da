"""The frequency response of one axis from records of any kind, and the modes that it shows.

Without feedback the voltage holds no noise, so the ratio of cross spectrum to drive spectrum is unbiased (H1 estimate;
Bendat and Piersol 2010, section 6.1), whatever the waveform; under feedback the path that was followed takes its place
in both. A line counts by how far the drive there stands above what is left of the position. Hysteresis answers small
and fast motion with an almost constant complex gain; so the response is

    H(f) = e^(-2 pi j f lag) (a0 + j a1 + sum_i (c_i + j b_i) R_i(f))
    R(f) = w^2 / (w^2 - (2 pi f)^2 + 2 j zeta w 2 pi f)

which is linear in all but lag, frequencies and dampings. Operator, modes and delay are then fitted together in time;
what is found here is where that starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from phaselead.identify.runs import AxisRun, white_noise_rms
from phaselead.model import Complex, Mode
from phaselead.record import Samples

Lines = TypeVar("Lines", Samples, Complex)

WINDOWS, SHORTEST_WINDOW, LONGEST_WINDOW = 6, 256, 16384
"""A record is cut into about so many half-overlapping windows, of so many rows."""
MISFIT = 0.05
"""Of the response: hysteresis answers small and large motion with gains that differ by this much and more."""
CLEAR = 0.3
"""Relative standard error of the response up to which a line is used."""
FEWEST_WINDOWS = 4
"""Of a run whose own windows say how much is left of it: one window is met exactly, so that nothing seems left."""
SMOOTH_LINES = 9
"""Over which the spectrum of what is left is smoothed."""
FEWEST_LINES = 24
"""Of a response that shows a mode."""
LOWEST_OF_BAND = 3.0
"""A mode lies at least this factor above the lowest line: below it is the band that tells the gain without it."""
GAP, GAP_LINES = 0.5, 8
"""Between clear lines, in shares of the lower one's frequency or in distances of the closest two: a mode anywhere
between f and 1.5 f raises the response at f to 1.8 and more."""
MOST_MODES = 4
TRIED_PER_DECADE = 80
TRIED_ZETAS = (0.006, 0.02, 0.08, 0.25)
ZETA = (0.002, 0.6)
"""Range of damping: one at either end stands for a single line, or for how hysteresis changes with frequency."""
INSIDE = 0.02
"""Of the logarithms of frequency and damping: a mode closer than this to an end is at it."""
LAG_TURNS, LAG_STEPS = 30, 8
"""Lags tried: up to so many periods of the last line, by so many parts of one."""
PAYS = 0.8
"""One more mode leaves less than this share of the weighted squares."""
MOST_STEPS = 30
"""Of one search."""


@dataclass(frozen=True)
class MeasuredResponse:
    """``value`` (lines,) in um/V at ``f_Hz`` (lines,), rising, and the standard error ``std`` of each."""

    f_Hz: Samples
    value: Complex
    std: Samples

    @property
    def broadband(self) -> bool:
        """Whether it spans enough to show more than a gain."""
        return len(self.f_Hz) >= FEWEST_LINES and float(self.f_Hz[-1]) >= LOWEST_OF_BAND * float(self.f_Hz[0])

    @property
    def unbroken(self) -> MeasuredResponse:
        """From its lowest line on up to the first gap wide enough for a mode to hide in: a clear line far above the
        others may be so by chance, or be a harmonic of the one that is driven."""
        if len(self.f_Hz) < 2:
            return self
        wide = np.maximum(GAP * self.f_Hz[:-1], GAP_LINES * np.diff(self.f_Hz).min())
        gaps = np.flatnonzero(np.diff(self.f_Hz) > wide)
        end = gaps[0] + 1 if len(gaps) else len(self.f_Hz)
        return MeasuredResponse(self.f_Hz[:end], self.value[:end], self.std[:end])

    @property
    def weight(self) -> Samples:
        return np.asarray(1 / np.hypot(self.std, MISFIT * np.abs(self.value)))


def measured_response(runs: Sequence[AxisRun]) -> MeasuredResponse:
    """Over all runs, at the lines where the drive stands out; no lines where it does nowhere.

    A run counts by what is left of it: what hysteresis leaves of a large slow one hides no small quick one. Runs of too
    few windows to know that are taken together.

    Where a path was asked for, the voltage counts as far as it goes with that, and at lines where the path stands out
    of the sensor's noise: feedback puts noise into the voltage too, which is no drive (instrumental variables,
    Soderstrom and Stoica 1983).
    """
    length = _window_rows(runs)
    spectra = [_spectra(run, length) for run in runs]
    groups = [one for one in spectra if one.shape[1] >= FEWEST_WINDOWS]
    for asked in (False, True):  # a path is in um, a voltage in V
        pairs = zip(runs, spectra, strict=True)
        short = [one for run, one in pairs if one.shape[1] < FEWEST_WINDOWS and (run.r_um is not None) == asked]
        if short:
            groups.append(np.concatenate(short, axis=1))
    values, variances = (np.array(v) for v in zip(*(_response_of(group) for group in groups), strict=True))
    weights = 1 / np.maximum(variances, 1e-300)
    driven = np.isfinite(variances).any(axis=0)
    weight = np.where(driven, weights.sum(axis=0), 1.0)
    value = (weights * values).sum(axis=0) / weight
    apart = (weights * np.abs(values - value) ** 2).sum(axis=0) / max(len(groups) - 1, 1)
    std = np.sqrt(np.maximum(apart, 1.0) / weight)
    f_Hz = np.fft.rfftfreq(length, runs[0].step_s)
    use = driven & (std < CLEAR * np.abs(value)) & (f_Hz > 0)
    return MeasuredResponse(f_Hz[use], value[use], std[use])


def _response_of(spectra: NDArray[np.complex128]) -> tuple[Complex, Samples]:
    """The response (lines,) and its variance, infinite where nothing is driven, from windows (3, windows, lines) of
    instrument, voltage and position."""
    w, u, x = spectra
    ww, uw, xw, xx = (np.sum(a * b.conj(), axis=0) for a, b in ((w, w), (u, w), (x, w), (x, x)))
    driven = np.abs(uw) > 0
    value, variance = np.zeros(len(uw), dtype=complex), np.full(len(uw), np.inf)
    value[driven] = xw[driven] / uw[driven]
    windows = np.where(driven, ww.real**2 / np.maximum(np.sum(np.abs(w) ** 4, axis=0), 1e-300), 1.0)
    left = np.sum(np.abs(x - value * u) ** 2, axis=0) / np.maximum(1 - 1 / windows, 0.2)
    if u.shape[0] < FEWEST_WINDOWS:  # what is left of a line is told by its neighbours
        left = _smoothed(xx.real) - np.abs(_smoothed(xw)) ** 2 / np.maximum(_smoothed(ww.real), 1e-300)
    drive = np.abs(uw[driven]) ** 2 / ww.real[driven]  # the power of the voltage that goes with the instrument
    variance[driven] = _smoothed(left)[driven] / (drive * windows[driven])
    return value, variance


def _window_rows(runs: Sequence[AxisRun]) -> int:
    rows = max(len(run.u_V) for run in runs)
    return int(np.clip(2 ** int(np.log2(max(2 * rows / (WINDOWS + 1), 2))), SHORTEST_WINDOW, LONGEST_WINDOW))


def _spectra(run: AxisRun, length: int) -> NDArray[np.complex128]:
    """(3, windows, lines) of the differences, in which slow motion does not leak into fast, of the path that was asked
    for, else of the voltage, and of voltage and position."""
    asked = run.u_V if run.r_um is None else run.r_um
    each = np.diff(np.stack([asked, run.u_V, run.x_um]), axis=1)
    if each.shape[1] < length:
        each = np.pad(each, ((0, 0), (0, length - each.shape[1])))
    parts = np.lib.stride_tricks.sliding_window_view(each, length, axis=1)[:, :: length // 2]
    window = np.hanning(length + 1)[:-1]
    spectra = np.asarray(np.fft.rfft(parts * window, axis=2))
    if run.r_um is not None:
        turn = np.sin(np.pi * np.fft.rfftfreq(length))
        noise_um = white_noise_rms(run.x_um) * 2 * turn * np.sqrt(np.sum(window**2))
        spectra[0] = np.where(CLEAR * np.abs(spectra[0]) > noise_um, spectra[0], 0.0)
    return spectra


def _smoothed(values: Lines) -> Lines:
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, SMOOTH_LINES // 2, mode="edge"), SMOOTH_LINES)
    return np.asarray(around.mean(axis=1))


@dataclass(frozen=True)
class ShownModes:
    """Modes by rising frequency with their shares of the static response, and the ``lag_s`` of all else."""

    modes: tuple[Mode, ...]
    lag_s: float


def modes_shown(response: MeasuredResponse) -> ShownModes:
    """As many modes as pay, and as the response is known well enough to want. None where it shows none."""
    f_Hz = response.f_Hz
    if not response.broadband:
        return ShownModes((), 0.0)
    tried = np.arange(LAG_TURNS * LAG_STEPS) / (LAG_STEPS * f_Hz[-1])
    place = min((np.array([lag_s * f_Hz[-1]]) for lag_s in tried), key=lambda one: _squares(response, one))
    place = _refined(response, place)
    squares = _squares(response, place)
    for _ in range(MOST_MODES):
        if squares < len(f_Hz):
            break
        more = _refined(response, np.concatenate([place, _next(response, place)]))
        now = _squares(response, more)
        if now > PAYS * squares:
            break
        place, squares = more, now
    return ShownModes(_modes(response, place), float(place[0]) / f_Hz[-1])


def _columns(f_Hz: Samples, place: Samples) -> Complex:
    """(lines, 2 + 2m) for ``place`` (1 + 2m,): lag in periods of the last line, log f_Hz and log zeta of every mode."""
    s = 2j * np.pi * f_Hz
    late = np.exp(-s * place[0] / f_Hz[-1])
    columns = [late, 1j * late]
    for log_f, log_zeta in place[1:].reshape(-1, 2):
        w, zeta = 2 * np.pi * np.exp(log_f), np.exp(log_zeta)
        answer = late * w * w / (s * s + 2 * zeta * w * s + w * w)
        columns += [answer, 1j * answer]
    return np.stack(columns, axis=1)


def _solved(response: MeasuredResponse, place: Samples) -> tuple[Samples, Samples]:
    """Coefficients (2 + 2m,) and the weighted residual (2 lines,)."""
    weighed = _columns(response.f_Hz, place) * response.weight[:, None]
    target = response.value * response.weight
    matrix, right = np.concatenate([weighed.real, weighed.imag]), np.concatenate([target.real, target.imag])
    scale = np.linalg.norm(matrix, axis=0)
    coefficients = np.linalg.lstsq(matrix / scale, right, rcond=1e-9)[0]
    return coefficients / scale, np.asarray(right - matrix / scale @ coefficients)


def _squares(response: MeasuredResponse, place: Samples) -> float:
    return float(np.sum(_solved(response, place)[1] ** 2))


def _next(response: MeasuredResponse, place: Samples) -> Samples:
    """Where one more mode leaves least, of a grid over the lines."""
    low, high = _band_Hz(response)
    count = max(round(TRIED_PER_DECADE * np.log10(high / low)), 2)
    tried = product(np.linspace(np.log(low), np.log(high), count), np.log(TRIED_ZETAS))
    return np.array(min(tried, key=lambda one: _squares(response, np.concatenate([place, one]))))


def _band_Hz(response: MeasuredResponse) -> tuple[float, float]:
    return LOWEST_OF_BAND * float(response.f_Hz[0]), float(response.f_Hz[-1])


def _bounds(response: MeasuredResponse, count: int) -> tuple[Samples, Samples]:
    band = np.log(_band_Hz(response))
    low, high = ([edge, np.log(zeta)] for edge, zeta in zip(band, ZETA, strict=True))
    return np.array([0.0, *low * count]), np.array([float(LAG_TURNS), *high * count])


def _refined(response: MeasuredResponse, place: Samples) -> Samples:
    low, high = _bounds(response, len(place) // 2)
    start = np.clip(place, low + 1e-9, high - 1e-9)
    found = least_squares(lambda p: _solved(response, p)[1], start, bounds=(low, high), max_nfev=MOST_STEPS)
    return np.asarray(found.x)


def _modes(response: MeasuredResponse, place: Samples) -> tuple[Mode, ...]:
    """Those that do not stand for the edge of the band, a single line or hysteresis."""
    coefficients, _ = _solved(response, place)
    shares = coefficients[2::2] / (coefficients[0] + coefficients[2::2].sum())
    low, high = _bounds(response, 1)
    modes = [
        (float(c), float(np.exp(at[0])), float(np.exp(at[1])))
        for c, at in zip(shares, place[1:].reshape(-1, 2), strict=True)
        if (low[1:] + INSIDE < at).all() and (at < high[1:] - INSIDE).all()
    ]
    return tuple(sorted(modes, key=lambda mode: mode[1]))
