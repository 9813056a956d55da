"""ports: what a device may be plugged into. A file of its own, since it loads neither numpy nor the model."""

from __future__ import annotations

import click

from phaselead.cli.common import emit, json_option
from phaselead.cli.listing import top_level
from phaselead.serial_ports import list_ports


@top_level(order=130)
@click.command()
@json_option
def ports(json_to: str | None) -> None:
    """List serial ports, without opening them. The virtual stage sim://xyz250 is always there."""
    found = list_ports()
    emit({"ports": [{"url": one.url, "description": one.description} for one in found]}, json_to, found.tables())
