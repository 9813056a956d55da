"""Whether a loop can be over a push in 10 ms: two loops on the linear plant of the built-in stage, as docs/tracking.md
has it.

Both keep a peak sensitivity of 2 over local gains of 12.2 to 28.6 um/V and modes 10 % down and up. The first is what
`phaselead tune` shapes on this plant; the second was searched for the least that is left 10 ms after a push, at the
flattest of the gains. Prints, by mode (rows at 0.9, 1, 1.1) and local gain, when a push of 1 um on the stage is within
5 %.
"""

from __future__ import annotations

import numpy as np

from phaselead.control.feedback_loop import pid_response, plant_response
from phaselead.control.tuning.shaping import Range, predicted
from phaselead.model import Gains, LoopFilter, small_signal
from phaselead.sim import built_in

LOOPS = {
    "as tune shapes it": Gains(
        kp_V_per_um=0.1791,
        ki_V_per_um_s=57.29,
        kd_V_s_per_um=6.387e-05,
        filters=(LoopFilter(zeros_Hz=167.2, zeros_zeta=0.08492, poles_Hz=117.1, poles_zeta=0.4114),
                 LoopFilter(zeros_Hz=2000.0, zeros_zeta=0.9994, poles_Hz=2000.0, poles_zeta=0.3)),
    ),
    "for the push": Gains(
        kp_V_per_um=0.212,
        ki_V_per_um_s=59.41,
        kd_V_s_per_um=7.568e-05,
        filters=(LoopFilter(zeros_Hz=156.9, zeros_zeta=0.1111, poles_Hz=101.2, poles_zeta=0.5134),
                 LoopFilter(zeros_Hz=2000.0, zeros_zeta=0.9931, poles_Hz=2000.0, poles_zeta=0.3)),
    ),
}  # fmt: skip
TICK_HZ, LENGTH_s, BACK = 5000, 1.0, 0.05


def main() -> None:
    plant, over = small_signal(built_in("xyz250").axis("x")), Range((12.2, 28.6), 0.1, 2.0)
    ticks = round(LENGTH_s * TICK_HZ)
    f_Hz = np.arange(1, ticks // 2 + 1) / LENGTH_s
    for name, gains in LOOPS.items():
        found = predicted(plant, gains, over)
        print(f"{name}: peak S {found.peak_sensitivity:.2f}, bandwidth from {found.bandwidth_Hz[0]:.0f} Hz")
        for moved in over.plants(plant):
            stage = plant_response(moved, f_Hz)
            pushed = stage / (1 + over.gains()[:, None] * stage * pid_response(gains, f_Hz))
            way = np.cumsum(np.fft.irfft(np.pad(pushed, ((0, 0), (1, 0)))), axis=1)
            off = np.abs(way - way[:, -100:].mean(axis=1, keepdims=True))[:, : ticks // 2] > BACK
            print("  ms:", [f"{(np.flatnonzero(row)[-1] + 1) / TICK_HZ * 1e3:.1f}" for row in off])


if __name__ == "__main__":
    main()
