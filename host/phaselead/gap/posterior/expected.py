"""What the base alone is expected to leave of a record: the sensor's noise, and a share of its own motion.

Reference records tell both, octave by octave: those at rest the noise, driven ones what the base misses for how much it
moves there. Without them the noise is the quietest that the records have, and the share a prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.record import Samples

BASE_SHARE = 0.01
"""Of its own motion, what a base misses where no reference record tells: what good fits of stages leave."""
NEIGHBOURS = (0.25, 0.5, 0.25)
"""Weights of an octave and those beside it, over which noise and share are smoothed."""
UNTOLD = 4.0
"""As many coefficients as a guess without reference records is worth."""
SETTLING = 60
"""Steps in which a share settles."""
LEAST_UM2 = 1e-14
"""Power of a coefficient below which no sensor's noise lies, (0.1 pm)^2 a row."""


@dataclass(frozen=True)
class Expected:
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
    at_rest: bool
    """Whether records at rest tell the noise. What else is taken for it may as well be missed."""

    def of(self, run: BlockedRun, motion: Samples) -> tuple[Samples, Samples, Samples]:
        """Noise and misfit (blocks,) in um^2 per coefficient of a run whose base has this power (blocks,), and how many
        coefficients tell their sum: degrees of freedom of Student's t (Welch 1947)."""
        at = np.clip(run.octaves - self.first, 0, len(self.share) - 1)
        noise, base = self.noise_um2[at], self.share[at] * motion
        told = (noise + base) ** 2 / (noise**2 / self.noise_told[at] + base**2 / self.share_told[at])
        return noise, base, told

    def counted(self, sizes: NDArray[np.integer], noise: Samples, missed: Samples) -> Samples:
        """As how many coefficients a block counts whose ``sizes`` coefficients hold noise and something missed, each of
        this power: noise says something new in each of them, what is missed is smooth and says it once. No less is
        taken to be missed than what the power of noise differs from block to block by chance."""
        if not self.at_rest:
            return np.ones(np.shape(missed))
        missed = missed + noise * np.sqrt(2 / sizes)
        return np.asarray(sizes * (noise + missed) / (noise + sizes * missed))


def expected_of(runs: Sequence[BlockedRun], motions: Sequence[Samples]) -> Expected:
    """From the reference records among the runs, or without them from a prior; ``motions`` are the powers (blocks,) of
    the base, spread."""
    first = min(int(run.octaves.min()) for run in runs)
    count = max(int(run.octaves.max()) for run in runs) - first + 1
    references = [i for i, run in enumerate(runs) if run.modelled.run.role == "reference"]
    told_by = references or list(range(len(runs)))
    left = {i: runs[i].power(runs[i].modelled.error()) for i in told_by}
    idle = [i for i in told_by if runs[i].modelled.run.idle]
    rows = [
        (runs[i].octaves - first, left[i], motions[i], np.full(len(left[i]), i in idle), runs[i].sizes) for i in told_by
    ]
    octave, power, motion, at_rest, sizes = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    noise, noise_told = _noise(octave, power, at_rest, sizes, count)
    untold = np.full(count, UNTOLD)
    if not references:
        floor = np.full(count, float(np.min(noise)))
        noise, noise_told = (noise, noise_told) if idle else (floor, untold)
        return Expected(first, noise, np.full(count, BASE_SHARE**2), noise_told, untold, bool(idle))
    driven = ~at_rest
    if not driven.any():
        return Expected(first, noise, np.full(count, BASE_SHARE**2), noise_told, untold, bool(idle))
    octave, power, motion = octave[driven], power[driven], motion[driven]
    share = _likeliest_share(octave, power, motion, noise)
    blocks = np.bincount(octave, minlength=count).astype(float)
    near = _smooth(blocks)
    share_told = np.where(near > 0, near**2 / np.maximum(_smooth_squared(blocks), 1e-30), UNTOLD)
    # Records differ in their noise too: it is never known better than what the base misses.
    return Expected(first, noise, share, np.minimum(noise_told, share_told), share_told, bool(idle))


def _likeliest_share(octave: Samples, power: Samples, motion: Samples, noise: Samples) -> Samples:
    """Share (octaves,) of the motion under which what blocks show is most likely, each block one coefficient and those
    of the octaves beside it counting too; where no block tells, the prior. Not the ratio of what is missed in all to
    what moves in all: the block that moves most would decide, and where little moves nothing would be expected."""
    apart = np.abs(np.arange(len(noise))[:, None] - octave)
    weights = np.select([apart == 0, apart == 1], [NEIGHBOURS[1], NEIGHBOURS[0]], 0.0)
    share = np.full(len(noise), BASE_SHARE**2)
    for _ in range(SETTLING):
        variance = noise[octave] + share[:, None] * motion
        wanted = (weights * motion * power / variance**2).sum(axis=1)
        share *= np.sqrt(wanted / np.maximum((weights * motion / variance).sum(axis=1), 1e-300))
    return np.where((weights * motion).any(axis=1), share, BASE_SHARE**2)


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
