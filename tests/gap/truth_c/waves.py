"""Voltages of this lab's records, as s = -1..1 over the working range, one number a row."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from .memory import Memory
from .parts import Mode, Modes, Samples
from .stage import Traits, log_uniform

MOST = 1.1
"""How far, in half travels from its middle, a stage may ring: its flexures stop it at 1.2."""
Rng = np.random.Generator


def edge(n: int) -> Samples:
    """(n,) from just above 0 to 1, as a half cosine."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 1) / n))


def taper(n: int, rows: int) -> Samples:
    w, k = np.ones(n), max(8, min(rows, n // 8))
    w[:k], w[n - k :] = edge(k), edge(k)[::-1]
    return w


def idle(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    return np.zeros(n)


def chirp(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """Linear, from a few hertz to 0.12-0.45 of the first mode."""
    return _swept(rng, n, rate_Hz, rng.uniform(0.12, 0.45) * f_Hz)


def sweep(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """The same through the mode, so small that it rings to about a quarter of the range."""
    small = 0.25 * 2 * zeta * rng.uniform(0.6, 1.5) + 0.003
    return small * _swept(rng, n, rate_Hz, min(0.42 * rate_Hz, rng.uniform(1.15, 1.6) * f_Hz))


def _swept(rng: Rng, n: int, rate_Hz: float, top_Hz: float) -> Samples:
    t_s, low_Hz = np.arange(n) / rate_Hz, rng.uniform(1, 10)
    phase = 2 * np.pi * (low_Hz * t_s + (top_Hz - low_Hz) * t_s**2 / (2 * n / rate_Hz))
    return np.asarray(taper(n, int(0.05 * rate_Hz)) * np.sin(phase))


def raster(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """Lines to and fro at 1 to 40 Hz with rounded turns, in a third of them growing or shrinking."""
    return _lines(rng, n, rate_Hz, log_uniform(rng, 1, min(40, 0.2 * f_Hz)))


def scan(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """Full lines at 0.5 to 4 Hz."""
    return _lines(rng, n, rate_Hz, log_uniform(rng, 0.5, 4), changing=False)


def _lines(rng: Rng, n: int, rate_Hz: float, line_Hz: float, changing: bool = True) -> Samples:
    period = n / max(2, round(line_Hz * n / rate_Hz))
    tri = 1 - 4 * np.abs((np.arange(n) / period + 0.25) % 1 - 0.5)
    m = max(1, int(rng.uniform(0.02, 0.12) * period))
    kernel = np.hanning(m + 2)
    wide = np.concatenate([tri[n - m :], tri, tri[:m]])
    tri = np.convolve(wide, kernel / kernel.sum(), "same")[m : m + n]
    tri = tri / np.max(np.abs(tri))
    if changing and rng.random() < 0.35:
        first, last = ((1.0, 0.15), (0.2, 1.0), (1.0, 0.5))[int(rng.integers(3))]
        tri = tri * np.linspace(first, last, n)
    return np.asarray(tri)


def stairs(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """Steps with edges of 2 to 20 ms: up, down and back, or to places at random."""
    count = int(rng.integers(5, 16))
    if rng.random() < 0.5:
        up, down = np.linspace(0, 1, count // 3 + 1), np.linspace(1, -1, count // 2 + 1)
        levels = np.concatenate([up, down[1:], np.linspace(-1, 0, count // 3 + 1)[1:]])
    else:
        levels = np.concatenate([[0.0], rng.uniform(-1, 1, count)])
    k = max(2, int(rng.uniform(0.002, 0.02) * rate_Hz))
    s = np.empty(n)
    cuts = np.linspace(0, n, len(levels) + 1).astype(int)
    for i, (a, b) in enumerate(pairwise(cuts)):
        s[a:b] = levels[i]
        if i:
            m = min(k, int(b - a))
            s[a : a + m] = levels[i - 1] + (levels[i] - levels[i - 1]) * edge(m)
    return s


def wandering(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """A smooth random path, with most of its power at 0.3 to 2 Hz and the rest below 8 to 150 Hz."""
    low_Hz, high_Hz = rng.uniform(0.3, 2), log_uniform(rng, 8, min(150.0, 0.35 * f_Hz))
    f = np.fft.rfftfreq(n, 1 / rate_Hz)
    size = np.exp(-((f / high_Hz) ** 4)) / (1 + (low_Hz / np.maximum(f, 1e-6)) ** 4)
    size /= (1 + f / (4 * low_Hz)) ** rng.uniform(0, 0.8)
    s = np.fft.irfft(size * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), n)
    s = np.tanh(s / np.std(s) / 2.2) * taper(n, int(0.15 * rate_Hz))
    return np.asarray(s / np.max(np.abs(s)))


def sines(rng: Rng, n: int, rate_Hz: float, f_Hz: float, zeta: float) -> Samples:
    """Three to seven of them, from 1 Hz to 0.3 of the first mode."""
    t_s = np.arange(n) / rate_Hz
    f = np.exp(rng.uniform(0.0, np.log(min(120.0, 0.3 * f_Hz)), int(rng.integers(3, 8))))
    s = np.sin(2 * np.pi * f * t_s[:, None] + rng.uniform(0, 2 * np.pi, len(f))) @ f**-0.4
    s = s * taper(n, int(0.15 * rate_Hz))
    return np.asarray(s / np.max(np.abs(s)))


WAVES = {
    "idle": idle,
    "chirp": chirp,
    "sweep": sweep,
    "raster": raster,
    "scan": scan,
    "stairs": stairs,
    "wandering": wandering,
    "sines": sines,
}


def paused(rng: Rng, s: Samples, rate_Hz: float) -> Samples:
    """The same path, which slows down, stands for a tenth to a quarter of the time and goes on."""
    n = len(s)
    stop, at = int(rng.uniform(0.1, 0.25) * n), int(rng.uniform(0.3, 0.6) * n)
    k = max(4, min(int(0.05 * rate_Hz), n // 20))
    speed = np.ones(n)
    speed[at : at + stop] = 0
    speed[at - k : at], speed[at + stop : at + stop + k] = edge(k)[::-1], edge(k)
    when = np.cumsum(speed)
    return np.asarray(np.interp(when - when[0], np.arange(n), s))


def turned_down(s: Samples, bias: float, traits: Traits, chain: Sequence[Sequence[Mode]]) -> Samples:
    """bias + s, less loud where the stage would ring beyond ``MOST``: this lab looks before it leaves a stage alone.

    The harmonics of its memory ring too. ``chain`` holds the modes side by side of everything that moves, one after
    the other.
    """
    for _ in range(12):
        far = ringing(bias + s, traits, chain)
        if far <= MOST:
            break
        s = s * max(0.3, 0.98 * (MOST - abs(bias)) / (far - abs(bias)))
    return np.asarray(bias + s)


def ringing(s: Samples, traits: Traits, chain: Sequence[Sequence[Mode]]) -> float:
    """How far it goes from mid-range, in half travels, with what its modes make of a memory's answer to s."""
    x = Memory(traits.recipe, traits.width, -1.0, 1.0, 2.0, float(s[0])).run(s)
    y = x
    for modes in chain:
        y = Modes(modes, 1 / traits.rate_Hz, float(y[0])).run(y)
    return float(np.max(np.abs(s + y - x)))
