"""ports: what a device may be plugged into. A file of its own, since it loads neither numpy nor the model."""

from __future__ import annotations

import click
from rich.console import Console
from rich.table import Table

from phaselead.cli.common import emit, json_option
from phaselead.cli.listing import top_level
from phaselead.serial_ports import list_ports


@top_level(order=130)
@click.command()
@json_option
def ports(json_to: str | None) -> None:
    """List serial ports, without opening them. The virtual stage sim://xyz250 is always there."""
    found = list_ports()

    def human(console: Console) -> None:
        table = Table("port", "what it is")
        for entry in found:
            table.add_row(entry.url, entry.description)
        console.print(table)

    emit({"ports": [{"url": entry.url, "description": entry.description} for entry in found]}, json_to, human)
