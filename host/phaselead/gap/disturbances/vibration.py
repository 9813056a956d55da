"""Vibration: a peak in the spectrum of records at rest that was not there before."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram, welch
from scipy.stats import f as f_distribution

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Parts, Residuals
from phaselead.gap.disturbances.hum import is_mains
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import Estimate
from phaselead.record import Samples

Lines = NDArray[np.int64]
"""Numbers of lines of a spectrum, that of 0 Hz being 0."""

VIBRATION_SEGMENT = 1024
CHANCE_ANY_BAND = 1e-4
"""Probability, over all bands looked at, that training and held-out records at rest exceed by chance what is usual: the
reference, or without any the sides of the band."""
AROUND = 8
"""Lines to either side of a band that say what is usual there."""
LEAST_AROUND, LEAKS = 3, 2
"""Lines that a side needs to say what is usual, and lines by which a Hann window spreads a peak."""
WIDTHS = (1, 3, 7, 15)
"""Widths of the bands that are looked at, in lines of the spectrum."""
OFF_MAINS = 0.2
"""Share of what is new in a band. With less than this away from the mains and its multiples it is hum."""
SLOW_LINES = 4
"""Lowest lines of the spectrum, left out: what moves as slowly as the records are long is drift or creep."""


def find_vibration(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """A peak above the reference's spectrum, as the effect ``name``; None where there is none.

    Noise that is louder than the reference's as a whole is taken to be as loud first: most lines of the spectrum hold
    no peak. Without reference records it must stand above the spectrum to either side of it: noise that falls with the
    frequency stands above one of them.
    """
    louder = _louder(train, reference)
    train, holdout = _divided(train, louder), _divided(holdout, _louder(holdout, reference))
    spectra = _spectra(train, holdout, reference)
    live = np.array([not is_mains(float(f)) for f in spectra.f_Hz])
    live[:SLOW_LINES] = False
    band = _standing_out((train, holdout, reference), spectra, live)
    if band is None:
        return None
    low, high = band
    excess = np.maximum(spectra.seen - _usual(spectra, low, high), 0.0)
    if excess[low:high] @ live[low:high] < OFF_MAINS * excess[low:high].sum():
        return None
    return _vibration_found(name, spectra.f_Hz, louder * excess, low, high, spectra.averages)


def louder_at_rest(train: Residuals, holdout: Residuals, reference: Residuals) -> bool:
    """Whether any band of the records at rest stands above the reference, the mains included, whatever its cause."""
    now, again, was = ([residual for residual in part if residual.run.idle] for part in (train, holdout, reference))
    if not (now and again and was):
        return False
    idle = now, again, was
    spectra = _spectra(*idle)
    live = np.ones(len(spectra.f_Hz), dtype=bool)
    live[:SLOW_LINES] = False
    return _standing_out(idle, spectra, live) is not None


def _louder(part: Residuals, reference: Residuals) -> float:
    """Times by which the power of the noise is larger than the reference's in half of the lines; 1 where it is not, and
    without a reference."""
    if not reference:
        return 1.0
    length = _segment([*part, *reference])
    now, before = (_density(one, length)[1][SLOW_LINES:] for one in (part, reference))
    return max(1.0, float(np.median(now / np.maximum(before, 1e-300)))) if len(now) else 1.0


def _divided(part: Residuals, times: float) -> Residuals:
    """Residuals of so many times less power."""
    return [replace(residual, error_um=residual.error_um / np.sqrt(times)) for residual in part]


class _Spectra(NamedTuple):
    """One-sided densities (k,) in um^2/Hz of the training records and of the reference records, None without any, and
    how many independent periodograms the first averages."""

    f_Hz: Samples
    seen: Samples
    before: Samples | None
    averages: float

    def sides(self, low: int, high: int) -> tuple[Lines, Lines]:
        """The lines below and above a band that say what is usual there: the nearest that it does not leak into."""
        last = len(self.f_Hz)
        return np.arange(1, low - LEAKS)[-AROUND:], np.arange(high + LEAKS, last)[:AROUND]


def _spectra(train: Residuals, holdout: Residuals, reference: Residuals) -> _Spectra:
    length = _segment([*train, *holdout, *reference])
    f, seen, averages = _density(train, length)
    return _Spectra(f, seen, _density(reference, length)[1] if reference else None, averages)


def _segment(part: Residuals) -> int:
    """Rows of the pieces that a spectrum is averaged over."""
    return min(VIBRATION_SEGMENT, min(len(residual.error_um) for residual in part) // 4)


def _usual(spectra: _Spectra, low: int, high: int) -> Samples | float:
    """Density that is usual, looked at from a band: that of the reference (k,), or that of the louder of its sides."""
    if spectra.before is not None:
        return spectra.before
    sides = spectra.sides(low, high)
    if min(map(len, sides)) < LEAST_AROUND:
        return np.inf
    return max(float(np.median(spectra.seen[side])) for side in sides)


def _standing_out(parts: Parts, spectra: _Spectra, live: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and last line (excluded) of the most significant new band among the ``live`` lines; None without one."""
    bands, looked = _new_bands(spectra, live)
    found = [(p, band) for band in bands if (p := _newness(band, spectra, parts)) * looked <= CHANCE_ANY_BAND]
    return min(found)[1] if found else None


