"""Putting the firmware on a board with PlatformIO, from the source tree, and seeing that it runs there."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from phaselead.device.device import Device
from phaselead.device.session import Session
from phaselead.device.status import target_of
from phaselead.device.update import read_images, update
from phaselead.errors import BadInput, PhaseleadError
from phaselead.result import Facts
from phaselead.serial_ports import is_virtual, open_port
from phaselead.source_tree import boards, source_tree

PREPARED = ".pio-core"
"""What `make toolchain` leaves."""


def source_root() -> Path:
    """The source tree, which PlatformIO builds from. Raises BadInput when this package is not in one."""
    root = source_tree()
    if root is None:
        raise BadInput("flash needs phaselead's source tree; run it there")
    return root


def pio() -> str:
    beside = Path(sys.executable).with_name("pio")
    found = str(beside) if beside.exists() else shutil.which("pio")
    if found is None:
        raise BadInput("PlatformIO is not installed; `make toolchain`, or pip install platformio==6.2.0")
    return found


def check_before_upload(root: Path, port: str) -> None:
    """Before anything is built. Raises BadInput when there is no board at this port, or nothing to upload with."""
    if is_virtual(port):
        raise BadInput(f"{port} is no board; give --port its serial line (see `phaselead ports`), or --check-only")
    if port.startswith("/") and not Path(port).exists():
        raise BadInput(f"{port}: there is no such port; is the board plugged in? `phaselead ports` lists what is")
    if (root / PREPARED).is_dir() and shutil.which("openocd") is None:
        raise BadInput("openocd is missing, which uploads where there is no registry; sudo apt install openocd")


def build(root: Path, environment: str, *targets: str) -> str:
    """Runs PlatformIO; gives the build id of what it built. Raises PhaseleadError when it fails."""
    prepared = root / PREPARED
    variables = os.environ | ({"PLATFORMIO_CORE_DIR": str(prepared)} if prepared.is_dir() else {})
    command = [pio(), "run", "-d", str(root), "-e", environment, *targets]
    done = subprocess.run(command, env=variables, stdout=sys.stderr, check=False)
    if done.returncode != 0:
        raise PhaseleadError(f"PlatformIO could not build or upload {environment}; see its output above")
    build_id: str = runpy.run_path(str(root / "firmware" / "build_id.py"))["build_id"](root)
    return build_id


def check_board(device: Device, environment: str, build_id: str) -> None:
    """Raises PhaseleadError when the board does not run that build."""
    target, runs = target_of(device.hello.target), device.hello.build_id.hex()
    if target != environment:
        raise PhaseleadError(f"the device is a {target}, not a {environment}; is --port the board's?")
    if runs != build_id:
        raise PhaseleadError(f"the board runs build {runs[:12]}, not {build_id[:12]}; press its reset, then try again")


def flash_board(port: str, environment: str | None = None, *, check_only: bool = False) -> Facts:
    """Builds and uploads unless ``check_only``, then asks the board for its build id: board, build_id, runs_it.

    ``environment`` is a board of platformio.ini, the first by default.

    Raises BadInput outside a source tree, without a board at this port or for an unknown one; PhaseleadError when the
    build, the upload or the check fails.
    """
    root, known = source_root(), boards()
    environment = known_board(environment or known[0])
    if check_only:
        build_id: str = runpy.run_path(str(root / "firmware" / "build_id.py"))["build_id"](root)
    else:
        check_before_upload(root, port)
        build_id = build(root, environment, "-t", "upload")
    with Device.open(port) as device:
        check_board(device, environment, build_id)
    return Facts({"board": environment, "build_id": build_id, "runs_it": True})


def known_board(environment: str) -> str:
    """Raises BadInput when platformio.ini does not know it."""
    if environment not in boards():
        raise BadInput(f"there is no board {environment}; there are {', '.join(boards())}")
    return environment


def target_at(port: str) -> str:
    """What the device at a port is, whatever its version. Raises LinkError when nothing answers."""
    line = open_port(port)
    try:
        return Session(line, port).greet().target
    finally:
        line.close()


def flash_by_wire(
    port: str,
    environment: str | None = None,
    *,
    image: Path | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Facts:
    """Replaces the firmware of a device over its own serial line; see ``update`` for what is given and raised.

    ``image`` is an update.bin; without one the source tree is built for ``environment``, by default what the device is.
    """
    if image is not None:
        return update(port, read_images(image), on_progress)
    root = source_tree()
    if root is None:
        raise BadInput("here is no phaselead source tree to build; give an update.bin with --image")
    environment = known_board(environment or target_at(port))
    build(root, environment)
    return update(port, read_images(root / ".pio" / "build" / environment / "update.bin"), on_progress)
