"""Builds the firmware and the kernels as plain shared libraries.

They hold no Python API (they are called through ctypes): no Python headers are needed, their names carry no Python
version, and a wheel fits every Python 3 of its platform.
"""

import runpy
import sys
import tempfile
from glob import glob
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.errors import CompileError

ROOT = Path(__file__).parent
build_id = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"]

PAGES = {"docs/faults.md": "phaselead/device"}

SUFFIX = EXTENSION_SUFFIXES[-1]
"""The plain one, .so or .pyd; phaselead/compiled.py looks for the same."""

# Contraction would let one compiler fuse a multiply-add that another does not.
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-strict-aliasing", "-Wall", "-Wextra", "-fvisibility=hidden"]


class BuildLibraries(build_ext):
    """Shared libraries that do without Python, compiled with those flags that the compiler knows."""

    def build_extensions(self):
        if self.compiler.compiler_type == "msvc":
            raise SystemExit("phaselead: Microsoft's compiler cannot build the C parts; use gcc or clang (MinGW-w64)")
        flags = dict.fromkeys(flag for extension in self.extensions for flag in extension.extra_compile_args)
        known = {flag: self.knows(flag) for flag in flags}
        for extension in self.extensions:
            extension.extra_compile_args = [flag for flag in extension.extra_compile_args if known[flag]]
        super().build_extensions()

    def knows(self, flag):
        """Whether the compiler takes this flag without a word."""
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "probe.c"
            source.write_text("int probe(void);\nint probe(void) { return 0; }\n")
            try:
                self.compiler.compile([str(source)], output_dir=folder, extra_postargs=["-Werror", flag])
            except CompileError:
                print(f"note: this compiler does not know {flag}; built without it", file=sys.stderr)
                return False
        return True

    def get_ext_filename(self, fullname):
        return str(Path(*fullname.split("."))) + SUFFIX

    def get_export_symbols(self, ext):
        return ext.export_symbols  # no PyInit_...

    def get_libraries(self, ext):
        return ext.libraries  # not Python's


class WithPages(build_py):
    """Puts the pages of the manual that commands print beside the modules that read them."""

    def run(self):
        super().run()
        if not self.editable_mode:
            for page, folder in PAGES.items():
                self.copy_file(str(ROOT / page), str(Path(self.build_lib) / folder))


class AnyPython3(bdist_wheel):
    """Tags the wheel py3-none-PLATFORM."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


def below(pattern):
    """Files of the source tree, in an order that does not depend on the file system."""
    return sorted(glob(pattern, recursive=True))


# A QEMU plugin: its QEMU functions are found when QEMU loads it, which only Linux allows.
EMULATOR = Extension(
    "phaselead.sim._emulator",
    sources=below("host/phaselead/sim/emulator/*.c"),
    depends=below("host/phaselead/sim/emulator/*.h"),
    extra_compile_args=["-std=gnu11", "-O2", "-Wall", "-Wextra", "-fvisibility=hidden"],
    libraries=["dl"],
)

setup(
    cmdclass={"build_ext": BuildLibraries, "build_py": WithPages, "bdist_wheel": AnyPython3},
    ext_modules=[
        Extension(
            "phaselead.sim._firmware",
            sources=below("firmware/core/*.c")
            + below("firmware/app/*.c")
            + below("firmware/port/host/*.c")
            + below("host/phaselead/sim/kernel/*.c"),
            depends=below("firmware/**/*.h") + below("host/phaselead/sim/kernel/*.h"),
            include_dirs=["firmware", "host/phaselead/sim/kernel"],
            define_macros=[("PHASELEAD_BUILD_ID", f'"{build_id(ROOT)}"')],
            extra_compile_args=FLAGS,
            libraries=["m"],
        ),
        Extension(
            "phaselead.model._kernel",
            sources=below("host/phaselead/model/**/*.c"),
            depends=below("host/phaselead/model/**/*.h"),
            include_dirs=["host/phaselead/model"],
            extra_compile_args=[*FLAGS, "-O3"],
            libraries=["m"],
        ),
        *([EMULATOR] if sys.platform == "linux" else []),
    ],
)
