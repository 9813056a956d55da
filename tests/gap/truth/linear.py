"""Linear parts on a grid finer than the records, each carrying its state from call to call; inputs run straight between
samples (ramp-invariant, not the zero-order or bilinear forms)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter, lfilter_zi

Samples = NDArray[np.float64]


class Filter:
    """A transfer function with state, settled at ``first`` before its first sample."""

    def __init__(self, b: Samples, a: Samples, first: float = 0.0) -> None:
        self.b, self.a = b, a
        self.settle(first)

    def settle(self, value: float) -> None:
        """As if the input had been ``value`` for ever."""
        self.state = lfilter_zi(self.b, self.a) * value

    def step(self, x: Samples) -> Samples:
        y, self.state = lfilter(self.b, self.a, x, zi=self.state)
        return y


def lag(tau_s: float, step_s: float, first: float = 0.0) -> Filter:
    """1 / (1 + s tau_s)."""
    kept = np.exp(-step_s / tau_s)
    new = 1 - tau_s * (1 - kept) / step_s
    return Filter(np.array([new, (1 - kept) - new]), np.array([1.0, -kept]), first)


def mode(f_Hz: float, zeta: float, step_s: float, first: float = 0.0) -> Filter:
    """w^2 / (s^2 + 2 zeta w s + w^2)."""
    w = 2 * np.pi * f_Hz
    b, a, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), step_s, method="foh")
    return Filter(np.ravel(b), np.ravel(a), first)


class Shift:
    """Dead time of any length, by a tail of past samples."""

    def __init__(self, delay_s: float, step_s: float, first: float = 0.0) -> None:
        self.samples = delay_s / step_s
        self.tail = np.full(int(np.ceil(self.samples)) + 2, first)

    def settle(self, value: float) -> None:
        self.tail[:] = value

    def step(self, x: Samples) -> Samples:
        line = np.concatenate([self.tail, x])
        at = np.arange(len(self.tail), len(line)) - self.samples
        self.tail = line[len(line) - len(self.tail) :]
        return np.interp(at, np.arange(len(line)), line)


class Relaxations:
    """sum_i k_i / (1 + s tau_i) over many time constants, with what happens while nobody records."""

    def __init__(self, tau_s: Samples, k: Samples, step_s: float) -> None:
        self.tau_s, self.k, self.last = tau_s, k, 0.0
        self.parts = [lag(float(tau), step_s) for tau in tau_s]

    def step(self, x: Samples) -> Samples:
        self.last = float(x[-1])
        return np.asarray(sum(k * part.step(x) for k, part in zip(self.k, self.parts, strict=True)))

    def rest(self, seconds: float) -> None:
        """The input stays where it was for so long."""
        for tau, part in zip(self.tau_s, self.parts, strict=True):
            steady = lfilter_zi(part.b, part.a) * self.last
            part.state = steady + (part.state - steady) * np.exp(-seconds / tau)


class Fine:
    """From rows to a grid ``factor`` times finer and back; the last sample of each stretch is the row's own."""

    def __init__(self, factor: int, first: float = 0.0) -> None:
        self.factor, self.last = factor, first

    def up(self, x: Samples) -> Samples:
        """(n,) to (n factor,), straight between rows."""
        before = np.concatenate([[self.last], x[:-1]])
        part = np.arange(1, self.factor + 1) / self.factor
        self.last = float(x[-1])
        return (before[:, None] + (x - before)[:, None] * part).ravel()

    def down(self, x: Samples) -> Samples:
        """(n factor,) to (n,)."""
        return x[self.factor - 1 :: self.factor]
