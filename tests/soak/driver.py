"""Builds the soak driver, and runs a long life of a device: make soak.

python tests/soak/driver.py [--ticks 1e8] [--hours 24] [--seed 1]

Prints what was seen; exits 1 where an invariant broke.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
FIRMWARE = [*ROOT.glob("firmware/core/*.c"), *ROOT.glob("firmware/app/*.c"), ROOT / "firmware/port/host/flash.c"]
SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
TICKS_A_SEED = 10_000_000


def build(output: Path, *flags: str) -> Path:
    """The driver. Without the sanitizers where the compiler has no libraries for them."""
    command = [os.environ.get("CC", "cc"), "-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'firmware'}"]
    command += [f"-I{HERE}", *map(str, sorted(HERE.glob("*.c"))), *map(str, sorted(FIRMWARE)), "-o", str(output)]
    if subprocess.run([*command, *flags], capture_output=True, text=True, check=False).returncode:
        subprocess.run([*command, "-O2"], check=True)
    return output


def run(driver: Path, *arguments: object) -> dict[str, Any]:
    """What a life printed. Raises RuntimeError with the invariant that broke."""
    command = [str(driver), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    seen: dict[str, Any] = json.loads(done.stdout)
    return seen


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ticks", type=float, default=1e8, help="of random lives, in all")
    parser.add_argument("--hours", type=float, default=24, help="of a day's work")
    parser.add_argument("--seed", type=int, default=1, help="of the first life")
    arguments = parser.parse_args()
    folder = ROOT / "out" / "soak"
    folder.mkdir(parents=True, exist_ok=True)
    driver = build(folder / "soak", "-O2")
    try:
        for i in range(round(arguments.ticks / TICKS_A_SEED)):
            print(json.dumps(run(driver, "random", arguments.seed + i, TICKS_A_SEED)), flush=True)
        if arguments.hours:
            print(json.dumps(run(driver, "day", arguments.hours)))
    except RuntimeError as broken:
        print(broken, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
