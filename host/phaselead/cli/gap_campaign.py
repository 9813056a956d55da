"""gap campaign: blind trials of the gap workflow."""

from __future__ import annotations

from pathlib import Path

import click

from phaselead.cli.common import json_option


def _sizes(_context: click.Context, option: click.Parameter, text: str) -> tuple[float, ...]:
    from phaselead.errors import BadInput

    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or min(found) <= 0:
        raise BadInput(f"--{option.name} {text}: give sizes above 0 as multiples of the typical, e.g. 0.2,1")
    return found


def _kinds(_context: click.Context, option: click.Parameter, text: str | None) -> tuple[str, ...] | None:
    from phaselead.errors import BadInput
    from phaselead.validation import KINDS, ON_REQUEST

    if text is None:
        return None
    found = tuple(text.split(","))
    every = (*KINDS, *ON_REQUEST)
    wrong = [word for word in found if word not in every]
    if wrong:
        raise BadInput(f"--{option.name}: there is no kind {', '.join(wrong)}; there are {', '.join(every)}")
    return found


@click.command()
@click.option("--truth", "folder", metavar="DIR", required=True, help="Folder of the generator of hidden truths.")
@click.option("--set", "set_name", metavar="NAME", default="tuning", show_default=True, help="Set of seeds.")
@click.option(
    "--kinds",
    metavar="KINDS",
    callback=_kinds,
    help="E.g. none,single; default: all but narrow, slow_sines, unreferenced and straight.",
)
@click.option("--sizes", default="0.05,0.2,1", show_default=True, callback=_sizes, help="Sizes of single effects.")
@click.option("--scale", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True,
              help="Multiplies the number of cases.")  # fmt: skip
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Only the first N cases.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; default: one for each core.")
@click.option("--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler instead.")
@click.option("--mix", is_flag=True, help="Keep cases in the folder that were run with other code.")
@click.option("--table", metavar="PAGE.md", help="Also put the table between the marks of this page.")
@click.option("-o", "--output", metavar="DIR", required=True, help="Folder of cases.jsonl, campaign.json and .html.")
@json_option
def campaign(
    folder: str,
    set_name: str,
    kinds: tuple[str, ...] | None,
    sizes: tuple[float, ...],
    scale: float,
    limit: int | None,
    jobs: int | None,
    scheduler: str | None,
    mix: bool,
    table: str | None,
    output: str,
    json_to: str | None,
) -> None:
    """Hide effects in independently simulated stages and count how often the gap workflow names them.

    Finished cases are kept in DIR/cases.jsonl; after an interrupt, the same command continues.
    """
    from phaselead.api import campaign as run_campaign
    from phaselead.cli.common import emit, progress
    from phaselead.validation import reached

    with progress("trying", 1.0) as advance:
        result = run_campaign(
            folder,
            output,
            set=set_name,
            kinds=kinds,
            sizes=sizes,
            scale=scale,
            limit=limit,
            jobs=jobs,
            scheduler=scheduler,
            mix=mix,
            table=table,
            on_progress=advance,
        )
    written = [Path(output) / name for name in ("cases.jsonl", "campaign.json", "campaign.html")]
    said = [f"{row['what']}: {reached(row)}; target {row['target']}" for row in result["numbers"]]
    emit(dict(result), json_to, [*said, f"wrote {', '.join(map(str, written))}"])
