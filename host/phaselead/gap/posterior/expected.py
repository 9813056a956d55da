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
    told: float
    """As many coefficients as tell it: degrees of freedom of Student's t."""

    def of(self, run: BlockedRun, motion: Samples) -> tuple[Samples, Samples]:
        """Noise and misfit (blocks,) in um^2 per coefficient of a run whose base has this power (blocks,)."""
        at = np.clip(run.octaves - self.first, 0, len(self.share) - 1)
        return self.noise_um2[at], self.share[at] * motion


def expected_of(runs: Sequence[BlockedRun], motions: Sequence[Samples]) -> Expected:
    """From the reference records among the runs, or without them from a prior; ``motions`` are the powers (blocks,) of
    the base, spread."""
    first = min(int(run.octaves.min()) for run in runs)
    count = max(int(run.octaves.max()) for run in runs) - first + 1
    references = [i for i, run in enumerate(runs) if run.modelled.run.role == "reference"]
    told_by = references or list(range(len(runs)))
    left = {i: runs[i].power(runs[i].modelled.error()) for i in told_by}
    idle = [i for i in told_by if runs[i].modelled.run.idle]
    rows = [(runs[i].octaves - first, left[i], motions[i], np.full(len(left[i]), i in idle)) for i in told_by]
    octave, power, motion, at_rest = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    noise = _noise(octave, power, at_rest, count)
    if not references:
        floor = np.full(count, float(np.min(noise)))
        return Expected(first, noise if idle else floor, np.full(count, BASE_SHARE**2), UNTOLD)
    driven = ~at_rest
    if not driven.any():
        return Expected(first, noise, np.full(count, BASE_SHARE**2), UNTOLD)
    beyond = np.maximum(power[driven] - noise[octave[driven]], 0.0)
    missed = _smooth(np.bincount(octave[driven], beyond, count).astype(float))
    moved = _smooth(np.bincount(octave[driven], motion[driven], count).astype(float))
    share = missed / np.maximum(moved, 1e-30)
    effective = 1 / float(np.sum(np.square(NEIGHBOURS)))
    return Expected(first, noise, share, effective * max(len(references) - len(idle), 1))


def _noise(octave: Samples, power: Samples, at_rest: Samples, count: int) -> Samples:
    """Noise (octaves,): of the records at rest, or of the quietest where none is."""
    found = np.full(count, np.nan)
    for o in range(count):
        here = octave == o
        if (here & at_rest).any():
            found[o] = power[here & at_rest].mean()
        elif here.any() and not at_rest.any():
            found[o] = power[here].min()
    known = np.flatnonzero(np.isfinite(found))
    filled = np.interp(np.arange(count), known, found[known])
    return np.maximum(_smooth(filled) / _smooth(np.ones(count)), LEAST_UM2)


def _smooth(values: NDArray[np.floating]) -> Samples:
    return np.asarray(np.convolve(values, NEIGHBOURS, mode="same"))
