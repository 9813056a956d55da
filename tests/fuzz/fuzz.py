"""Fuzzing guided by coverage, from the corpora beside this file: make fuzz.

python tests/fuzz/fuzz.py [--seconds 60] [--seed 0] [--parallel 2] [--keep] [--those-installed] [TARGET ...]

Each target runs for so long: the device in C with the address and undefined-behaviour sanitizers (clang's libFuzzer),
what the host reads by atheris. What is found on the way stays in out/fuzz; --keep puts the smallest corpus of the same
coverage in place of the one here. Exits 1 when an input broke something, and says in which file it is; exits 2 where a
fuzzer is missing, or with --those-installed runs the others and says which were left out, a failure in CI.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests"))

from left_out import left_out  # noqa: E402

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
OUT = ROOT / "out" / "fuzz"
SOAK = ROOT / "tests" / "soak"
DEVICE = [
    *(HERE / "device.c", *sorted(SOAK.glob("random_*.c")), SOAK / "invariants.c"),
    *sorted(ROOT.glob("firmware/core/*.c")),
    *sorted(ROOT.glob("firmware/app/*.c")),
    ROOT / "firmware/port/host/flash.c",
]
INCLUDE = [f"-I{ROOT / 'firmware'}", f"-I{SOAK}"]
SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
DEVICE_PACKAGES = ("clang", "libclang-rt-dev")
MISSING_DEVICE = "clang with libclang-rt (sudo apt install clang libclang-rt-dev)"
MISSING_HOST = "atheris (pip install -r requirements-fuzz.lock)"
TARGETS = ("device", "frames", "stage", "csv", "journal")
LONGEST = {"device": 4096, "frames": 2048, "stage": 8192, "csv": 2048, "journal": 24576}
"""Bytes of an input."""
HANGS_S = 300
"""By the clock, for inputs that take milliseconds: a busy machine may let one wait for a while."""
KEPT_LONGEST = 60_000
"""Bytes of all inputs of a target that --keep keeps, shortest first."""


def build_device() -> list[str] | None:
    """The command that fuzzes the device; None without clang's libFuzzer."""
    binary = OUT / "fuzz_device"
    command = ["clang", "-std=c11", *SANITIZE, "-fsanitize=fuzzer", *INCLUDE, *map(str, DEVICE), "-o", str(binary)]
    if shutil.which("clang") is None or subprocess.run(command, capture_output=True, check=False).returncode:
        return None
    return [str(binary)]


def command_of(target: str) -> list[str] | None:
    if target == "device":
        return build_device()
    if importlib.util.find_spec("atheris") is None:
        return None
    return [sys.executable, str(HERE / "one_host_target.py"), target]


def fuzz(target: str, command: list[str], seconds: int, seed: int) -> str:
    """One line that says what came of it; begins with ``broken`` when an input broke something."""
    grown, found = OUT / target, OUT / f"broken-{target}-"
    grown.mkdir(parents=True, exist_ok=True)
    options = [
        f"-max_total_time={seconds}",
        f"-max_len={LONGEST[target]}",
        f"-artifact_prefix={found}",
        f"-timeout={HANGS_S}",
    ]
    options += [f"-seed={seed}", "-print_final_stats=1", "-rss_limit_mb=4096"]
    done = subprocess.run(
        [*command, *options, str(grown), str(CORPUS / target)], capture_output=True, text=True, check=False
    )
    (OUT / f"{target}.log").write_text(done.stderr)
    runs = re.search(r"number_of_executed_units: (\d+)|Done (\d+) runs", done.stderr)
    coverage = re.findall(r"cov: (\d+)", done.stderr)
    counted = next((n for n in runs.groups() if n), "0") if runs else "0"
    said = f"{target}: {counted} executions, coverage {coverage[-1] if coverage else 0}"
    return said if done.returncode == 0 else f"broken {said}; out/fuzz/{target}.log, {found}*"


def keep(target: str, command: list[str]) -> None:
    """The smallest corpus that covers as much."""
    smallest = OUT / f"{target}-smallest"
    shutil.rmtree(smallest, ignore_errors=True)
    smallest.mkdir()
    merge = [
        *command,
        "-merge=1",
        f"-max_len={LONGEST[target]}",
        str(smallest),
        str(CORPUS / target),
        str(OUT / target),
    ]
    subprocess.run(merge, check=True, capture_output=True)
    if not any(smallest.iterdir()):
        print(f"{target}: nothing was merged, the corpus stays")
        return
    shutil.rmtree(CORPUS / target, ignore_errors=True)
    (CORPUS / target).mkdir(parents=True)
    left = KEPT_LONGEST
    for path in sorted(smallest.iterdir(), key=lambda path: (path.stat().st_size, path.name)):
        left -= path.stat().st_size
        if left >= 0:
            shutil.copy2(path, CORPUS / target / path.name[:16])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("targets", nargs="*", default=TARGETS)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--parallel", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="0 is another one each time")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--those-installed", action="store_true")
    arguments = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    found = {target: command_of(target) for target in arguments.targets}
    missing = [target for target, command in found.items() if command is None]
    if missing:
        needs = {MISSING_DEVICE if target == "device" else MISSING_HOST for target in missing}
        print(f"{', '.join(missing)} cannot be fuzzed: install {' and '.join(sorted(needs))}", file=sys.stderr)
        if not arguments.those_installed:
            return 2
        if "device" in missing and left_out("fuzzing of the device", DEVICE_PACKAGES):
            return 1
    commands = {target: command for target, command in found.items() if command is not None}
    with ThreadPoolExecutor(arguments.parallel) as pool:
        results = list(
            pool.map(lambda target: fuzz(target, commands[target], arguments.seconds, arguments.seed), commands)
        )
    print(*results, sep="\n")
    if arguments.keep:
        for target, command in commands.items():
            keep(target, command)
    return 1 if any(line.startswith("broken") for line in results) else 0


if __name__ == "__main__":
    raise SystemExit(main())
