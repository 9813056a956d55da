"""What no voltage predicts: hum, vibration, quantisation and jitter, found in spectra and likelihoods.

Each is looked for in the training residual, must be found again in the held-out one, and must be more than the
reference records show. Idle records are asked where there are any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import periodogram, welch
from scipy.stats import chi2, norm
from scipy.stats import f as f_distribution

from phaselead.gap.records import Run
from phaselead.gap.result import Value
from phaselead.record.recording import Samples

MAINS_Hz = (50.0, 60.0)
WITHIN_Hz = 0.2
SURE, AGAIN = 1e-6, 1e-3
MORE = 1.5
"""Times the reference's amplitude (or step) from which something is new."""
BESIDE_Hz = 6.0
SEGMENT = 1024
SURE_BAND = 1e-4
"""Over all bands looked at: training and held-out records at rest together against the reference's."""
SURE_HERE, AROUND = 0.01, 8
"""The same in the band found alone; lines to either side of it that say what is usual."""
WIDTHS = (1, 3, 7, 15)
"""Lines of a spectrum over which something new may spread."""
LATEST = 0.05
"""Of the sampling step: a clock that is off by more is no clock, and what grows with speed is a fault of the model."""
SEEN_Z, UNALIKE, TELLING = 2.0, 2.5, 0.05
"""From where the reference's own slope counts; the factor by which a record's slope may be off where what it says is
more than the last share of the record's whole residual."""
SHORTEST, BLOCK_ROWS = 256, 64
ROUGH = 5
"""Differences that are taken to be rid of what a model misses of its modes."""
JUMP_SHARE, AFTER_JUMP_ROWS = 0.02, 40
"""Of the voltage's range, in one row; and for how long a fast mode rings."""
BESIDE_MAINS = 0.2
"""Of what is new in a band: with less of it away from the mains and its multiples it is hum, not vibration."""
SLOW_LINES = 4
"""Of a spectrum: what moves as slowly as the records are long is drift or creep, not vibration."""


@dataclass(frozen=True)
class Left:
    """The residual (n,) of one run under the final model, about its own offset."""

    run: Run
    error_um: Samples

    @property
    def rate_Hz(self) -> float:
        return 1 / self.run.step_s


@dataclass(frozen=True)
class Found:
    """A disturbance with its parameters and mean power."""

    name: str
    params: dict[str, Value]
    power_um2: float
    why: str


Parts = tuple[Sequence[Left], Sequence[Left], Sequence[Left]]
Test = Callable[[Sequence[Left], Sequence[Left], Sequence[Left]], Found | None]


def disturbances(
    train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left], allowed: set[str]
) -> tuple[list[Found], dict[str, str]]:
    """What is there, and why the rest could not be tested, by name."""
    quiet = [_quiet(part) for part in (train, holdout, reference)]
    idle = all(part and all(left.run.idle for left in part) for part in quiet[:2])
    tests: dict[str, tuple[Test, bool]] = {
        "mains_hum": (hum, idle),
        "vibration": (vibration, idle),
        "quantisation": (quantisation, True),
        "sampling_jitter": (jitter, any(left.run.driven for left in train)),
    }
    found, untestable = [], {}
    for name, (test, possible) in tests.items():
        if name not in allowed:
            continue
        if not possible:
            untestable[name] = (
                "needs idle training and held-out records" if name != "sampling_jitter" else "needs motion"
            )
            continue
        parts = quiet if name in ("mains_hum", "vibration") else [train, holdout, reference]
        seen = test(*parts)
        if seen is not None:
            found.append(seen)
    if any(f.name == "mains_hum" for f in found):
        found = [f for f in found if f.name != "vibration" or not _is_mains(f.params["f_Hz"][0])]
    return found, untestable


def _quiet(part: Sequence[Left]) -> list[Left]:
    idle = [left for left in part if left.run.idle]
    return idle or list(part)


def _is_mains(f_Hz: float) -> bool:
    return any(abs(f_Hz - h * m) < 2.0 for m in MAINS_Hz for h in (1, 2, 3))


