"""A rig: one stage or three, a clock, and records made of waves, open loop or tracking."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.record.recording import AxisRecord, Recording

from .coupling import CrossCoupling
from .stage import Character, Effect, Stage

Samples = NDArray[np.float64]
BLOCK_ROWS = 40
"""Between two looks of the crude controller at the sensor."""


class Rig:
    """Stages by axis, whose memory runs on from record to record; ``now_s`` is absolute time."""

    def __init__(self, characters: Mapping[str, Character], rng: np.random.Generator) -> None:
        self.rng = rng
        self.stages = {axis: Stage(character, rng) for axis, character in characters.items()}
        self.rate_Hz = next(iter(characters.values())).rate_Hz
        self.now_s = float(rng.uniform(0, 20))
        self.coupling: CrossCoupling | None = None

    def switch(self, effects: Mapping[str, Sequence[Effect]], coupling: CrossCoupling | None = None) -> None:
        """From now on these are there."""
        self.coupling = coupling
        for axis, stage in self.stages.items():
            stage.switch(effects.get(axis, ()))

    def pause(self, seconds: float) -> None:
        """Nothing is recorded for so long; memory and drift go on."""
        self.now_s += seconds
        for stage in self.stages.values():
            stage.rest(seconds)

    def record(self, name: str, waves: Mapping[str, Samples]) -> Recording:
        """Drive the axes with voltages (n,), rounded to the converter's codes."""
        t = self._clock(len(next(iter(waves.values()))))
        applied = {axis: self._coded(axis, u) for axis, u in waves.items()}
        x = self._answer(applied, t)
        return self._recording(name, t, {axis: AxisRecord(applied[axis], x[axis]) for axis in x})

    def track(self, name: str, reference_um: Samples) -> Recording:
        """Axis x follows a path (n,) under static feed-forward and a slow PI controller that sees the noisy sensor."""
        t, (axis, stage) = self._clock(len(reference_um)), next(iter(self.stages.items()))
        c, block = stage.character, BLOCK_ROWS
        ahead = (reference_um - c.offset_um) / c.gain_um_per_V
        u, x = np.zeros(len(t)), np.zeros(len(t))
        held = integral = 0.0
        for a in range(0, len(t), block):
            rows = slice(a, min(a + block, len(t)))
            u[rows] = self._coded(axis, np.clip(ahead[rows] + held, 0.0, c.span_V))
            x[rows] = self._answer({axis: u[rows]}, t[rows])[axis]
            error_V = float(np.mean(reference_um[rows] - x[rows])) / c.gain_um_per_V
            integral += 0.12 * error_V
            held = integral + 0.05 * error_V
        stage.motion(np.linspace(u[-1], 0.0, 400))  # parked before the next record, unrecorded
        return self._recording(name, t, {axis: AxisRecord(u, x, reference_um)})

    def _coded(self, axis: str, u: Samples) -> Samples:
        lsb = self.stages[axis].character.lsb_V
        return np.asarray(np.round(u / lsb) * lsb)

    def _clock(self, rows: int) -> Samples:
        t = self.now_s + np.arange(rows) / self.rate_Hz
        self.now_s = float(t[-1])
        return t

    def _answer(self, u: Mapping[str, Samples], t: Samples) -> dict[str, Samples]:
        moved = {axis: stage.motion(u[axis]) for axis, stage in self.stages.items()}
        if self.coupling is not None:
            moved = self.coupling.mixed(moved)
        return {axis: stage.measure(moved[axis], t) for axis, stage in self.stages.items()}

    def _recording(self, name: str, t: Samples, axes: dict[str, AxisRecord]) -> Recording:
        self.pause(float(self.rng.uniform(2, 6)))
        digest = hashlib.sha256(b"".join(a.x_um.tobytes() for a in axes.values() if a.x_um is not None))
        return Recording(t_s=t, axes=axes, source=f"{name}.csv", sha256=digest.hexdigest())
