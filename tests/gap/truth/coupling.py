"""Hidden between the axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .linear import mode
from .stage import Character

Samples = NDArray[np.float64]


class CrossCoupling:
    """Parasitic motion through a flexure with a mode of its own (the catalogue has a share and a lag). At size 1 the
    largest share is 3 %."""

    name, unit, typical = "cross_coupling", "um/um", 0.03
    family = "shares of the other axes' motion through a mode"

    def __init__(self, size: float, stages: Mapping[str, Character], rng: np.random.Generator) -> None:
        self.value = size * self.typical
        self.shares = {
            (to, of): self.value * rng.uniform(0.6, 1.0) * rng.choice([-1.0, 1.0])
            for to in stages
            for of in stages
            if of != to
        }
        self.shares[("x", "y")] = self.value
        first = next(iter(stages.values()))
        self.paths = {
            pair: mode(float(rng.uniform(0.12, 0.3)) * first.rate_Hz, 0.1, first.fine_s) for pair in self.shares
        }

    def mixed(self, moved: Mapping[str, Samples]) -> dict[str, Samples]:
        """Displacements (n,) on the fine grid with what the others add."""
        found = {axis: np.array(x) for axis, x in moved.items()}
        for (to, of), share in self.shares.items():
            found[to] += share * self.paths[to, of].step(moved[of])
        return found
