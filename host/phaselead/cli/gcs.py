"""gcs: PI's General Command Set."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from phaselead.cli.common import emit, json_option, port_option
from phaselead.cli.listing import top_level
from phaselead.cli.track import gains_option
from phaselead.control import MODES

if TYPE_CHECKING:
    from phaselead.gcs import Served


@top_level(order=73)
@click.command()
@port_option
@click.option("--listen", metavar="HOST:PORT", help="Of this computer; default 127.0.0.1:50000, or none with --pty.")
@click.option("--pty", is_flag=True, help="Serve a pseudo-terminal, for programs that open a serial port.")
@click.option("--link", metavar="PATH", help="Also make a symbolic link PATH to the pseudo-terminal.")
@click.option("--axis", "axes", metavar="AXES", help="Axes that are served and held; default: the model's, else x.")
@click.option("--model", metavar="M", help="Stage file they are held by; uploaded when the device holds another.")
@click.option("--mode", type=click.Choice([mode for mode in MODES if mode != "open"]), help="Default: the best it can.")
@gains_option
@json_option
def gcs(
    port: str,
    listen: str | None,
    pty: bool,
    link: str | None,
    axes: str | None,
    model: str | None,
    mode: str | None,
    gains: str | None,
    json_to: str | None,
) -> None:
    """Serve a device to programs that speak PI's command set.

    PIPython and Micro-Manager connect to it as to a controller of PI (GCS 2.0). Nothing moves before one of
    them sends SVO 1, which arms the device. Only programs on this computer can connect. Ctrl-C parks and ends.
    """
    from phaselead.api import gcs as serve
    from phaselead.record import parse_axes

    def announce(served: Served) -> None:
        where = [f"GCS 2.0 on {place}" for place in (served.listen, served.terminal) if place is not None]
        figures = {"listen": served.listen, "pty": served.terminal, "axes": list(served.axes)}
        emit(figures, json_to, [*where, f"axes {', '.join(served.axes)} of {port}; parked until SVO 1; Ctrl-C ends it"])

    serve(
        port,
        listen=listen,
        pty=pty,
        link=link,
        axes=None if axes is None else "".join(parse_axes(axes)),
        model=model,
        mode=mode,
        gains=gains,
        say=lambda line: click.echo(line, err=True),
        say_ready=announce,
    )