def hum(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> Found | None:
    """Lines at the mains frequency: three harmonics at the frequency that explains most, over the noise beside them."""
    best: Found | None = None
    for mains in MAINS_Hz:
        if 2.2 * mains > train[0].rate_Hz:
            continue
        longest_s = max(len(left.error_um) / left.rate_Hz for left in train)
        grid = np.linspace(mains - WITHIN_Hz, mains + WITHIN_Hz, 2 * int(4 * WITHIN_Hz * longest_s) + 5)
        beside = [[_beside(left, h * mains) for h in (1, 2, 3)] for left in train]
        scores = np.array(
            [sum(_line_statistic(left, f, b) for left, b in zip(train, beside, strict=True)) for f in grid]
        )
        f_Hz, score = float(grid[int(np.argmax(scores))]), float(scores.max())
        again = sum(_line_statistic(left, f_Hz, [_beside(left, h * f_Hz) for h in (1, 2, 3)]) for left in holdout)
        p = chi2.sf(score, 6 * len(train)) * len(grid)
        if p > SURE or chi2.sf(again, 6 * len(holdout)) > AGAIN:
            continue
        power = _line_power(train, f_Hz)
        if power < MORE**2 * _line_power(reference, f_Hz):
            continue
        if best is None or power > best.power_um2:
            why = f"lines at {f_Hz:.2f} Hz and multiples, {1e3 * np.sqrt(2 * power):.3g} nm, held-out records too"
            best = Found("mains_hum", _hum_params(train, f_Hz), power, why)
    return best


def _line_statistic(left: Left, f_Hz: float, beside: Sequence[float]) -> float:
    """Sum over three harmonics of line power over the mean density beside it: chi squared with six degrees."""
    return float(sum(2 * _line(left, h * f_Hz)[0] / max(b, 1e-300) for h, b in zip((1, 2, 3), beside, strict=True)))


def _line(left: Left, f_Hz: float) -> tuple[float, complex]:
    """Periodogram ordinate |sum|^2/n at a frequency and the complex amplitude, absolute time."""
    if f_Hz > 0.5 * left.rate_Hz:
        return 0.0, 0j
    t = left.run.t_s[left.run.rows]
    n = len(t)
    window = np.hanning(n)
    raw = complex(np.sum(left.error_um * window * np.exp(-2j * np.pi * f_Hz * t)))
    return abs(raw) ** 2 / float(np.sum(window**2)), 2 * raw / float(window.sum())


def _beside(left: Left, f_Hz: float) -> float:
    """Mean periodogram ordinate close by, the line itself left out."""
    width = 3.0 * left.rate_Hz / len(left.error_um)
    away = np.concatenate([np.linspace(-BESIDE_Hz, -width, 12), np.linspace(width, BESIDE_Hz, 12)])
    values = [_line(left, f_Hz + d)[0] for d in away if 0 < f_Hz + d < 0.5 * left.rate_Hz]
    return float(np.median(values)) / 0.693 if values else np.inf


def _line_power(part: Sequence[Left], f_Hz: float) -> float:
    """Mean square in um^2 of the three lines."""
    if not part:
        return 0.0
    return float(np.mean([sum(abs(_line(left, h * f_Hz)[1]) ** 2 / 2 for h in (1, 2, 3)) for left in part]))


def _hum_params(train: Sequence[Left], f_Hz: float) -> dict[str, Value]:
    """Sine and cosine parts of each line, averaged over the records with the scatter between them."""
    params: dict[str, Value] = {}
    for h in (1, 2, 3):
        amplitudes = np.array([_line(left, h * f_Hz)[1] for left in train])
        noise = float(np.mean([2 * np.sqrt(_beside(left, h * f_Hz) / len(left.error_um)) for left in train]))
        for name, values in ((f"sin{h}_um", -amplitudes.imag), (f"cos{h}_um", amplitudes.real)):
            value = float(values.mean())
            spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
            half = 1.96 * float(np.hypot(spread, noise)) / np.sqrt(len(values))
            params[name] = (value, "um", (value - half, value + half))
    resolution = 0.2 / max(float(left.run.t_s[-1] - left.run.t_s[0]) for left in train)
    params["f_Hz"] = (f_Hz, "Hz", (f_Hz - resolution, f_Hz + resolution))
    return params


def vibration(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> Found | None:
    """A peak of the idle spectrum that stands out of the reference's, or out of its own surroundings."""
    spectra = _spectra(train, holdout, reference)
    live = np.array([not _is_mains(float(v)) for v in spectra.f_Hz])
    live[:SLOW_LINES] = False
    band = _standing_out((train, holdout, reference), spectra, live)
    if band is None:
        return None
    low, high = band
    new = np.maximum(spectra.seen - spectra.before, 0.0)
    if new[low:high] @ live[low:high] < BESIDE_MAINS * new[low:high].sum():
        return None
    return _vibration_found(spectra.f_Hz, spectra.seen - spectra.before, low, high, spectra.averages)


def louder_at_rest(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> bool:
    """Whether any band of the idle records, the mains' too, stands out of the reference's, whatever its cause."""
    now, again, was = ([left for left in part if left.run.idle] for part in (train, holdout, reference))
    if not (now and again and was):
        return False
    idle = now, again, was
    spectra = _spectra(*idle)
    live = np.ones(len(spectra.f_Hz), dtype=bool)
    live[:SLOW_LINES] = False
    return _standing_out(idle, spectra, live) is not None


class _Spectra(NamedTuple):
    """Densities (k,) of the training records, and of what was there before; how many periodograms are in the first."""

    f_Hz: Samples
    seen: Samples
    before: Samples
    averages: float


def _spectra(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> _Spectra:
    shortest = min(len(left.error_um) for left in [*train, *holdout, *reference])
    length = min(SEGMENT, shortest // 4)
    f, seen, averages = _density(train, length)
    before = _density(reference, length)[1] if reference else median_filter(seen, size=41, mode="nearest") / 0.97
    return _Spectra(f, seen, before, averages)


def _standing_out(parts: Parts, spectra: _Spectra, live: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and last line (excluded) of the band, among the ``live`` lines, that is new beyond chance."""
    f, seen, before, _ = spectra
    bands, looked = _new_bands(seen * live, before * live)
    found = [(p, band) for band in bands if (p := _newness(band, f, parts, before)) * looked <= SURE_BAND]
    return min(found)[1] if found else None


def _newness(band: tuple[int, int], f: Samples, parts: Parts, before: Samples) -> float:
    """Probability that a band of training and held-out records stands out of the reference's as much by chance; 1
    where it does not stand out in both."""
    (train, holdout, reference), (low, high) = parts, band
    edges_Hz = float(f[low] - f[1] / 2), float(f[high - 1] + f[1] / 2)
    new, again, both, old = (_band_power(part, *edges_Hz) for part in (train, holdout, [*train, *holdout], reference))
    around = _band_power(reference, edges_Hz[0] - AROUND * f[1], edges_Hz[1] + AROUND * f[1])
    if not reference:
        old = around = float(before[low:high].mean()), np.inf
    # A narrow band holds few lines of the reference; its neighbours say as well what is usual there.
    p, p_here = (float(f_distribution.sf(both[0] / part[0], both[1], min(part[1], 1e6))) for part in (around, old))
    return p if p_here <= SURE_HERE and min(new[0], again[0]) >= MORE * max(old[0], around[0]) else 1.0


def _new_bands(seen: Samples, before: Samples) -> tuple[list[tuple[int, int]], int]:
    """First and last line (excluded) of the band of each width that stands out most; how many were looked at."""
    bands, looked = [], 0
    for width in WIDTHS:
        box = np.ones(width)
        new, old = np.convolve(seen, box, "valid"), np.convolve(before, box, "valid")
        ratio = np.divide(new, old, out=np.zeros_like(new), where=old > 0)
        bands.append((int(np.argmax(ratio)), int(np.argmax(ratio)) + width))
        looked += len(ratio)
    return bands, looked


def _band_power(part: Sequence[Left], low_Hz: float, high_Hz: float) -> tuple[float, float]:
    """Mean density in a band, and its degrees of freedom: twice the number of lines at full resolution that carry it.
    A mode of the stage that surroundings keep ringing fills few lines however long the list of segments."""
    density, freedom = [], 0.0
    for left in part:
        f, p = periodogram(left.error_um, left.rate_Hz, window="hann", detrend="linear")
        inside = p[(f >= low_Hz) & (f < high_Hz)]
        density.append(float(inside.mean()))
        freedom += 2 * float(inside.sum() ** 2 / max(float((inside**2).sum()), 1e-300))
    return (float(np.mean(density)), freedom) if density else (0.0, 0.0)


def _vibration_found(f: Samples, excess: Samples, low: int, high: int, averages: float) -> Found:
    step, excess = float(f[1] - f[0]), np.maximum(excess, 0.0)
    top = low + int(np.argmax(excess[low:high]))
    width = (high - low) * step
    rms = float(np.sqrt(excess[max(low - 2, 1) : high + 2].sum() * step))
    error = 2 / np.sqrt(averages)
    params: dict[str, Value] = {
        "rms_um": (rms, "um", (rms * max(1 - error, 0.0), rms * (1 + error))),
        "f_Hz": (float(f[top]), "Hz", (float(f[low]) - step, float(f[high - 1]) + step)),
        "bandwidth_Hz": (width, "Hz", (0.3 * width, 3 * width)),
    }
    return Found("vibration", params, rms**2, f"a peak of {1e3 * rms:.3g} nm rms at {f[top]:.4g} Hz in idle records")


def _density(part: Sequence[Left], length: int) -> tuple[Samples, Samples, float]:
    """Frequencies, mean one-sided density and how many independent periodograms are in it."""
    spectra = [welch(left.error_um, left.rate_Hz, nperseg=length, detrend="linear") for left in part]
    averages = sum(1.6 * len(left.error_um) / length for left in part)
    return spectra[0][0], np.mean([s for _, s in spectra], axis=0), float(averages)


def quantisation(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> Found | None:
    """All positions lie on a grid, coarser than the reference's and coarse beside the noise."""
    steps = [grid_step(left.run.x_um) for left in train]
    again = [grid_step(left.run.x_um) for left in holdout]
    if any(s is None for s in [*steps, *again]):
        return None
    lsb = float(np.median([s for s in steps if s is not None]))
    known = [grid_step(left.run.x_um) for left in reference]
    before = max((s for s in known if s is not None), default=0.0)
    if not reference or lsb < MORE * before:
        return None
    params: dict[str, Value] = {"lsb_um": (lsb, "um", (0.999 * lsb, 1.001 * lsb))}
    return Found("quantisation", params, lsb**2 / 12, f"every position is a multiple of {1e3 * lsb:.4g} nm")


def grid_step(x_um: Samples) -> float | None:
    """The step of the grid on which all values (n,) lie, or None when there is none above rounding."""
    gaps = np.diff(np.unique(x_um))
    gaps = gaps[gaps > 1e-9 * max(float(np.abs(x_um).max()), 1.0)]
    if len(gaps) < 3:
        return None
    step = float(gaps.min())
    if step < 1e-6 * max(float(np.ptp(x_um)), 1e-9):
        return None
    multiples = gaps / step
    step = float(np.median(gaps / np.maximum(np.round(multiples), 1.0)))
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if float(off.max()) < 0.05 else None


def jitter(train: Sequence[Left], holdout: Sequence[Left], reference: Sequence[Left]) -> Found | None:
    """Fast noise that grows with the square of the speed."""
    slope, z = _speed_slope(train)
    _, z_again = _speed_slope(holdout)
    if norm.sf(z) > SURE or norm.sf(z_again) > AGAIN or not reference:
        return None
    # What a model misses grows with the speed too, on some records more than on others: a clock does on all alike.
    if not (_alike(train, slope) and _alike(holdout, slope)):
        return None
    known = [_speed_slope(reference), *(_speed_slope([left]) for left in reference)]
    before = max((seen for seen, z_seen in known if z_seen > SEEN_Z), default=0.0)
    if slope < MORE**2 * before:
        return None
    slope -= before
    rms = float(np.sqrt(slope))
    if rms > LATEST * train[0].run.step_s:
        return None
    half = min(1.96 / max(z, 1e-9), 1.0)
    params: dict[str, Value] = {"rms_s": (rms, "s", (rms * np.sqrt(1 - half), rms * np.sqrt(1 + half)))}
    speed = float(np.mean([np.mean(np.gradient(left.run.x_um, left.run.step_s) ** 2) for left in train]))
    return Found("sampling_jitter", params, slope * speed, f"fast noise of {1e6 * rms:.3g} us times the speed")


def _alike(part: Sequence[Left], slope: float) -> bool:
    """Whether each record that is fast enough to know has about this slope."""
    knowing = [left for left in part if slope * _fastest(left) > TELLING * float(np.mean(left.error_um**2))]
    return all(slope / UNALIKE < _speed_slope([left])[0] < slope * UNALIKE for left in knowing)


def _fastest(left: Left) -> float:
    """(um/s)^2 in the fastest tenth of the rows that count."""
    blocks = _rough_and_speed(left)
    return float(np.quantile(blocks[1], 0.9)) if blocks is not None else 0.0


def _rough_and_speed(left: Left) -> tuple[Samples, Samples] | None:
    """Fast variance of the residual, um^2, and mean squared speed, (um/s)^2, of blocks (b,); None of a short record."""
    if not left.run.driven or len(left.error_um) < SHORTEST:
        return None
    rough = np.diff(left.error_um, ROUGH) ** 2 / comb(2 * ROUGH, ROUGH)
    smooth = np.convolve(left.run.x_um[left.run.rows], np.ones(5) / 5, mode="same")
    v2 = np.gradient(smooth, left.run.step_s)[ROUGH // 2 : ROUGH // 2 - ROUGH] ** 2
    known = ~_after_jump(left.run)[ROUGH:]
    count = int(known.sum()) // BLOCK_ROWS
    if count < 2:
        return None
    rough, v2 = (values[known][: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS).mean(axis=1) for values in (rough, v2))
    return rough, v2


def _after_jump(run: Run) -> NDArray[np.bool_]:
    """Scored rows (n,) in which a model that is wrong by a fraction of a row is rough too."""
    u = run.u_V[run.rows]
    steps = np.abs(np.diff(u, prepend=u[0]))
    jumped = steps > max(JUMP_SHARE * float(np.ptp(run.u_V)), 5 * float(np.quantile(steps, 0.9)))
    return np.convolve(jumped, np.ones(AFTER_JUMP_ROWS))[: len(u)] > 0


def _speed_slope(part: Sequence[Left]) -> tuple[float, float]:
    """s^2 of fast residual variance per squared speed, and how sure."""
    blocks = [found for found in map(_rough_and_speed, part) if found is not None]
    if not blocks:
        return 0.0, 0.0
    y, x = (np.concatenate(values) for values in zip(*blocks, strict=True))
    if np.ptp(x) == 0:
        return 0.0, 0.0
    # A block's variance of 64 rows is known to a share of itself: weigh by what the first line says.
    weights = 1 / (np.median(y) + np.polyval(np.polyfit(x, y, 1), x).clip(min=0)) ** 2
    mean = np.average(x, weights=weights)
    spread = float(np.sum(weights * (x - mean) ** 2))
    slope = float(np.sum(weights * (x - mean) * y)) / spread
    left_over = y - np.average(y, weights=weights) - slope * (x - mean)
    std = float(np.sqrt(np.sum((weights * (x - mean) * left_over) ** 2))) / spread
    return slope, slope / max(std, 1e-300)
