"""scope: the live page."""

from __future__ import annotations

import math

import click

from phaselead.cli.common import SECONDS, emit, json_option, port_option
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT
from phaselead.errors import BadInput


@top_level(order=71)
@click.command()
@port_option
@click.option("--model", metavar="M", type=INPUT, help="Stage file that set-points and waveforms use.")
@click.option("--axis", "axes", metavar="AXES", default="x,y,z", show_default=True, help="Axes that are streamed.")
@click.option("--out", metavar="DIR", default=".", show_default=True, help="Where the page saves recordings.")
@click.option("--page-port", metavar="N", default=0, type=click.IntRange(0, 65535), help="Of 127.0.0.1; 0: any free.")
@click.option(
    "--park-after",
    metavar="S",
    type=SECONDS,
    default=10.0,
    show_default=True,
    help="Seconds without an open page until the device is parked; 0: never.",
)
@click.option("--browser/--no-browser", default=True, help="Open the page.", show_default=True)
@json_option
def scope(
    port: str,
    model: str | None,
    axes: str,
    out: str,
    page_port: int,
    park_after: float,
    browser: bool,
    json_to: str | None,
) -> None:
    """See every tick of a device live in a browser, and drive it from there.

    Serves a page on this computer alone and prints its link, which works once. Nothing moves before you say so; the
    space bar stops. Ctrl-C parks the device and ends it.
    """
    from phaselead.api import scope as serve
    from phaselead.record import parse_axes

    if not 0 <= park_after < math.inf:
        raise BadInput(f"--park-after {park_after:g}: give seconds, or 0 for never")

    def announce(link: str) -> None:
        emit({"link": link}, json_to, [f"the scope of {port} is at", link])
        if browser:
            click.launch(link)

    serve(
        port,
        axes="".join(parse_axes(axes)),
        model=model,
        output=out,
        park_after=park_after,
        page_port=page_port,
        say=lambda line: click.echo(line, err=True),
        say_link=announce,
    )
