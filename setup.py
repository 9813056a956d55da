"""Builds the firmware and the stage kernels as plain shared libraries.

They hold no Python API (they are called through ctypes), so no Python headers are needed.
"""

import runpy
import sys
from glob import glob
from pathlib import Path

from setuptools import Extension, setup

ROOT = Path(__file__).parent
build_id = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"]

# Contraction would let one compiler fuse a multiply-add that another does not.
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-strict-aliasing", "-Wall", "-Wextra", "-fvisibility=hidden"]


# A QEMU plugin: its QEMU functions are found when QEMU loads it, which only Linux allows.
EMULATOR = [
    Extension(
        "phaselead.sim._emulator",
        sources=sorted(glob("host/phaselead/sim/emulator/*.c")),
        depends=glob("host/phaselead/sim/emulator/*.h"),
        extra_compile_args=["-std=gnu11", "-O2", "-Wall", "-Wextra", "-fvisibility=hidden"],
        libraries=["dl"],
    )
]

setup(
    ext_modules=[
        Extension(
            "phaselead.sim._firmware",
            sources=sorted(
                glob("firmware/core/*.c")
                + glob("firmware/app/*.c")
                + glob("firmware/port/host/*.c")
                + glob("host/phaselead/sim/kernel/*.c")
            ),
            depends=sorted(glob("firmware/**/*.h", recursive=True) + glob("host/phaselead/sim/kernel/*.h")),
            include_dirs=["firmware", "host/phaselead/sim/kernel"],
            define_macros=[("PHASELEAD_BUILD_ID", f'"{build_id(ROOT)}"')],
            extra_compile_args=FLAGS,
            libraries=["m"],
        ),
        Extension(
            "phaselead.gap._kernel",
            sources=sorted(glob("host/phaselead/gap/kernel/*.c")),
            include_dirs=["host/phaselead/gap/kernel"],
            extra_compile_args=[*FLAGS, "-O3"],
        ),
        Extension(
            "phaselead.model._kernel",
            sources=sorted(glob("host/phaselead/model/*.c") + glob("host/phaselead/model/effects/*.c")),
            depends=sorted(glob("host/phaselead/model/**/*.h", recursive=True)),
            include_dirs=["host/phaselead/model"],
            extra_compile_args=[*FLAGS, "-O3"],
            libraries=["m"],
        ),
        *(EMULATOR if sys.platform == "linux" else []),
    ]
)