def _newness(band: tuple[int, int], spectra: _Spectra, parts: Parts) -> float:
    """Probability that the records at rest exceed what is usual in this band by chance; 1 where training and held-out
    records do not both exceed it."""
    (train, holdout, reference), (low, high) = parts, band
    every, step_Hz, lines = [*train, *holdout], float(spectra.f_Hz[1]), np.arange(low, high)
    new, again, both = (_band_power(part, lines, step_Hz) for part in (train, holdout, every))
    if reference:
        # A narrow band holds few lines of the reference; its neighbours say as well what is usual there.
        around = np.arange(max(low - AROUND, 0), high + AROUND)
        usual = [_band_power(reference, where, step_Hz) for where in (around, lines)]
    else:
        sides = spectra.sides(low, high)
        if min(map(len, sides)) < LEAST_AROUND:
            return 1.0
        usual = [_band_power(every, side, step_Hz) for side in sides]
    chances = [float(f_distribution.sf(both[0] / one[0], both[1], one[1])) for one in usual]
    loudest = max(one[0] for one in usual)
    if min(new[0], again[0]) < NEW_FROM * loudest:
        return 1.0
    if not reference:
        return max(chances)
    return chances[0] if chances[1] <= ERROR_RATE else 1.0


def _new_bands(spectra: _Spectra, live: NDArray[np.bool_]) -> tuple[list[tuple[int, int]], int]:
    """For each width the band with the largest ratio to what is usual, as first and last line (excluded), and how many
    were compared."""
    bands, looked = [], 0
    for width in (one for one in WIDTHS if one <= len(spectra.f_Hz)):
        new, lines = (np.convolve(one, np.ones(width), "valid") for one in (spectra.seen * live, live))
        if spectra.before is not None:
            old = np.convolve(spectra.before * live, np.ones(width), "valid")
        else:
            old = np.array([_usual(spectra, i, i + width) for i in range(len(new))])
            old = np.multiply(lines, old, out=np.zeros_like(new), where=lines > 0)
        ratio = np.divide(new, old, out=np.zeros_like(new), where=old > 0)
        bands.append((int(np.argmax(ratio)), int(np.argmax(ratio)) + width))
        looked += len(ratio)
    return bands, looked


def _band_power(part: Residuals, lines: Lines, step_Hz: float) -> tuple[float, float]:
    """Mean density in some lines, ``step_Hz`` apart, and its degrees of freedom: twice the number of lines, at full
    resolution, that carry it.

    A mode that the surroundings keep ringing fills few lines, however many segments a record is cut into.
    """
    density, freedom = [], 0.0
    for residual in part:
        f, p = periodogram(residual.error_um, residual.rate_Hz, window="hann", detrend="linear")
        inside = p[np.isin(np.floor(f / step_Hz + 0.5).astype(int), lines)]
        density.append(float(inside.mean()))
        freedom += 2 * float(inside.sum() ** 2 / max(float((inside**2).sum()), 1e-300))
    return (float(np.mean(density)), freedom) if density else (0.0, 0.0)


def _vibration_found(name: str, f: Samples, excess: Samples, low: int, high: int, averages: float) -> Disturbance:
    step = float(f[1] - f[0])
    top = low + int(np.argmax(excess[low:high]))
    width = (high - low) * step
    rms = float(np.sqrt(excess[max(low - 2, 1) : high + 2].sum() * step))
    error = 2 / np.sqrt(averages)
    params: dict[str, Estimate] = {
        "rms_um": (rms, "um", (rms * max(1 - error, 0.0), rms * (1 + error))),
        "f_Hz": (float(f[top]), "Hz", (float(f[low]) - step, float(f[high - 1]) + step)),
        "bandwidth_Hz": (width, "Hz", (0.3 * width, 3 * width)),
    }
    return Disturbance(name, params, rms**2, f"a peak of {1e3 * rms:.3g} nm rms at {f[top]:.4g} Hz in records at rest")


def _density(part: Residuals, length: int) -> tuple[Samples, Samples, float]:
    """Frequencies (k,), mean one-sided density (k,) and how many independent periodograms it averages."""
    spectra = [welch(residual.error_um, residual.rate_Hz, nperseg=length, detrend="linear") for residual in part]
    averages = sum(1.6 * len(residual.error_um) / length for residual in part)
    return spectra[0][0], np.mean([s for _, s in spectra], axis=0), float(averages)
