"""Spectra of the disturbances that were found, beside those of records without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from phaselead.gap.disturbance import Disturbance
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.residual import RunResidual
from phaselead.gap.result import Spectrum
from phaselead.record import Samples

SEGMENT = 4096


def spectra(found: Sequence[Disturbance], final: FinalFit, axis: str) -> list[Spectrum]:
    """One per disturbance; its idle records where there are any."""
    if not found:
        return []
    f, seen = _density(final.residuals("holdout"))
    reference = final.residuals("reference")
    beside = np.interp(f, *_density(reference)) if reference else None
    return [Spectrum(one.name, axis, f, seen, beside) for one in found]


def _density(lefts: Sequence[RunResidual]) -> tuple[Samples, Samples]:
    idle = [left for left in lefts if left.run.idle] or list(lefts)
    length = min(SEGMENT, *(len(left.error_um) for left in idle))
    parts = [welch(left.error_um, left.rate_Hz, nperseg=length) for left in idle]
    return parts[0][0], np.sqrt(np.mean([s for _, s in parts], axis=0))
