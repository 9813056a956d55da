"""explain: what a fault means and what to do."""

from __future__ import annotations

import click

from phaselead.cli.common import emit, emit_result, json_option
from phaselead.cli.listing import top_level
from phaselead.device import explain_fault, fault_names


@top_level(order=125)
@click.command()
@click.argument("fault", metavar="[FAULT]", required=False)
@json_option
def explain(fault: str | None, json_to: str | None) -> None:
    """Say why a fault stops the device and what to do; without FAULT list all of them."""
    if fault is None:
        emit({"faults": fault_names()}, json_to, fault_names())
    else:
        emit_result(explain_fault(fault), json_to)
