"""Speed of the firmware in the loop as a ratio to real time: firmware, stage, recorder, codec and decoding counted; and
the time of ``phaselead fit`` on the grid of the built-in stage, from start to end of the process.

Run with `make bench`. Prints the median and the spread of several runs; judges nothing.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from phaselead.control import PAPER_GAINS
from phaselead.device import TICK_HZ, Device

SECONDS = 60.0
RUNS = 5


def loop_ratio(axes: str) -> float:
    """Virtual seconds per wall second: the axes track 60 um at 5 Hz, every channel is streamed and decoded."""
    with Device.open("sim://xyz250") as device:
        for axis in axes:
            device.set_axis(axis, "pid", **PAPER_GAINS.model_dump())
            device.set_path(axis, "sine", swing=60.0, f_Hz=5.0)
        begin = time.perf_counter()
        capture = device.capture(round(SECONDS * TICK_HZ), axes=axes)
        elapsed_s = time.perf_counter() - begin
    assert not capture.gaps, "a benchmark that drops samples measures nothing"
    return SECONDS / elapsed_s


def phaselead(*arguments: str) -> float:
    """Seconds that the command took."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "phaselead", *arguments], check=True, capture_output=True)
    return time.perf_counter() - begin


def fit_seconds() -> list[float]:
    """Of every run, on the records that identify kept."""
    with tempfile.TemporaryDirectory() as folder:
        grid = Path(folder) / "grid"
        phaselead("identify", "--save", str(grid), "-o", f"{folder}/stage.toml")
        files = [str(file) for file in sorted(grid.iterdir())]
        return [phaselead("fit", *files, "-o", f"{folder}/refit.toml") for _ in range(RUNS)]


def main() -> None:
    for axes in ("x", "xyz"):
        ratios = [loop_ratio(axes) for _ in range(RUNS + 1)][1:]
        print(
            f"firmware in the loop, axes {axes}: {statistics.median(ratios):.0f} x real time "
            f"(min {min(ratios):.0f}, max {max(ratios):.0f}, {RUNS} runs of {SECONDS:g} s)"
        )
    seconds = fit_seconds()
    print(
        f"fit of the built-in grid: {statistics.median(seconds):.1f} s "
        f"(min {min(seconds):.1f}, max {max(seconds):.1f}, {RUNS} runs)"
    )


if __name__ == "__main__":
    main()
