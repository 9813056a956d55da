"""flash, selftest: put the firmware on a board and see that it works."""

from __future__ import annotations

import sys

import click
from rich.console import Console

from phaselead.cli.common import emit, json_option, port_option
from phaselead.cli.device import emit_pairs, print_pairs
from phaselead.cli.listing import top_level
from phaselead.device import Device, SelfTest, flash_board
from phaselead.device import selftest as test_axis
from phaselead.errors import BadInput
from phaselead.source_tree import boards

BOARDS = boards()
FAILED = 1


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
    emit_pairs(flash_board(port, environment, check_only=check_only), json_to)


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
        tested = SelfTest({axis: test_axis(device, axis) for axis in axes})

    def human(console: Console) -> None:
        for axis, result in tested.items():
            print_pairs(console, {"axis": axis} | result.as_dict())

    emit(tested.as_dict(), json_to, human)
    if not tested.passed:
        sys.exit(FAILED)
