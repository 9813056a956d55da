"""sim: a long-lived virtual device."""

from __future__ import annotations

import click

from phaselead.cli.common import emit, json_option
from phaselead.cli.listing import top_level
from phaselead.errors import BadInput


@top_level(order=170)
@click.command()
@click.argument("url", metavar="[STAGE]", default="sim://xyz250")
@click.option("--pty", is_flag=True, help="Serve it on a pseudo-terminal, at real time.")
@click.option("--link", metavar="PATH", help="Also make a symbolic link PATH to the pseudo-terminal.")
@json_option
def sim(url: str, pty: bool, link: str | None, json_to: str | None) -> None:
    """Serve a virtual stage that any serial program can talk to.

    STAGE is sim://xyz250, sim://FILE.toml or a stage file. The device lives until Ctrl-C.
    """
    from phaselead.api import sim as serve

    if not pty:
        raise BadInput("say how to serve it: phaselead sim --pty (in-process use needs no server: --port sim://xyz250)")
    say = None if json_to is None else lambda port: emit({"port": port}, json_to, [port])
    serve(url, link=link, say=say)
