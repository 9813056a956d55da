"""What it costs to start: time as a ratio to that of ``python -c pass``, and peak memory.

Run with `make bench`. Prints medians; judges nothing. It loads nothing large itself: a process that is begun by a large
one is said to have used as much memory.
"""

from __future__ import annotations

import os
import sys
import time
from statistics import median

RUNS = 15
LEAST = "python -c pass"
COMMANDS = {
    LEAST: ("-c", "pass"),
    "import phaselead": ("-c", "import phaselead"),
    "phaselead --help": ("-m", "phaselead", "--help"),
    "phaselead ports": ("-m", "phaselead", "ports"),
    "phaselead status": ("-m", "phaselead", "status"),
}


def start(arguments: tuple[str, ...]) -> tuple[float, float]:
    """Seconds and peak memory in MB of a fresh process."""
    quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    begin = time.perf_counter()
    process = os.posix_spawn(sys.executable, [sys.executable, *arguments], os.environ, file_actions=quiet)
    _, status, usage = os.wait4(process, 0)
    elapsed_s = time.perf_counter() - begin
    assert status == 0, f"python {' '.join(arguments)} failed"
    return elapsed_s, usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)  # bytes there, kilobytes elsewhere


def main() -> None:
    """Every command in turn, so that a busy minute of the machine falls on all alike."""
    runs = [{name: start(arguments) for name, arguments in COMMANDS.items()} for _ in range(RUNS + 1)][1:]
    least_s = median(run[LEAST][0] for run in runs)
    for name in COMMANDS:
        elapsed_s, memory_MB = (median(values) for values in zip(*(run[name] for run in runs), strict=True))
        print(f"{name}: {elapsed_s / least_s:.1f} x {LEAST} ({elapsed_s:.3f} s), peak memory {memory_MB:.0f} MB")


if __name__ == "__main__":
    main()
