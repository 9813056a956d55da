"""Figures of a tracking run: error = reference - position."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from phaselead.record import Samples


@dataclass(frozen=True)
class TrackingError:
    """Errors over a stretch of a run; percentages are of the peak-to-peak that was asked for."""

    max_um: float
    rms_um: float
    range_um: float
    max_pct: float
    max_um_mean_removed: float

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def tracking_error(r_um: Samples, x_um: Samples, asked_um: Samples | None = None) -> TrackingError:
    """Error figures of reference and position, both of shape (n,), n >= 1; percentages are of the path ``asked_um``
    where that is not the reference."""
    error_um = r_um - x_um
    range_um = float(np.ptp(r_um if asked_um is None else asked_um))
    max_um = float(np.max(np.abs(error_um)))
    return TrackingError(
        max_um=max_um,
        rms_um=float(np.sqrt(np.mean(error_um**2))),
        range_um=range_um,
        max_pct=100.0 * max_um / range_um if range_um > 0 else float("nan"),
        max_um_mean_removed=float(np.max(np.abs(error_um - error_um.mean()))),
    )
