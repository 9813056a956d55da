"""Vibration: a peak in the spectrum of records at rest that was not there before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import periodogram, welch
from scipy.stats import f as f_distribution

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Parts, Residuals
from phaselead.gap.disturbances.hum import is_mains
from phaselead.gap.findings import Estimate
from phaselead.record import Samples

VIBRATION_SEGMENT = 1024
CHANCE_ANY_BAND = 1e-4
"""Probability, over all bands looked at, that training and held-out records at rest exceed the reference by chance."""
CHANCE_THIS_BAND, AROUND = 0.01, 8
"""The same probability in the band found alone, and the lines to either side of it that say what is usual there."""
WIDTHS = (1, 3, 7, 15)
"""Widths of the bands that are looked at, in lines of the spectrum."""
OFF_MAINS = 0.2
"""Share of what is new in a band. With less than this away from the mains and its multiples it is hum."""
SLOW_LINES = 4
"""Lowest lines of the spectrum, left out: what moves as slowly as the records are long is drift or creep."""


def find_vibration(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """A peak above the reference's spectrum, as the effect ``name``; None where there is none.

    Without reference records it must stand above the spectrum around it.
    """
    spectra = _spectra(train, holdout, reference)
    live = np.array([not is_mains(float(v)) for v in spectra.f_Hz])
    live[:SLOW_LINES] = False
    band = _standing_out((train, holdout, reference), spectra, live)
    if band is None:
        return None
    low, high = band
    new = np.maximum(spectra.seen - spectra.before, 0.0)
    if new[low:high] @ live[low:high] < OFF_MAINS * new[low:high].sum():
        return None
    return _vibration_found(name, spectra.f_Hz, spectra.seen - spectra.before, low, high, spectra.averages)


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


class _Spectra(NamedTuple):
    """One-sided densities (k,) in um^2/Hz of the training records and of what was there before, and how many
    independent periodograms the first averages."""

    f_Hz: Samples
    seen: Samples
    before: Samples
    averages: float


def _spectra(train: Residuals, holdout: Residuals, reference: Residuals) -> _Spectra:
    shortest = min(len(residual.error_um) for residual in [*train, *holdout, *reference])
    length = min(VIBRATION_SEGMENT, shortest // 4)
    f, seen, averages = _density(train, length)
    before = _density(reference, length)[1] if reference else median_filter(seen, size=41, mode="nearest") / 0.97
    return _Spectra(f, seen, before, averages)


def _standing_out(parts: Parts, spectra: _Spectra, live: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and last line (excluded) of the most significant new band among the ``live`` lines; None without one."""
    f, seen, before, _ = spectra
    bands, looked = _new_bands(seen * live, before * live)
    found = [(p, band) for band in bands if (p := _newness(band, f, parts, before)) * looked <= CHANCE_ANY_BAND]
    return min(found)[1] if found else None


def _newness(band: tuple[int, int], f: Samples, parts: Parts, before: Samples) -> float:
    """Probability that the records at rest exceed the reference in this band by chance; 1 where training and held-out
    records do not both exceed it."""
    (train, holdout, reference), (low, high) = parts, band
    edges_Hz = float(f[low] - f[1] / 2), float(f[high - 1] + f[1] / 2)
    new, again, both, old = (_band_power(part, *edges_Hz) for part in (train, holdout, [*train, *holdout], reference))
    around = _band_power(reference, edges_Hz[0] - AROUND * f[1], edges_Hz[1] + AROUND * f[1])
    if not reference:
        old = around = float(before[low:high].mean()), np.inf
    # A narrow band holds few lines of the reference; its neighbours say as well what is usual there.
    p, p_here = (float(f_distribution.sf(both[0] / part[0], both[1], min(part[1], 1e6))) for part in (around, old))
    return p if p_here <= CHANCE_THIS_BAND and min(new[0], again[0]) >= NEW_FROM * max(old[0], around[0]) else 1.0


def _new_bands(seen: Samples, before: Samples) -> tuple[list[tuple[int, int]], int]:
    """For each width the band with the largest ratio, as first and last line (excluded), and how many were compared."""
    bands, looked = [], 0
    for width in WIDTHS:
        box = np.ones(width)
        new, old = np.convolve(seen, box, "valid"), np.convolve(before, box, "valid")
        ratio = np.divide(new, old, out=np.zeros_like(new), where=old > 0)
        bands.append((int(np.argmax(ratio)), int(np.argmax(ratio)) + width))
        looked += len(ratio)
    return bands, looked


def _band_power(part: Residuals, low_Hz: float, high_Hz: float) -> tuple[float, float]:
    """Mean density in a band and its degrees of freedom: twice the number of lines, at full resolution, that carry it.

    A mode that the surroundings keep ringing fills few lines, however many segments a record is cut into.
    """
    density, freedom = [], 0.0
    for residual in part:
        f, p = periodogram(residual.error_um, residual.rate_Hz, window="hann", detrend="linear")
        inside = p[(f >= low_Hz) & (f < high_Hz)]
        density.append(float(inside.mean()))
        freedom += 2 * float(inside.sum() ** 2 / max(float((inside**2).sum()), 1e-300))
    return (float(np.mean(density)), freedom) if density else (0.0, 0.0)


def _vibration_found(name: str, f: Samples, excess: Samples, low: int, high: int, averages: float) -> Disturbance:
    step, excess = float(f[1] - f[0]), np.maximum(excess, 0.0)
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
