"""What the base alone is expected to leave of a record: the sensor's noise, and a share of its own motion.

Reference records tell both, octave by octave: those at rest the noise, driven ones what the base misses for how much it
moves there. Without them the noise is that of the other records at rest, or the quietest that any has, and the share a
prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.moments import Integers
from phaselead.record import Samples

BASE_SHARE = 0.01
"""Of its own motion, what a base misses where no reference record tells: what good fits of stages leave."""
NEIGHBOURS = (0.25, 0.5, 0.25)
"""Weights of an octave and those beside it, over which noise and share are smoothed."""
UNTOLD = 4.0
"""As many coefficients as a guess without reference records is worth."""
LOG_SHARES = np.linspace(np.log(1e-16), np.log(1e8), 200)
"""Logarithms of the shares of the power of the base's motion near which the likeliest is looked for, from nothing to
all that a sensor sees."""
LEAST_UM2 = 1e-14
"""Power of a coefficient below which no sensor's noise lies, (0.1 pm)^2 a row."""


@dataclass(frozen=True)
class NoiseAndBaseShare:
    """Noise and share by octave."""

    first: int
    """The lowest octave."""
    noise_um2: Samples
    """(octaves,) per coefficient."""
    share: Samples
    """(octaves,) of the power of the base's motion."""
    noise_told: Samples
    """(octaves,) As many coefficients as tell the noise."""
    share_told: Samples
    """(octaves,) As many as tell the share."""
    noise_spread: Samples
    """(octaves,) Over which part of a block's coefficients noise is spread: all, where it is white, and few, where it
    is a line. None where no record at rest shows it: what is taken for it may be missed as well."""
    scatter_um2: float = 0.0
    """Of the levels of records."""
    scatter_told: float = UNTOLD
    """As many levels as tell it."""

    def of(self, run: BlockedRun, motion: Samples) -> tuple[Samples, Samples, Samples]:
        """Noise and misfit (blocks,) in um^2 per coefficient of a run whose base has this power (blocks,), and how many
        coefficients tell their sum: degrees of freedom of Student's t (Welch 1947)."""
        at = self._blocks_at(run)
        noise, base = self.noise_um2[at], self.share[at] * motion
        told = (noise + base) ** 2 / (noise**2 / self.noise_told[at] + base**2 / self.share_told[at])
        if run.levelled:
            noise[0] = noise[0] / run.rows + run.level_carried_um2
            base[0] += self.scatter_um2
            told[0] = self.scatter_told
        return noise, base, told

    def base_share_of(self, run: BlockedRun) -> Samples:
        """Share (blocks,) of the power of its motion that the base misses of a run."""
        return self.share[self._blocks_at(run)]

    def _blocks_at(self, run: BlockedRun) -> Integers:
        """Places here of the blocks of a run; of its level that of its lowest octave."""
        at = self._at(run.octaves)
        at[: run.first_octave] = at[1]
        return at

    def counted(self, octaves: Integers, sizes: Integers, noise: Samples, missed: Samples) -> Samples:
        """Effective number of coefficients (..., blocks) of blocks of ``sizes`` that hold noise and something missed,
        each of this power: noise says something new in each that it is spread over, what is missed is smooth and says
        it once. To what is missed comes by how much the mean power of noise differs by chance."""
        n = np.maximum(sizes * self.noise_spread[self._at(octaves)], 1.0)
        missed = missed + noise * np.sqrt(2 / n)
        return np.asarray(n * (noise + missed) / (noise + n * missed))

    def _at(self, octaves: Integers) -> Integers:
        """Places of octaves here, of those beyond the ends the nearest."""
        return np.clip(octaves - self.first, 0, len(self.share) - 1)


def noise_and_base_share_of(runs: Sequence[BlockedRun]) -> NoiseAndBaseShare:
    """From the reference records among the runs, or without them from a prior."""
    first = min(int(run.octaves[run.first_octave :].min()) for run in runs)
    count = max(int(run.octaves.max()) for run in runs) - first + 1
    references = [run for run in runs if run.modelled.run.role == "reference"]
    told_by, rows = references or list(runs), []
    for run in told_by:
        at_rest = np.full(len(run.sizes), run.modelled.run.idle)
        parts = (run.octaves - first, run.base_left_um2, run.motion, at_rest, run.sizes)
        rows.append([part[run.first_octave :] for part in parts])
    octave, power, motion, at_rest, sizes = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    levels, untold, driven = _scatter(references), np.full(count, UNTOLD), ~at_rest
    noise, noise_told = _noise(octave, power, at_rest, sizes, count)
    noise_spread = _noise_spread([run for run in told_by if run.modelled.run.idle], first, count)
    if not references and not at_rest.any():
        noise, noise_told = np.full(count, float(np.min(noise))), untold
    if not references or not driven.any():
        return NoiseAndBaseShare(first, noise, np.full(count, BASE_SHARE**2), noise_told, untold, noise_spread, *levels)
    octave, power, motion = octave[driven], power[driven], motion[driven]
    share = _share_of_motion(octave, power, motion, noise)
    blocks = np.bincount(octave, minlength=count).astype(float)
    near = _smooth(blocks)
    share_told = np.where(near > 0, near**2 / np.maximum(_smooth_squared(blocks), 1e-30), UNTOLD)
    # Records differ in their noise too: it is never known better than what the base misses.
    return NoiseAndBaseShare(first, noise, share, np.minimum(noise_told, share_told), share_told, noise_spread, *levels)


