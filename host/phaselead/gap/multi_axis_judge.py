"""How far models of several axes are from held-out records, and whether one is better than another beyond chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.multi_axis_records import Stand
from phaselead.identify import common_period
from phaselead.model import Stage, predict
from phaselead.record import Recording, Samples

BLOCK_s, FEWEST_BLOCKS = 0.25, 8
"""Of every record."""
SURE_Z = 3.3
LEAST_SAVED = 0.02
"""Of the squares that are left: an effect that saves less is not worth its name."""

Answer = Callable[[Stand], Samples]


@dataclass(frozen=True)
class Judged:
    """Of a change on held-out records: share of the squares it saves, and by how many deviations of the blocks."""

    saved: float
    z: float

    @property
    def pays(self) -> bool:
        """Beyond chance, and by enough."""
        return self.z > SURE_Z and self.saved > LEAST_SAVED


@dataclass(frozen=True)
class HeldOut:
    """Per axis and record: model (n,) over the scored rows about the record's own offset, and the measured position."""

    model_um: Mapping[str, Sequence[Samples]]
    measured_um: Mapping[str, Sequence[Samples]]

    def errors(self, axis: str) -> list[Samples]:
        """Measured minus model."""
        return [x - y for x, y in zip(self.measured_um[axis], self.model_um[axis], strict=True)]

    def rms(self, axis: str) -> float:
        """um over all records."""
        return float(np.sqrt(np.mean(np.concatenate(self.errors(axis)) ** 2)))

    def share_of_output(self, record: int) -> float:
        """Error over output, rms over all axes of one record."""
        error = sum(float(np.sum(self.errors(axis)[record] ** 2)) for axis in self.model_um)
        return float(np.sqrt(error / sum(float(np.sum(self._moved(axis, record) ** 2)) for axis in self.model_um)))

    @property
    def share_left(self) -> float:
        """Of the power of the positions, mean over records."""
        records = len(next(iter(self.model_um.values())))
        return float(np.mean([self.share_of_output(i) ** 2 for i in range(records)]))

    def _moved(self, axis: str, record: int) -> Samples:
        x = self.measured_um[axis][record]
        return np.asarray(x - x.mean())


def judge(stage: Stage, holdout: Sequence[Recording], axes: Sequence[str]) -> HeldOut:
    """What a stage predicts of records."""
    model: dict[str, list[Samples]] = {a: [] for a in axes}
    measured: dict[str, list[Samples]] = {a: [] for a in axes}
    for recording in holdout:
        predicted = predict(stage, recording)
        for a in axes:
            x, y = recording.axes[a].x_um, predicted.axes[a].x_um
            assert x is not None
            assert y is not None
            x, y = x[recording.scored], y[recording.scored]
            model[a].append(y + float(np.mean(x - y)))
            measured[a].append(x)
    return HeldOut(model, measured)


def pays(held: Sequence[Stand], before: Answer, after: Answer, axis: int | None = None) -> Judged:
    """Of one axis or all: squares in blocks, each record in units of its own output."""
    saved, left = [], []
    for stand in held:
        x = _scored(stand.x_um, stand, axis)
        size = float(np.sum(x**2)) or 1.0
        was, now = (np.sum((x - _scored(answer(stand), stand, axis)) ** 2, axis=1) / size for answer in (before, after))
        length = max(1, min(round(BLOCK_s / stand.step_s), len(x) // FEWEST_BLOCKS))
        edges = np.arange(0, len(x) - length + 1, length)
        saved.append(np.add.reduceat(was - now, edges))
        left.append(float(was.sum()))
    gained = np.concatenate(saved)
    spread = float(gained.std(ddof=1)) if len(gained) > 1 else np.inf
    z = float(gained.mean() / spread * np.sqrt(len(gained))) if spread > 0 else 0.0
    return Judged(float(gained.sum()) / max(sum(left), 1e-300), z)


def _scored(x: Samples, stand: Stand, axis: int | None) -> Samples:
    part = x[stand.rows] if axis is None else x[stand.rows, axis : axis + 1]
    return np.asarray(part - part.mean(axis=0))


def noise_um(held: Sequence[Stand], axis: int) -> float | None:
    """Rms of what does not repeat from period to period; None where the drives do not repeat often enough."""
    period = common_period([s.experiment for s in held])
    if period is None:
        return None
    differences = []
    for s in held:
        x = s.x_um[s.rows.start - period : s.rows.stop, axis]
        differences.append(x[period:] - x[:-period])
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2) / 2))
