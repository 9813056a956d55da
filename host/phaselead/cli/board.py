"""flash, selftest: put the firmware on a board and see that it works."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import click
from rich.console import Console

from phaselead.cli.common import emit, json_option, port_option
from phaselead.cli.device import emit_pairs, print_pairs
from phaselead.cli.listing import top_level
from phaselead.device import Device
from phaselead.device import selftest as test_axis
from phaselead.errors import BadInput, PhaseleadError
from phaselead.source_tree import boards, source_tree

BOARDS = boards()
PREPARED = ".pio-core"
"""What `make toolchain` leaves."""
FAILED = 1


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
    if port.startswith(("sim://", "qemu://")):
        raise BadInput(f"{port} is no board; give --port its serial line (see `phaselead ports`), or --check-only")
    if port.startswith("/") and not Path(port).exists():
        raise BadInput(f"{port}: there is no such port; is the board plugged in? `phaselead ports` lists what is")
    if (root / PREPARED).is_dir() and shutil.which("openocd") is None:
        raise BadInput("openocd is missing, which uploads where there is no registry; sudo apt install openocd")


def build_and_upload(root: Path, environment: str) -> str:
    """Runs PlatformIO; gives the build id of what it put on the board. Raises PhaseleadError when it fails."""
    prepared = root / PREPARED
    variables = os.environ | ({"PLATFORMIO_CORE_DIR": str(prepared)} if prepared.is_dir() else {})
    command = [pio(), "run", "-d", str(root), "-e", environment, "-t", "upload"]
    done = subprocess.run(command, env=variables, stdout=sys.stderr, check=False)
    if done.returncode != 0:
        raise PhaseleadError(f"PlatformIO could not build or upload {environment}; see its output above")
    build_id: str = runpy.run_path(str(root / "firmware" / "build_id.py"))["build_id"](root)
    return build_id


def check_board(device: Device, environment: str, build_id: str) -> None:
    """Raises PhaseleadError when the board does not run that build."""
    target, runs = device.hello.target.rstrip(b"\0").decode("ascii", "replace"), device.hello.build_id.hex()
    if target != environment:
        raise PhaseleadError(f"the device is a {target}, not a {environment}; is --port the board's?")
    if runs != build_id:
        raise PhaseleadError(f"the board runs build {runs[:12]}, not {build_id[:12]}; press its reset, then try again")


@top_level(order=180)
@click.command()
@click.option(
    "--env",
    "environment",
    type=click.Choice(BOARDS) if BOARDS else str,
    default=next(iter(BOARDS), ""),
    help="Which board.",
)
@port_option
@click.option("--check-only", is_flag=True, help="Upload nothing; only see whether the board runs this source.")
@json_option
def flash(environment: str, port: str, check_only: bool, json_to: str | None) -> None:
    """Build the firmware, upload it, then check over the wire that the board runs it.

    PlatformIO does the first two, from the source tree. PORT is the board's serial line.
    """
    root = source_root()
    if check_only:
        build_id: str = runpy.run_path(str(root / "firmware" / "build_id.py"))["build_id"](root)
    else:
        check_before_upload(root, port)
        build_id = build_and_upload(root, environment)
    with Device.open(port) as device:
        check_board(device, environment, build_id)
    emit_pairs({"board": environment, "build_id": build_id, "runs_it": True}, json_to)


@top_level(order=190)
@click.command()
@port_option
@click.option("--axis", "axes", default="xyz", show_default=True, help="Which axes are looped.")
@json_option
def selftest(port: str, axes: str, json_to: str | None) -> None:
    """Test a board whose DAC outputs are wired to its ADC inputs, the amplifier NOT connected.

    It drives 0 to 9.5 V and prints gain, offset, misfit and noise of each axis. Exit status 1 when one of them is out.
    """
    if not axes or any(axis not in "xyz" for axis in axes) or len(set(axes)) != len(axes):
        raise BadInput(f"--axis {axes!r}: letters of x, y and z, each once")
    with Device.open(port) as device:
        results = {axis: test_axis(device, axis) for axis in axes}
    figures = {axis: result.as_dict() for axis, result in results.items()}

    def human(console: Console) -> None:
        for axis, row in figures.items():
            print_pairs(console, {"axis": axis} | row)

    emit({"axes": figures}, json_to, human)
    if not all(result.passed for result in results.values()):
        sys.exit(FAILED)
