"""Builds the firmware and the stage kernels as plain shared libraries.

They hold no Python API (they are called through ctypes), so no Python headers are needed.
"""

import hashlib
from glob import glob
from pathlib import Path

from setuptools import Extension, setup

# Contraction would let one compiler fuse a multiply-add that another does not.
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-strict-aliasing", "-Wall", "-Wextra", "-fvisibility=hidden"]


def build_id() -> str:
    """SHA-1 over the firmware's source, names and contents: what the device says it was built from."""
    digest = hashlib.sha1()
    for path in sorted(glob("firmware/**/*.[ch]", recursive=True)):
        digest.update(path.encode() + b"\0" + Path(path).read_bytes())
    return digest.hexdigest()


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
            define_macros=[("PHASELEAD_BUILD_ID", f'"{build_id()}"')],
            extra_compile_args=FLAGS,
            libraries=["m"],
        ),
        Extension(
            "phaselead.stage._kernel",
            sources=sorted(glob("host/phaselead/stage/kernel/*.c")),
            include_dirs=["host/phaselead/stage/kernel"],
            extra_compile_args=[*FLAGS, "-O3"],
            libraries=["m"],
        ),
    ]
)
