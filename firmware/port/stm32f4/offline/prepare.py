"""Prepares a PLATFORMIO_CORE_DIR in which `pio run` needs no registry: `make toolchain`.

PlatformIO is given what it would download, under the same names and versions: SCons from PyPI, the system's
gcc-arm-none-eabi, and a platform of our own (platform/) with the boards of platformio.ini. The ELF is the same as with
the real one.

    prepare.py CORE_DIR
"""

from __future__ import annotations

import configparser
import json
import shutil
import sys
from pathlib import Path

TOOLCHAIN_VERSION = "1.120301.0"
TOOLS = ("gcc", "g++", "as", "ar", "gcc-ar", "gcc-ranlib", "ranlib", "objcopy", "size", "objdump", "nm")
HERE = Path(__file__).parent
PROJECT = HERE.parents[3]
BOARD = {
    "build": {"cpu": "cortex-m4", "f_cpu": "168000000L", "mcu": "stm32f4"},
    "upload": {"maximum_ram_size": 131072, "maximum_size": 524288, "protocol": "stlink", "protocols": ["stlink"]},
    "url": "https://www.st.com",
    "vendor": "ST",
}
"""What PlatformIO asks of a board; sizes are the smallest board's."""


def write_json(path: Path, content: dict[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", "utf-8")


def mark_installed(package: Path, kind: str, name: str, version: str) -> None:
    """What PlatformIO leaves in a package that it has installed itself."""
    spec = {"owner": "platformio", "id": None, "name": name, "requirements": None, "uri": None}
    write_json(package / ".piopm", {"type": kind, "name": name, "version": version, "spec": spec})


def make_scons(core: Path) -> None:
    import SCons

    major, minor, patch = (int(part) for part in [*SCons.__version__.split("."), "0"][:3])
    version = f"4.{major}{minor:02d}{patch:02d}.0"
    package = core / "packages" / "tool-scons"
    write_json(package / "package.json", {"name": "tool-scons", "version": version, "system": "*"})
    start = f"import sys\nsys.path.insert(0, {str(Path(SCons.__file__).parents[1])!r})\n"
    (package / "scons.py").write_text(start + "import SCons.Script\nsys.exit(SCons.Script.main())\n", "utf-8")
    mark_installed(package, "tool", "tool-scons", version)


def make_toolchain(core: Path) -> None:
    package = core / "packages" / "toolchain-gccarmnoneeabi"
    found = {tool: shutil.which(f"arm-none-eabi-{tool}") for tool in TOOLS}
    if missing := [tool for tool, path in found.items() if path is None]:
        sys.exit(f"toolchain: arm-none-eabi-{missing[0]} is missing; sudo apt install gcc-arm-none-eabi")
    write_json(package / "package.json", {"name": package.name, "version": TOOLCHAIN_VERSION, "system": "*"})
    (package / "bin").mkdir(exist_ok=True)
    for tool, path in found.items():
        link = package / "bin" / f"arm-none-eabi-{tool}"
        link.unlink(missing_ok=True)
        link.symlink_to(str(path))
    mark_installed(package, "tool", package.name, TOOLCHAIN_VERSION)


def make_platform(core: Path) -> None:
    package = core / "platforms" / "ststm32"
    shutil.rmtree(package, ignore_errors=True)
    shutil.copytree(HERE / "platform", package)
    project = configparser.ConfigParser(interpolation=None)
    project.read(PROJECT / "platformio.ini", "utf-8")
    for board in {section["board"] for section in project.values() if "board" in section}:
        write_json(package / "boards" / f"{board}.json", {**BOARD, "name": board})
    mark_installed(package, "platform", "ststm32", json.loads((package / "platform.json").read_text())["version"])


def main(core: Path) -> None:
    make_scons(core)
    make_toolchain(core)
    make_platform(core)
    write_json(core / "appstate.json", {"settings": {"enable_telemetry": False, "check_platformio_interval": 99999}})


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
