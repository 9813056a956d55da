"""A stretch of the scope's samples as a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.record import AxisRecord, Recording, write_hdf5
from phaselead.scope.samples import TRACES, Samples


def save(samples: Samples, first: int, ticks: int, zero_tick: int, path: Path, meta: dict[str, str]) -> Recording:
    """Writes every tick of a stretch as HDF5; t_s = 0 is ``zero_tick``. Ticks that did not come are gaps.

    Feed-forward and feedback stand under ``/device``. Raises BadInput where no tick has come, and for a file that
    exists.
    """
    rows = samples.rows(first, ticks).astype(np.float64)
    came = np.isfinite(rows[:, TRACES.index("x_um")]).all(axis=0)
    if came.sum() < 2:
        raise BadInput("nothing has come yet that could be saved; wait for the traces")
    ticks_there = np.flatnonzero(came) + first
    gaps = missing_between(ticks_there)
    axes, effort = {}, {}
    for axis, one in zip(samples.axes, rows[..., came], strict=True):
        by_name = dict(zip(TRACES, one, strict=True))
        followed = bool(np.isfinite(by_name["r_um"]).all())
        axes[axis] = AxisRecord(by_name["u_V"], by_name["x_um"], by_name["r_um"] if followed else None)
        effort[axis] = {"feedforward_V": by_name["ff_V"], "feedback_V": by_name["fb_V"]}
    facts = {
        "gaps": gaps,
        "missing_ticks": sum(ticks for _, ticks in gaps),
        "start_tick": zero_tick,
    }
    recording = Recording((ticks_there - zero_tick) / TICK_HZ, axes, source=str(path), meta=facts | meta)
    write_hdf5(path, recording, device={"tick": ticks_there, **effort}, overwrite=False)
    return recording


def missing_between(ticks: NDArray[np.int64]) -> list[list[int]]:
    """First tick and length of every gap between ticks that came, whatever became of the others: a stretch that begins
    or ends within a gap begins after it or ends before it."""
    steps = np.diff(ticks)
    return [[int(ticks[i]) + 1, int(steps[i]) - 1] for i in np.flatnonzero(steps > 1)]
