"""plot: runs and recordings in one figure."""

from __future__ import annotations

import click

from phaselead.cli.common import (
    emit,
    json_option,
    map_option,
    rate_option,
    read_recordings,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import RECORD, OutputFile, overwriting

SUFFIXES = (".png", ".svg", ".pdf")


@top_level(order=145, group="records")
@click.command()
@click.argument("records", metavar="RUN...", type=RECORD, nargs=-1, required=True)
@click.option(
    "--of", "shown", type=click.Choice(["position", "error", "spectrum"]), default="position", show_default=True
)
@click.option(
    "-o",
    "--output",
    metavar="FIGURE",
    type=OutputFile(*SUFFIXES),
    required=True,
    help="Its name ends in .png, .svg or .pdf.",
)
@map_option
@rate_option
@json_option
def plot(
    records: tuple[str, ...],
    shown: str,
    output: str,
    column_map: str | None,
    rate: str | None,
    json_to: str | None,
) -> None:
    """Draw runs and recordings in one figure: position, error (um) or spectrum.

    The spectrum is of the error, without a reference of the position. Spikes of a single sample are drawn.
    """
    from phaselead.report import runs_figure, save_figure

    figure = runs_figure(read_recordings(records, column_map, rate), shown)  # type: ignore[arg-type]
    save_figure(figure, output, overwrite=overwriting())
    emit({"output": output, "recordings": len(records), "of": shown}, json_to, [f"wrote {output}"])