def _scatter(references: Sequence[BlockedRun]) -> tuple[float, float]:
    """Variance in um^2 of the levels of reference records about their mean, and how many tell it."""
    levels_um = [float(run.base_error[0, 0]) for run in references if run.levelled]
    if not levels_um:
        return 0.0, UNTOLD
    return max(float(np.var(levels_um, ddof=1)), LEAST_UM2), len(levels_um) - 1.0


def _share_of_motion(octave: Samples, power: Samples, motion: Samples, noise: Samples) -> Samples:
    """Share (octaves,) of the motion under which what blocks show is most likely, each block one coefficient and those
    of the octaves beside it counting too; where no block tells, the prior. Not the ratio of what is missed in all to
    what moves in all: the block that moves most would decide."""
    found = np.full(len(noise), BASE_SHARE**2)
    for o in range(len(noise)):
        near = (np.abs(octave - o) <= 1) & (motion > 0)
        if not near.any():
            continue
        weights = np.where(octave[near] == o, NEIGHBOURS[1], NEIGHBOURS[0])
        blocks = weights, power[near], motion[near], noise[octave[near]]
        best = int(np.argmin([_unlikely(one, *blocks) for one in LOG_SHARES]))
        about = LOG_SHARES[max(best - 1, 0)], LOG_SHARES[min(best + 1, len(LOG_SHARES) - 1)]
        likeliest = minimize_scalar(_unlikely, bounds=about, args=blocks, method="bounded", options={"xatol": 1e-9})
        found[o] = np.exp(likeliest.x)
    return found


def _unlikely(log_share: float, weights: Samples, power: Samples, motion: Samples, noise: Samples) -> float:
    """How unlikely blocks (n,) are under a share of their motion, each counting by its weight."""
    variance = noise + np.exp(log_share) * motion
    return float(weights @ (np.log(variance) + power / variance))


def _noise_spread(at_rest: Sequence[BlockedRun], first: int, count: int) -> Samples:
    """Over which part of an octave's coefficients (octaves,) the noise of records at rest is spread: three times the
    participation ratio of their squares, which makes 1 where they are normal and alike."""
    squares, fourths, sizes = np.zeros(count), np.zeros(count), np.zeros(count)
    for run in at_rest:
        c, at = run.base_error[:, 0], run.octaves - first
        np.add.at(squares, at, np.add.reduceat(c**2, run.edges[:-1]))
        np.add.at(fourths, at, np.add.reduceat(c**4, run.edges[:-1]))
        np.add.at(sizes, at, run.sizes)
    told = np.flatnonzero(fourths)
    if not len(told):
        return np.zeros(count)
    shares = np.minimum(3 * squares[told] ** 2 / (fourths[told] * sizes[told]), 1.0)
    return np.interp(np.arange(count), told, shares, left=0.0, right=0.0)


def _noise(octave: Samples, power: Samples, at_rest: Samples, sizes: Samples, count: int) -> tuple[Samples, Samples]:
    """Noise (octaves,): of the records at rest, or of the quietest where none is; and how many coefficients tell it."""
    found, told = np.full(count, np.nan), np.full(count, UNTOLD)
    for o in range(count):
        here = octave == o
        if (here & at_rest).any():
            found[o], told[o] = power[here & at_rest].mean(), sizes[here & at_rest].sum()
        elif here.any() and not at_rest.any():
            found[o] = power[here].min()
    known = np.flatnonzero(np.isfinite(found))
    filled, told = (np.interp(np.arange(count), known, values[known]) for values in (found, told))
    weights = _smooth(np.ones(count))
    return np.maximum(_smooth(filled) / weights, LEAST_UM2), weights**2 / _smooth_squared(1 / told)


def _smooth(values: NDArray[np.floating]) -> Samples:
    return np.asarray(np.convolve(values, NEIGHBOURS, mode="same"))


def _smooth_squared(values: NDArray[np.floating]) -> Samples:
    return np.asarray(np.convolve(values, np.square(NEIGHBOURS), mode="same"))
