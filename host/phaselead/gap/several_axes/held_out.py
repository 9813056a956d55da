"""Predictions of several axes on held-out records, and whether one model is better than another beyond chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.several_axes.joint_records import JointRecord
from phaselead.identify import common_period
from phaselead.model import Stage, predict
from phaselead.record import Recording, Samples

COMPARED_BLOCK_s, FEWEST_COMPARED = 0.25, 8
"""Length of the blocks over which squares are compared, and how many a record must have."""
LEAST_Z = 3.3
"""Of the mean saving over blocks, for an improvement beyond chance."""
LEAST_SAVED = 0.02
"""Share of the squares that an effect must save to be named, and that may remain above the floor: nobody cares for
less."""

Answer = Callable[[JointRecord], Samples]


@dataclass(frozen=True)
class Improvement:
    """Share of the squared error that one model saves against another, and the z of that over blocks."""

    saved: float
    z: float

    @property
    def pays(self) -> bool:
        """Whether it is beyond chance and large enough to count."""
        return self.z > LEAST_Z and self.saved > LEAST_SAVED


@dataclass(frozen=True)
class HeldOutPrediction:
    """Model and measured position (n,) in um by axis and record, over the scored rows and about the same mean."""

    model_um: Mapping[str, Sequence[Samples]]
    measured_um: Mapping[str, Sequence[Samples]]

    def errors(self, axis: str) -> list[Samples]:
        """Measured minus model (n,) in um, for each record."""
        return [x - y for x, y in zip(self.measured_um[axis], self.model_um[axis], strict=True)]

    def rms(self, axis: str) -> float:
        """Error of one axis over all records, in um."""
        return float(np.sqrt(np.mean(np.concatenate(self.errors(axis)) ** 2)))

    def share_of_output(self, record: int) -> float:
        """Error of one record over its output, each rms over all axes."""
        error = sum(float(np.sum(self.errors(axis)[record] ** 2)) for axis in self.model_um)
        output = sum(float(np.sum((x[record] - x[record].mean()) ** 2)) for x in self.measured_um.values())
        return float(np.sqrt(error / output))

    @property
    def share_left(self) -> float:
        """Power of the error over that of the output, mean over records."""
        records = len(next(iter(self.model_um.values())))
        return float(np.mean([self.share_of_output(i) ** 2 for i in range(records)]))


def predict_held_out(stage: Stage, holdout: Sequence[Recording], axes: Sequence[str]) -> HeldOutPrediction:
    """The positions that a stage predicts for records, beside the measured ones."""
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
    return HeldOutPrediction(model, measured)


def improvement(held_out: Sequence[JointRecord], before: Answer, after: Answer, axis: int | None = None) -> Improvement:
    """What the model ``after`` saves against ``before`` on one axis, or on all.

    Squares are compared block by block, each record in units of its own output.
    """
    saved, left = [], []
    for record in held_out:
        x = _scored(record.x_um, record, axis)
        size = float(np.sum(x**2)) or 1.0
        was, now = (
            np.sum((x - _scored(answer(record), record, axis)) ** 2, axis=1) / size for answer in (before, after)
        )
        length = max(1, min(round(COMPARED_BLOCK_s / record.step_s), len(x) // FEWEST_COMPARED))
        edges = np.arange(0, len(x) - length + 1, length)
        saved.append(np.add.reduceat(was - now, edges))
        left.append(float(was.sum()))
    gained = np.concatenate(saved)
    spread = float(gained.std(ddof=1)) if len(gained) > 1 else np.inf
    z = float(gained.mean() / spread * np.sqrt(len(gained))) if spread > 0 else 0.0
    return Improvement(float(gained.sum()) / max(sum(left), 1e-300), z)


def _scored(x: Samples, record: JointRecord, axis: int | None) -> Samples:
    part = x[record.rows] if axis is None else x[record.rows, axis : axis + 1]
    return np.asarray(part - part.mean(axis=0))


def noise_um(held_out: Sequence[JointRecord], axis: int) -> float | None:
    """Rms (um) of what does not repeat from period to period; None where the drives are not periodic."""
    period = common_period([s.experiment for s in held_out])
    if period is None:
        return None
    differences = []
    for s in held_out:
        x = s.x_um[s.rows.start - period : s.rows.stop, axis]
        differences.append(x[period:] - x[:-period])
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2) / 2))
