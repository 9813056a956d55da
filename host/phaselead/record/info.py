"""What a recording holds, in a few facts."""

from __future__ import annotations

from typing import Any

import numpy as np

from phaselead.record.recording import Recording


def recording_facts(recording: Recording) -> dict[str, Any]:
    """Length, rate, axes and ranges of a recording, and what its file says of where it came from."""
    facts: dict[str, Any] = {
        **({"source": recording.source} if recording.source else {}),
        "samples": len(recording.t_s),
        "rate_Hz": round(_rate_Hz(recording), 6) if len(recording.t_s) > 1 else None,
        "from_s": float(recording.t_s[0]),
        "to_s": float(recording.t_s[-1]),
        "axes": "".join(recording.axes),
    }
    for name, axis in recording.axes.items():
        for label, unit, values in (("u", "V", axis.u_V), ("x", "um", axis.x_um), ("r", "um", axis.r_um)):
            if values is not None:
                facts[f"{name}_{label}_min_{unit}"] = float(np.min(values))
                facts[f"{name}_{label}_max_{unit}"] = float(np.max(values))
    for key in ("target", "build_id", "mode", "dropped_ticks", "gaps"):
        if key in recording.meta:
            facts[key] = recording.meta[key]
    return facts


def _rate_Hz(recording: Recording) -> float:
    """The rate between gaps: the mean over the record counts lost samples as time without any."""
    return 1 / float(np.median(np.diff(recording.t_s))) if recording.meta.get("gaps") else recording.rate_Hz
