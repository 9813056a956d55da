"""What no voltage predicts: hum, vibration, quantisation and jitter, found in spectra and likelihoods.

Each is looked for in the training residual, must be found again in the held-out one, and must be more than the
reference records show. Idle records are asked where there are any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
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
WIDTHS = (1, 3, 7, 15)
"""Lines of a spectrum over which something new may spread."""
LATEST = 0.05
"""Of the sampling step: a clock that is off by more is no clock, and what grows with speed is a fault of the model."""
LEAK = 1.5
"""Lines over which a Hann window spreads one: neighbours are not independent."""
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
    shortest = min(len(left.error_um) for left in [*train, *holdout, *reference])
    length = min(SEGMENT, shortest // 4)
    f, seen, averages = _density(train, length)
    if reference:
        _, before, averages_before = _density(reference, length)
    else:
        before, averages_before = median_filter(seen, size=41, mode="nearest") / 0.97, 1e9
    live = np.array([not _is_mains(float(v)) for v in f])
    live[:SLOW_LINES] = False
    band = _new_band(seen * live, before * live, averages, averages_before)
    if band is None:
        return None
    low, high, looked = band
    edges_Hz = float(f[low] - f[1] / 2), float(f[high - 1] + f[1] / 2)
    new, again, both, old = (_band_power(part, *edges_Hz) for part in (train, holdout, [*train, *holdout], reference))
    if not reference:
        old = float(before[low:high].mean()), np.inf
    p = float(f_distribution.sf(both[0] / old[0], both[1], min(old[1], 1e6))) * looked
    if p > SURE_BAND or min(new[0], again[0]) < MORE * old[0]:
        return None
    return _vibration_found(f, seen - before, low, high, averages)


def _new_band(seen: Samples, before: Samples, averages: float, averages_before: float) -> tuple[int, int, int] | None:
    """First and last line (excluded) of the band that stands out most, and how many bands were looked at."""
    best: tuple[int, int] | None = None
    least, looked = 1.0, 0
    for width in WIDTHS:
        box = np.ones(width)
        new, old = np.convolve(seen, box, "valid"), np.convolve(before, box, "valid")
        ratio = np.divide(new, old, out=np.zeros_like(new), where=old > 0)
        top, lines = int(np.argmax(ratio)), (width - 1) / LEAK + 1
        p = float(f_distribution.sf(ratio[top], 2 * averages * lines, 2 * averages_before * lines))
        looked += len(ratio)
        if p < least:
            best, least = (top, top + width), p
    return None if best is None else (*best, looked)


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
    # What a model misses grows with the speed too, on some records more than on others: a clock does on all alike.
    before = max((_speed_slope([left])[0] for left in reference), default=0.0)
    if norm.sf(z) > SURE or norm.sf(z_again) > AGAIN or slope < MORE**2 * max(before, 0.0) or not reference:
        return None
    slope -= max(before, 0.0)
    rms = float(np.sqrt(slope))
    if rms > LATEST * train[0].run.step_s:
        return None
    half = min(1.96 / max(z, 1e-9), 1.0)
    params: dict[str, Value] = {"rms_s": (rms, "s", (rms * np.sqrt(1 - half), rms * np.sqrt(1 + half)))}
    speed = float(np.mean([np.mean(np.gradient(left.run.x_um, left.run.step_s) ** 2) for left in train]))
    return Found("sampling_jitter", params, slope * speed, f"fast noise of {1e6 * rms:.3g} us times the speed")


def _speed_slope(part: Sequence[Left]) -> tuple[float, float]:
    """s^2 of fast residual variance per squared speed, and how sure."""
    variance, speed = [], []
    for left in part:
        if not left.run.driven or len(left.error_um) < 256:
            continue
        rough = np.diff(left.error_um, 3) ** 2 / 20
        smooth = np.convolve(left.run.x_um[left.run.rows], np.ones(5) / 5, mode="same")
        v2 = np.gradient(smooth, left.run.step_s)[1:-2] ** 2
        edges = np.arange(0, len(rough), 64)
        variance.append(np.add.reduceat(rough, edges)[:-1] / 64)
        speed.append(np.add.reduceat(v2, edges)[:-1] / 64)
    if not variance:
        return 0.0, 0.0
    y, x = np.concatenate(variance), np.concatenate(speed)
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
