"""Static analysis of all C of the project: clang-tidy by .clang-tidy, and cppcheck with MISRA C:2012 for core and app.

python tests/static_analysis.py    exits 1 and prints what was found, or in CI what could not be looked for
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from left_out import left_out

ROOT = Path(__file__).resolve().parents[1]
FIRMWARE = ROOT / "firmware"
BOARD = FIRMWARE / "port" / "stm32f4"
KERNELS = [ROOT / "host/phaselead" / room for room in ("model", "sim/kernel")]
INCLUDE = [f"-I{folder}" for folder in (FIRMWARE, *KERNELS, ROOT / "tests/soak")]
HOSTED = ["-std=gnu11", *INCLUDE, '-DPHASELEAD_BUILD_ID="0"']
NEWLIB = Path("/usr/lib/arm-none-eabi/include")
ON_BOARD = [
    *("-std=gnu11", f"-I{FIRMWARE}", "--target=thumbv7em-none-eabi", "-mfloat-abi=soft", "-ffreestanding"),
    *("-idirafter", str(NEWLIB), '-DPHASELEAD_BUILD_ID="0"', "-DPHASELEAD_VERSION=0u"),
    *("-Wno-unknown-attributes", '-DBOOTLOADER_BINARY="bootloader.bin"'),  # GCC has long_call and noclone
    *('-DBOARD_NAME="nucleo_f446re"', '-DBOARD_FILE="port/stm32f4/boards/nucleo_f446re.h"'),
]
"""As platformio.ini compiles it, for one board; the others differ in constants."""
MISRA_EXCEPTIONS = FIRMWARE / "misra-exceptions.txt"
IN_PARALLEL = min(2, os.cpu_count() or 1)


def sources(*folders: Path) -> list[str]:
    return [str(path) for folder in folders for path in sorted(folder.rglob("*.c"))]


def clang_tidy(files: list[str], flags: list[str]) -> list[list[str]]:
    """Commands for some files each: they are started in parallel."""
    command = [str(Path(sys.executable).with_name("clang-tidy")), "--quiet"]
    return [[*command, *files[part::IN_PARALLEL], "--", *flags] for part in range(IN_PARALLEL)]


def misra() -> list[str]:
    command = ["cppcheck", "--std=c11", "--enable=warning,style,performance,portability", "--addon=misra", "-q"]
    command += ["--error-exitcode=1", "--inline-suppr", f"--suppressions-list={MISRA_EXCEPTIONS}", f"-I{FIRMWARE}"]
    return [*command, str(FIRMWARE / "core"), str(FIRMWARE / "app")]


def commands() -> tuple[list[list[str]], bool]:
    """And whether all that must be looked for is."""
    hosted = sources(FIRMWARE / "core", FIRMWARE / "app", FIRMWARE / "port/host", ROOT / "host", ROOT / "tests")
    found, whole = clang_tidy(hosted, HOSTED), True
    if NEWLIB.is_dir():
        found += clang_tidy(sources(BOARD), ON_BOARD)
    elif left_out("static analysis of the port to the board", ["libnewlib-arm-none-eabi"]):
        whole = False
    if shutil.which("cppcheck"):
        found.append(misra())
    elif left_out("MISRA's rules and the rest of cppcheck, for firmware/core and firmware/app", ["cppcheck"]):
        whole = False
    return found, whole


def run(command: list[str]) -> tuple[bool, str]:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode == 0, done.stdout + (done.stderr if done.returncode else "")


def main() -> int:
    todo, whole = commands()
    with ThreadPoolExecutor(IN_PARALLEL) as pool:
        results = list(pool.map(run, todo))
    for fine, said in results:
        if not fine:
            print(*(line for line in said.splitlines() if "Processing file" not in line), sep="\n")
    return 0 if whole and all(fine for fine, _ in results) else 1


if __name__ == "__main__":
    raise SystemExit(main())
