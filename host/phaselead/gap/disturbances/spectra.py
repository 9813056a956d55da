"""Spectra of the residual in which disturbances were found, with those of the reference records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from phaselead.gap.disturbances.disturbance import Disturbance, Residuals
from phaselead.gap.findings import Spectrum
from phaselead.record import Samples

SPECTRUM_SEGMENT = 4096


def disturbance_spectra(
    found: Sequence[Disturbance], holdout: Residuals, reference: Residuals, axis: str
) -> list[Spectrum]:
    """One spectrum for each disturbance, over the held-out records at rest or, without any, all held-out ones."""
    if not found:
        return []
    f, seen = _density(holdout)
    before = np.interp(f, *_density(reference)) if reference else None
    return [Spectrum(one.name, axis, f, seen, before) for one in found]


def _density(lefts: Residuals) -> tuple[Samples, Samples]:
    """Frequencies (k,) and amplitude density (k,) in um/sqrt(Hz)."""
    idle = [residual for residual in lefts if residual.run.idle] or list(lefts)
    length = min(SPECTRUM_SEGMENT, *(len(residual.error_um) for residual in idle))
    parts = [welch(residual.error_um, residual.rate_Hz, nperseg=length) for residual in idle]
    return parts[0][0], np.sqrt(np.mean([s for _, s in parts], axis=0))
