"""Rate-independent memory that is no play operator with a linear read-out: friction elements (Duhem) and a Preisach
plane whose density falls off from its middle. Each carries its state from call to call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
ROWS = 20_000
"""Rows that the Preisach plane is evaluated on at once, to bound memory."""


def recurrence(a: Samples, b: Samples, first: float) -> Samples:
    """z (n,) of z[k] = a[k] z[k-1] + b[k], z[-1] = first, by doubling: log2(n) passes, stable for |a| <= 1."""
    a, z = a.copy(), b.copy()
    z[0] += a[0] * first
    a[0] = 0.0
    step = 1
    while step < len(z) and np.abs(a).max() > 1e-14:
        z[step:] = z[step:] + a[step:] * z[:-step]
        a[step:] = a[step:] * a[:-step]
        step *= 2
    return z


class Friction:
    """One Duhem element, dz = du - |du| z / reach (Dahl; Bouc-Wen with n = 1, gamma = 0): z in volts within +-reach.

    Its minor loops do not close, which no superposition of plays imitates.
    """

    def __init__(self, reach_V: float, start: float = -0.5) -> None:
        self.reach_V, self.z, self.last_V = reach_V, start * reach_V, 0.0

    def step(self, u: Samples, stretch: Samples | float = 1.0) -> Samples:
        """z (n,) at voltages ``u`` (n,); ``stretch`` multiplies the reach row by row."""
        du = np.diff(u, prepend=self.last_V)
        reach = self.reach_V * stretch
        kept = np.exp(-np.abs(du) / reach)
        z = recurrence(kept, np.sign(du) * reach * (1 - kept), self.z)
        self.z, self.last_V = float(z[-1]), float(u[-1])
        return z


class FrictionSet:
    """Friction elements side by side: (n, m) of what each holds back."""

    def __init__(self, reaches_V: Samples, weights: Samples) -> None:
        self.weights = weights
        self.parts = [Friction(float(r)) for r in reaches_V]

    def step(self, u: Samples, stretch: Samples | float = 1.0) -> Samples:
        """Weighted sum (n,); what is held back, in the unit of the weights times volts."""
        return np.asarray(sum(w * p.step(u, stretch) for w, p in zip(self.weights, self.parts, strict=True)))


class PreisachPlane:
    """A dense Preisach operator by its memory curve (Brokate and Sprekels 1996, 2.4): the boundary psi(r) between the
    relays that are up and down, read through a density that is Lorentzian in the mean switching voltage."""

    def __init__(
        self, levels_V: Samples, weights: Samples, middle_V: float, breadth_V: float, remanence: float = 1.0
    ) -> None:
        self.r, self.weights = levels_V, weights
        self.middle_V, self.breadth_V = middle_V, breadth_V
        self.psi = remanence * levels_V
        self.last_V = 0.0

    def read(self, psi: Samples) -> Samples:
        """Contribution of the relays below a boundary (..., m): the integral of the density."""
        return np.asarray((self.breadth_V * np.arctan((psi - self.middle_V) / self.breadth_V)) @ self.weights)

    def step(self, u: Samples) -> Samples:
        """Its output (n,) in the unit of the weights times volts."""
        du = np.diff(u, prepend=self.last_V)
        up = du > 0
        moving = np.flatnonzero(du)
        if not len(moving):
            return np.full(len(u), float(self.read(self.psi)))
        turns = moving[1:][up[moving[1:]] != up[moving[:-1]]]
        starts = np.concatenate([[0], turns])
        rising = np.concatenate([[up[moving[0]]], up[turns]])
        ends_V = np.concatenate([u[turns - 1], [u[-1]]])
        boundary = np.empty((len(starts) + 1, len(self.r)))
        boundary[0] = psi = self.psi
        for k, (end, goes_up) in enumerate(zip(ends_V.tolist(), rising.tolist(), strict=True)):
            psi = np.maximum(psi, end - self.r) if goes_up else np.minimum(psi, end + self.r)
            boundary[k + 1] = psi
        branch = np.repeat(np.arange(len(starts)), np.diff(np.concatenate([starts, [len(u)]])))
        y = np.empty(len(u))
        for a in range(0, len(u), ROWS):
            part = slice(a, min(a + ROWS, len(u)))
            at, before, upward = u[part, None], boundary[branch[part]], rising[branch[part]][:, None]
            y[part] = self.read(np.where(upward, np.maximum(before, at - self.r), np.minimum(before, at + self.r)))
        self.psi, self.last_V = psi, float(u[-1])
        return y
