"""A recording larger than the memory: how much memory it takes, and that it is whole.

python benchmarks/big_recording.py --gigabytes 10 --folder out
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import h5py

from phaselead.control import record_to_file
from phaselead.device import TICK_HZ, Device
from phaselead.waveforms import parse_wave

LINE_BYTES_PER_S = 62_600
"""Of one axis with every channel, as its journal keeps them: frames and all."""


def largest_MB() -> float:
    """Most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--gigabytes", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, default=Path("out"))
    options = parser.parse_args()
    seconds = options.gigabytes * 1e9 / LINE_BYTES_PER_S
    options.folder.mkdir(parents=True, exist_ok=True)
    output = options.folder / "big.h5"
    began_s, said = time.monotonic(), 0.0
    journal_bytes = 0

    def progress(done: float) -> None:
        nonlocal said, journal_bytes
        if done >= said:
            journal_bytes = output.with_name("big.h5.journal").stat().st_size if done > 0 else 0
            print(f"{done:4.0%} {journal_bytes / 1e9:8.3f} GB {largest_MB():8.1f} MB", flush=True)
            said += 0.1

    with Device.open("sim://xyz250") as device:
        waves = {"x": parse_wave("sine:5V@5Hz")}
        facts = record_to_file(device, waves, output=str(output), duration_s=seconds, on_progress=progress)
    print(f"     {output.stat().st_size / 1e9:8.3f} GB {largest_MB():8.1f} MB as {output.name}")
    with h5py.File(output) as file:
        ticks = file["device/tick"]
        whole = int(ticks[-1]) - int(ticks[0]) + 1 == len(ticks)
    asked = round(seconds * TICK_HZ)
    print(f"{facts['samples']} of {asked} samples, gaps {facts['gaps']}, every tick in place: {whole}")
    print(f"{time.monotonic() - began_s:.0f} s for {seconds / 3600:.1f} h of recording")
    output.unlink()


if __name__ == "__main__":
    main()
