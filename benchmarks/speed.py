"""Speed of the firmware in the loop as a ratio to real time: firmware, stage, recorder, codec and decoding counted.

Run with `make bench`. Prints the median and the spread of several runs; judges nothing.
"""

from __future__ import annotations

import statistics
import time

from phaselead.control.gains import PAPER_GAINS
from phaselead.link.device import Device

SECONDS = 60.0
RUNS = 5
TICK_RATE_HZ = 5000


def loop_ratio(axes: str) -> float:
    """Virtual seconds per wall second: the axes track 60 um at 5 Hz, every channel is streamed and decoded."""
    with Device.open("sim://xyz250") as device:
        for axis in axes:
            device.set_axis(axis, "pid", **PAPER_GAINS.model_dump())
            device.set_path(axis, "sine", swing=60.0, f_Hz=5.0)
        begin = time.perf_counter()
        capture = device.capture(round(SECONDS * TICK_RATE_HZ), axes=axes)
        elapsed_s = time.perf_counter() - begin
    assert not capture.gaps, "a benchmark that drops samples measures nothing"
    return SECONDS / elapsed_s


def main() -> None:
    for axes in ("x", "xyz"):
        ratios = [loop_ratio(axes) for _ in range(RUNS + 1)][1:]
        print(
            f"firmware in the loop, axes {axes}: {statistics.median(ratios):.0f} x real time "
            f"(min {min(ratios):.0f}, max {max(ratios):.0f}, {RUNS} runs of {SECONDS:g} s)"
        )


if __name__ == "__main__":
    main()
