"""learn: take out of a path's error what repeats."""

from __future__ import annotations

import sys

import click

from phaselead.cli.common import (
    axes_option,
    emit,
    force_option,
    json_option,
    port_option,
    progress,
    report_option,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, OutputFile, overwriting
from phaselead.cli.track import follows_option, gains_option, telling
from phaselead.control import Follows, connect
from phaselead.errors import DeviceRefused
from phaselead.model import load_stage
from phaselead.record import RUN_SUFFIXES
from phaselead.waveforms import parse_waves


@top_level(order=78)
@click.command()
@click.argument("wave", metavar="WAVE")
@port_option
@click.option(
    "--model",
    "model_path",
    metavar="M",
    type=INPUT,
    help="Stage file; uploaded when the device holds another. Default: what the device holds.",
)
@click.option("--mode", type=click.Choice(["inverse", "inverse+pid"]), default="inverse+pid", show_default=True)
@gains_option
@follows_option
@click.option("--trials", type=click.IntRange(min=1), default=10, show_default=True, help="Corrected ones, at most.")
@click.option(
    "-o",
    "--output",
    metavar="LEARNED.h5",
    type=OutputFile(*RUN_SUFFIXES),
    help="The table, for track --learned.",
)
@click.option("--save", "save_to", metavar="DIR", help="Keep every run there, as HDF5.")
@report_option
@force_option
@axes_option
@json_option
def learn(
    wave: str,
    port: str,
    model_path: str | None,
    mode: str,
    gains: str | None,
    follows: Follows | None,
    trials: int,
    output: str | None,
    save_to: str | None,
    report: str | None,
    force: bool,
    axes: str | None,
    json_to: str | None,
) -> None:
    """Drive along WAVE again and again, each time corrected by the error that repeats.

    WAVE: a periodic path in micrometres, as for track. The best of the trials is kept; it is for
    this model, mode and path, and `phaselead track WAVE --learned LEARNED.h5` plays it.
    """
    parse_waves(wave, axes)  # what is written wrong is told before the port is opened
    stage = load_stage(model_path) if model_path else None
    with connect(port) as device, progress(f"learning {wave}", 1.0) as advance:
        found = device.learn(
            wave,
            mode=mode,
            axis=axes,
            model=stage,
            gains=gains,
            trials=trials,
            follows=follows or "true",
            force=force,
            save=save_to,
            overwrite=overwriting(),
            on_progress=advance,
            on_rehearsed=telling(json_to),
        )
    if output is not None:
        found.save(output, overwrite=overwriting())
    wrote = [f"wrote {output}" if output is not None else "not written: with -o FILE.h5 `phaselead track` can play it"]
    emit(found.as_dict(), json_to, [*found.tables(), *wrote, *write_page(found, report)])
    if found.in_fault:
        sys.exit(DeviceRefused.exit_status)
