"""Common modes between all actuators and all sensors, and what one record asks of them.

    x_i = sum_j (direct_ij + sum_r (c_ijr w_r^2 + v_ijr w_r s) / (s^2 + 2 zeta_r w_r s + w_r^2)) push_j

``push`` is where an actuator would go without the mechanics, in um from rest. The poles may fall with the levels of
the actuators: p_r (1 - sum_j drop_rj level_j).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.model import Complex, modes_of, shares, states, states_and_slopes
from phaselead.record import Samples


@dataclass(frozen=True)
class Drive:
    """One record of all axes, what drives the modes and what is measured; its first row is how things stood before."""

    push_um: Samples
    """(n, inputs) in um from rest."""
    level: Samples | None
    """(n, inputs) of the actuators, where poles fall with it."""
    x_um: Samples
    """(n, outputs)."""
    rows: slice
    """To be scored."""
    step_s: float

    def states(self, p: Complex, drop: Complex | None) -> Samples:
        """(n, inputs (1 + 2m)): every push, then the states of every mode for each push."""
        return self._columns(p, drop, slice(None), False)

    def scored(self, p: Complex, drop: Complex | None, *, slopes: bool = False) -> Samples:
        """The same over the scored rows; with ``slopes`` those in the poles behind: (rows, inputs (1 + 4m))."""
        return self._columns(p, drop, self.rows, slopes)

    def mean_level(self, split: Samples) -> Samples:
        """Mean over the scored rows of the level that moves each mode (m,); ``split`` (m, inputs): whose, as shares."""
        if self.level is None:
            return np.zeros(len(split))
        return np.asarray(split @ self.level[self.rows].mean(axis=0))

    def _columns(self, p: Complex, drop: Complex | None, rows: slice, slopes: bool) -> Samples:
        moved = drop if self.level is not None else None
        level = self.level if moved is not None else None
        inputs, width = self.push_um.shape[1], 2 * len(p)
        found = np.empty((len(self.push_um[rows]), inputs + inputs * width * (2 if slopes else 1)))
        found[:, :inputs] = self.push_um[rows]
        for j, push in enumerate(self.push_um.T):
            at, behind = inputs + j * width, inputs + (inputs + j) * width
            if slopes:
                seen, slope = states_and_slopes(push, p, self.step_s, level, moved)
                found[:, behind : behind + width] = slope[rows]
            else:
                seen = states(push, p, self.step_s, level, moved)
            found[:, at : at + width] = seen[rows]
        return found


@dataclass(frozen=True)
class ModalModel:
    """Poles (m,) in 1/s that all axes share, and how each actuator drives and each sensor sees them."""

    poles: Complex
    weights: Samples
    """(inputs (1 + 2m), outputs): what each column of ``Drive.states`` counts at each output."""
    inputs: int
    drop: Complex | None = None
    """(m, inputs): relative fall of each pole per unit of each level; None where poles stay."""

    @property
    def f_Hz(self) -> Samples:
        """(m,)."""
        return modes_of(self.poles)[0]

    @property
    def zeta(self) -> Samples:
        """(m,)."""
        return modes_of(self.poles)[1]

    @property
    def direct(self) -> Samples:
        """(outputs, inputs)."""
        return self.weights[: self.inputs].T

    @property
    def residues(self) -> Samples:
        """(outputs, inputs, 2m): weights of the states."""
        m, outputs = len(self.poles), self.weights.shape[1]
        return np.asarray(np.moveaxis(self.weights[self.inputs :].reshape(self.inputs, 2 * m, outputs), 2, 0))

    @property
    def displacement(self) -> Samples:
        """c (outputs, inputs, m)."""
        return shares(self.residues, self.zeta)[0]

    @property
    def velocity(self) -> Samples:
        """v (outputs, inputs, m)."""
        return shares(self.residues, self.zeta)[1]

    @property
    def static(self) -> Samples:
        """(outputs, inputs) um/um."""
        return np.asarray(self.direct + self.displacement.sum(axis=2))

    def participation(self) -> Samples:
        """(m, inputs): what each actuator has of a mode's strain, as shares. A mode's residues are of rank one up to
        noise, shape at the sensors times shape at the actuators."""
        m = len(self.poles)
        found = np.empty((m, self.inputs))
        for r in range(m):
            matrix = self.residues[:, :, 2 * r] - 1j * self.residues[:, :, 2 * r + 1]
            found[r] = np.abs(np.linalg.svd(matrix)[2][0]) ** 2
        return found

    def moved_by(self, change_um: Samples, drive: Drive) -> Samples:
        """What a change (n, inputs) of the pushes does to the positions (n, outputs), at the levels of the record."""
        answer = change_um @ self.direct.T
        level = drive.level if self.drop is not None else None
        for j in range(self.inputs):
            if np.any(change_um[:, j]):
                seen = states(change_um[:, j], self.poles, drive.step_s, level, None if level is None else self.drop)
                answer = answer + seen @ self.residues[:, j].T
        return np.asarray(answer)

    def answer(self, drive: Drive) -> Samples:
        """Positions (n, outputs) in um from rest."""
        return np.asarray(drive.states(self.poles, self.drop) @ self.weights)
