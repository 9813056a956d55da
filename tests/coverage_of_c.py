"""Branch coverage of firmware/core and firmware/app by their own tests, with gcov: make coverage.

Without wire.c, which is generated: half of it is what only a host would call; tests/wire tries each message both ways.

python tests/coverage_of_c.py [--least 95] [-n 2]    exits 1 where fewer branches were taken
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from firmware_tree import ROOT, FirmwareTree

TESTS = ("tests/core", "tests/app", "tests/soak", "tests/wire")
LEFT_OUT = ("tests/core/test_builds.py", "tests/core/test_arrows.py", "tests/wire/test_neighbours.py")
"""They read and compile the source, and run none of it that others do not."""
GCOV_FLAGS = ("--coverage", "-O0", "-fno-sanitize=all")
"""Without optimisation, so that every branch of the source is one of the machine's, and without those that sanitizers
add."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--least", type=float, default=95.0, help="per cent of all branches")
    parser.add_argument("-n", default="0", help="processes")
    arguments = parser.parse_args()
    folder = ROOT / "out" / "coverage"
    tree = FirmwareTree(folder / "tree", *GCOV_FLAGS)
    if not tree.build():
        print("the firmware does not compile with gcc --coverage", file=sys.stderr)
        return 1
    ignored = [f"--ignore={path}" for path in LEFT_OUT]
    done = tree.test("-n", arguments.n, "--basetemp", str(tree.folder / "tests-built"), *ignored, *TESTS)
    print(done.stdout.splitlines()[-1])
    if done.returncode:
        print(done.stdout, done.stderr, file=sys.stderr)
        return 1
    gcovr = [sys.executable, "-m", "gcovr", "--root", str(tree.folder), "--txt-metric", "branch"]
    gcovr += ["--filter", "firmware/core/", "--filter", "firmware/app/", "--html-details", str(folder / "index.html")]
    gcovr += [
        "--exclude",
        "firmware/app/wire.c",
        "--txt",
        "-",
        "--merge-mode-functions",
        "separate",
        "--fail-under-branch",
        str(arguments.least),
    ]
    return subprocess.run([*gcovr, str(tree.folder)], cwd=tree.folder, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
