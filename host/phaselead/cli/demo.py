"""demo: the whole story on the built-in stage."""

from __future__ import annotations

import click

from phaselead.cli.common import emit, json_option, progress
from phaselead.cli.listing import top_level
from phaselead.cli.output_level import quiet
from phaselead.cli.outputs import overwriting


@top_level(order=10, group="start")
@click.command()
@click.option("--out", metavar="DIR", default="phaselead-demo", show_default=True, help="Where everything is kept.")
@json_option
def demo(out: str, json_to: str | None) -> None:
    """Identify, fit, verify, upload, track, record and replay on the built-in virtual stage; ends with a report."""
    from phaselead.demo import run_demo

    lines: list[str] = []
    say = lines.append if json_to == "-" or quiet.get() else click.echo
    with progress("demo", 1.0) as advance:
        report = run_demo(out, say, advance, overwrite=overwriting())
    emit({"report": str(report)}, json_to, [])
    if json_to != "-" and not quiet.get():
        click.echo(report)
