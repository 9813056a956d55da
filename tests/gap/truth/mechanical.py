"""Hidden in the mechanics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .linear import mode
from .memory import Friction
from .stage import Effect

Samples = NDArray[np.float64]


class Resonance(Effect):
    """A second mode beside the base's, as when a part works loose: it carries half of the motion at size 1."""

    name, unit, typical = "resonance", "1", 0.5
    family = "modal state integrated on a grid eight times finer"

    def prepare(self) -> None:
        base, low, top = self.stage.f_Hz, 0.036 * self.stage.rate_Hz, 0.2 * self.stage.rate_Hz
        tries = np.exp(self.rng.uniform(np.log(low), np.log(top), 40))
        away = tries[np.abs(np.log(tries / base)) > np.log(1.3)]
        self.f_Hz, self.zeta = float(away[0]), float(np.exp(self.rng.uniform(np.log(0.005), np.log(0.05))))
        self.part = mode(self.f_Hz, self.zeta, self.stage.fine_s)

    def mechanical(self, x: Samples) -> Samples:
        return x + self.value * (self.part.step(x) - x)


class LoadChange(Effect):
    """Mass on the stage at constant stiffness and damping: the base's own mode, integrated anew."""

    name, unit, typical = "load_change", "of moving mass", 0.1
    family = "the base's modal state with another mass"

    def mode(self, f_Hz: float, zeta: float) -> tuple[float, float]:
        factor = (1 + self.value) ** -0.5
        return f_Hz * factor, zeta * factor


class Backlash(Effect):
    """Slack with soft flanks: an elasto-plastic element on the motion itself (the catalogue has a play)."""

    name, unit, typical = "backlash", "of range", 0.002
    family = "one elasto-plastic (Dahl) element in the transmission"

    def prepare(self) -> None:
        self.flank = Friction(self.value * self.stage.range_um / 2, start=0.0)

    def mechanical(self, x: Samples) -> Samples:
        return x - self.flank.step(x)


EFFECTS = (Resonance, LoadChange, Backlash)
