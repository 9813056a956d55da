"""Vibration: a peak in the spectrum of records at rest that was not there before."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram, welch
from scipy.stats import f as f_distribution

from phaselead.gap.disturbances.disturbance import NEW_FROM, Disturbance, Residuals
from phaselead.gap.disturbances.hum import is_mains
from phaselead.gap.disturbances.peak import LEAST_DENSITY, fitted_peak
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.model import Effect, catalogue
from phaselead.record import Samples

Parts = tuple[Residuals, Residuals, Residuals]
"""Residuals of training, held-out and reference records."""
Lines = NDArray[np.int64]
"""Numbers of lines of a spectrum, that of 0 Hz being 0."""

VIBRATION_SEGMENT = 1024
CHANCE_ANY_BAND = 1e-4
"""Probability, over all bands looked at, that training and held-out records at rest exceed by chance what is usual: the
reference, or without any the sides of the band."""
AROUND = 8
"""Lines to either side of a band that say what is usual there."""
BROADEST = 0.765
"""Bandwidth over frequency above which a spring and mass shows half the density of its peak down to 0 Hz: no peak."""
SIDES = 4.0
"""Times the frequencies of a band by which the noise to its sides reaches that a peak is fitted with: two octaves."""
LEAST_AROUND, LEAKS = 3, 2
"""Lines that a side needs to say what is usual, and lines by which a Hann window spreads a peak."""
WIDTHS = (1, 3, 7, 15)
"""Widths of the bands that are looked at, in lines of the spectrum."""
OFF_MAINS = 0.2
"""Share of what is new in a band. With less than this away from the mains and its multiples it is hum."""
SLOW_LINES = 4
"""Lowest lines of the spectrum, left out: what moves as slowly as the pieces of ``VIBRATION_SEGMENT`` rows that it is
averaged over is drift or creep. They end at 20 Hz of records at 5 kHz."""


def find_vibration(name: str, train: Residuals, holdout: Residuals, reference: Residuals) -> Disturbance | None:
    """A peak above the reference's spectrum, as the effect ``name``; None where there is none.

    Noise that is louder than the reference's as a whole is taken to be as loud first: most lines of the spectrum hold
    no peak. Without reference records it must stand above the spectrum to either side of it: noise that falls with the
    frequency stands above one of them.
    """
    train, holdout, reference = _long_enough(train, holdout, reference)
    times = [_louder(part, reference) for part in (train, holdout)]
    even = _divided(train, times[0]), _divided(holdout, times[1]), reference
    spectra = _spectra(*even)
    live = np.array([not is_mains(float(f)) for f in spectra.f_Hz])
    live[:SLOW_LINES] = False
    band = _standing_out(even, spectra, live)
    if band is None:
        return None
    usual = np.broadcast_to(_usual(spectra, *band), spectra.f_Hz.shape)
    excess, inside = np.zeros_like(spectra.seen), slice(*band)
    excess[inside] = np.maximum(spectra.seen[inside] - usual[inside], 0.0)
    if excess @ live < OFF_MAINS * excess.sum():
        return None
    return _vibration_found(
        catalogue()[name], list(zip((train, holdout), times, strict=True)), spectra.f_Hz, usual, band, times[0] * excess
    )


def louder_at_rest(train: Residuals, holdout: Residuals, reference: Residuals) -> bool:
    """Whether any band of the records at rest stands above the reference, the mains included, whatever its cause."""
    now, again, was = ([residual for residual in part if residual.run.idle] for part in (train, holdout, reference))
    if not (now and again and was):
        return False
    idle = _long_enough(now, again, was)
    spectra = _spectra(*idle)
    live = np.ones(len(spectra.f_Hz), dtype=bool)
    live[:SLOW_LINES] = False
    return _standing_out(idle, spectra, live) is not None


def _long_enough(*parts: Residuals) -> Parts:
    """The records that are long enough for the finest spectra that every role can give, or for those that are needed;
    half of that will do. One short record would coarsen all of them."""
    longest = [max(len(residual.error_um) for residual in part) for part in parts if part]
    rows = min(4 * VIBRATION_SEGMENT, *longest) / 2
    train, holdout, reference = ([r for r in part if len(r.error_um) >= rows] for part in parts)
    return train, holdout, reference


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
    """One-sided densities (k,) in um^2/Hz of the training records and of the reference records, None without any."""

    f_Hz: Samples
    seen: Samples
    before: Samples | None

    def sides(self, low: int, high: int) -> tuple[Lines, Lines]:
        """The lines below and above a band that say what is usual there: the nearest that it does not leak into."""
        last = len(self.f_Hz)
        return np.arange(1, low - LEAKS)[-AROUND:], np.arange(high + LEAKS, last)[:AROUND]


def _spectra(train: Residuals, holdout: Residuals, reference: Residuals) -> _Spectra:
    length = _segment([*train, *holdout, *reference])
    f, seen = _density(train, length)
    return _Spectra(f, seen, _density(reference, length)[1] if reference else None)


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
        around = np.arange(max(low - AROUND, SLOW_LINES), high + AROUND)
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
    """For each width the band with the largest ratio to what is usual, as first and last line (excluded) without the
    lines that are left out as slow, and how many were compared."""
    bands, looked = [], 0
    for width in (one for one in WIDTHS if one <= len(spectra.f_Hz)):
        new, lines = (np.convolve(one, np.ones(width), "valid") for one in (spectra.seen * live, live))
        if spectra.before is not None:
            old = np.convolve(spectra.before * live, np.ones(width), "valid")
        else:
            old = np.array([_usual(spectra, i, i + width) for i in range(len(new))])
            old = np.multiply(lines, old, out=np.zeros_like(new), where=lines > 0)
        ratio = np.divide(new, old, out=np.zeros_like(new), where=old > 0)
        first = int(np.argmax(ratio))
        if first + width > SLOW_LINES:
            bands.append((max(first, SLOW_LINES), first + width))
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
        inside = np.maximum(inside, LEAST_DENSITY)
        density.append(float(inside.mean()))
        freedom += 2 * float(inside.sum() ** 2 / (inside**2).sum())
    return float(np.mean(density)), freedom


def _vibration_found(
    effect: Effect,
    shaken: Sequence[tuple[Residuals, float]],
    f_Hz: Samples,
    usual: Samples,
    band: tuple[int, int],
    excess: Samples,
) -> Disturbance | None:
    """The vibration whose peak stands in a band; None where noise of another level and slope describes the records as
    well, and of a peak that may lie beyond the lines that were looked at, between two others, or is too broad for one.

    ``shaken``: the records, and times by which the power of their noise is larger than is ``usual`` (k,), at
    frequencies ``f_Hz`` (k,); ``excess``: density (k,) above that.
    """
    low, high, last = band[0], band[1] - 1, len(f_Hz) - 1
    slowest, beside = SLOW_LINES - LEAKS, LEAKS + band[1] - band[0]
    near_Hz = float(f_Hz[max(low - beside, slowest)]), float(f_Hz[min(high + beside, last)])
    sides_Hz = max(float(f_Hz[low]) / SIDES, float(f_Hz[slowest])), min(SIDES * float(f_Hz[high]), float(f_Hz[last]))
    if effect.parameter("f_Hz").high <= near_Hz[0]:
        return None
    parts = [(part, partial(_times_usual, times, f_Hz, usual)) for part, times in shaken]
    start = (
        math.sqrt(float(excess.sum()) * float(f_Hz[1])),
        float(f_Hz[np.argmax(excess)]),
        (high + 1 - low) * float(f_Hz[1]),
    )
    peak = fitted_peak(effect, parts, near_Hz, sides_Hz, start)
    if not peak.told:  # it is far broader than the band
        peak = fitted_peak(effect, parts, sides_Hz, sides_Hz, start)
    rms_um, at_Hz, bandwidth_Hz = (peak.params[one][0] for one in ("rms_um", "f_Hz", "bandwidth_Hz"))
    there = peak.chance <= CHANCE_ANY_BAND and peak.told and peak.filled > ERROR_RATE
    if not there or bandwidth_Hz > BROADEST * at_Hz:
        return None
    why = f"a peak of {1e3 * rms_um:.3g} nm rms at {at_Hz:.4g} Hz in records at rest"
    return Disturbance(effect.name, peak.params, rms_um**2, why)


def _times_usual(times: float, f_Hz: Samples, usual: Samples, at_Hz: Samples) -> Samples:
    """The usual density (k,), so many times, at other frequencies (n,)."""
    return times * np.interp(at_Hz, f_Hz, usual)


def _density(part: Residuals, length: int) -> tuple[Samples, Samples]:
    """Frequencies (k,) and mean one-sided density (k,)."""
    spectra = [welch(residual.error_um, residual.rate_Hz, nperseg=length, detrend="linear") for residual in part]
    return spectra[0][0], np.maximum(np.mean([s for _, s in spectra], axis=0), LEAST_DENSITY)
