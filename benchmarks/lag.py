"""How often ``fit`` adopts a lag, of stages that have none and of stages that have one of some size.

    python benchmarks/lag.py             # 40 stages without a lag, 40 with each size
    python benchmarks/lag.py 20 0 40     # 20 of each; sizes in us

Every stage has a delay and noise of its own. Steps, a multisine and a small sine, each after a full loop, at 5 kHz.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "identify"))

from any_stage import AMPLIFIER_FINER, ONE_MODE, AnyStage, Array, laboratory

from phaselead.identify.fitting import fit
from phaselead.identify.operator import OperatorFit

RATE_HZ = 5000.0
RECORDS = ("small sine", "steps", "multisine")
SEEDS, SIZES_US = 40, (0.0, 10.0, 20.0, 40.0)
DELAY_ROWS = (1.0, 3.0)


@dataclass(frozen=True)
class _Late(AnyStage):
    """The delay in front of the operator, as behind an amplifier that has no lag."""

    def measure(self, u: Array, rate_Hz: float, seed: int) -> Array:
        if self.delay_s and not self.lag_s:
            rows = np.arange(len(u))
            return replace(self, delay_s=0.0).measure(np.interp(rows - self.delay_s * rate_Hz, rows, u), rate_Hz, seed)
        return super().measure(u, rate_Hz, seed)


def fitted(size_us: float, seed: int) -> OperatorFit:
    rows = np.random.default_rng(seed).integers(*(round(row * AMPLIFIER_FINER) for row in DELAY_ROWS)) / AMPLIFIER_FINER
    stage = _Late(modes=ONE_MODE.modes, delay_s=float(rows) / RATE_HZ, lag_s=1e-6 * size_us)
    return fit(laboratory(stage, RATE_HZ, seed=seed + 1, only=RECORDS))[1].time["x"]


def main() -> None:
    count, *sizes = [float(word) for word in sys.argv[1:]] or [SEEDS]
    for size_us in sizes or SIZES_US:
        each = [fitted(size_us, seed) for seed in range(round(count))]
        lags = [one for one in each if one.lag_s]
        said = f"lag of {size_us:g} us: found in {len(lags)} of {len(each)}"
        if lags:
            errors = np.array([1e6 * one.lag_s - size_us for one in lags])
            held = sum(low <= 1e-6 * size_us <= high for low, high in filter(None, (one.lag_ci95_s for one in lags)))
            said += f"; off by {np.sqrt(np.mean(errors**2)):.2g} us rms; ci95 hold it in {held}"
        print(said, flush=True)


if __name__ == "__main__":
    main()
