"""flash, selftest: put the firmware on a board and see that it works."""

from __future__ import annotations

import sys

import click

from phaselead.cli.common import confirmed, emit, emit_pairs, json_option, port_option, yes_option
from phaselead.cli.listing import top_level
from phaselead.control import connect
from phaselead.device import flash_board
from phaselead.record import parse_axes
from phaselead.result import pairs_table
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
@click.option("--axis", "axes", metavar="AXES", default="x,y,z", show_default=True, help="Which axes are looped.")
@yes_option
@json_option
def selftest(port: str, axes: str, yes: bool, json_to: str | None) -> None:
    """Test a board whose DAC outputs are wired to its ADC inputs, the amplifier NOT connected.

    It drives 0 to 9.5 V and prints gain, offset, misfit and noise of each axis. Exit status 1 when one of them is out.
    """
    letters = "".join(parse_axes(axes, "--axis"))
    with connect(port) as device:
        what = f"This drives 0 to 9.5 V out of {', '.join(letters)}."
        confirmed(f"{what} Is the amplifier NOT connected, and each output wired to its input?", yes)
        tested = device.selftest(letters)
    tables = [pairs_table({"axis": axis} | one.as_dict()) for axis, one in tested.items()]
    emit(tested.as_dict(), json_to, [*tables, *tested.advice()])
    if not tested.passed:
        sys.exit(FAILED)
