"""Branch coverage of firmware/core and firmware/app by their own tests, with gcov: make coverage, a part of make test.

Without wire.c, which is generated: half of it is what only a host would call; tests/wire tries each message both ways.
The tests run once more here, with few examples of each property, and a shorter soak: what a branch does is judged by
make test, this asks only whether it was taken.

python tests/coverage_of_c.py [--least 95] [-n 2]    exits 1 where fewer branches were taken
"""

from __future__ import annotations

import argparse
import os
import runpy
import shutil
import subprocess
import sys

from firmware_tree import ROOT, FirmwareTree
from left_out import left_out

TESTS = ("tests/core", "tests/app", "tests/wire")
LEFT_OUT = ("tests/core/test_builds.py", "tests/core/test_arrows.py", "tests/wire/test_neighbours.py")
"""They read and compile the source, and run none of it that others do not."""
LIFE = ("random", 1, 2_000_000)
"""Of tests/soak: seed and ticks."""
GCOV_FLAGS = ("--coverage", "-O0", "-fno-sanitize=all")
"""Without optimisation, so that every branch of the source is one of the machine's, and without those that sanitizers
add."""


def take_branches(tree: FirmwareTree, processes: str) -> str:
    """Runs the tests and a life of the device; what they said where they failed."""
    ignored = [f"--ignore={path}" for path in LEFT_OUT]
    plugin = ("-p", "few_examples")
    done = tree.test("-n", processes, *plugin, "--basetemp", str(tree.folder / "tests-built"), *ignored, *TESTS)
    if done.returncode:
        return done.stdout + done.stderr
    print(done.stdout.splitlines()[-1])
    os.environ["CC"] = str(tree.compiler)
    soak = runpy.run_path(str(tree.folder / "tests" / "soak" / "driver.py"))
    try:
        soak["run"](soak["build"](tree.folder / "soak-driver"), *LIFE)
    except RuntimeError as broken:
        return str(broken)
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--least", type=float, default=95.0, help="per cent of all branches")
    parser.add_argument("-n", default="0", help="processes")
    arguments = parser.parse_args()
    if shutil.which("gcov") is None or shutil.which("gcc") is None:
        return int(left_out("branch coverage of firmware/core and firmware/app", ["gcc"]))
    folder = ROOT / "out" / "coverage"
    tree = FirmwareTree(folder / "tree", *GCOV_FLAGS)
    if not tree.build():
        print("the firmware does not compile with gcc --coverage", file=sys.stderr)
        return 1
    if said := take_branches(tree, arguments.n):
        print(said, file=sys.stderr)
        return 1
    gcovr = [sys.executable, "-m", "gcovr", "--root", str(tree.folder), "--txt-metric", "branch"]
    gcovr += ["--filter", "firmware/core/", "--filter", "firmware/app/", "--exclude", "firmware/app/wire.c"]
    gcovr += ["--html-details", str(folder / "index.html"), "--txt", "-", "--merge-mode-functions", "separate"]
    gcovr += ["--fail-under-branch", str(arguments.least)]
    return subprocess.run([*gcovr, str(tree.folder)], cwd=tree.folder, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
