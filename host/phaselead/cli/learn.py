"""learn: take out of a path's error what repeats."""

from __future__ import annotations

from dataclasses import replace

import click

from phaselead.cli.common import (
    axis_option,
    emit,
    force_option,
    json_option,
    port_option,
    progress,
    report_option,
    warn,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, OutputFile, overwriting
from phaselead.cli.track import follows_option, gains_option
from phaselead.control import Follows, loop_warnings, parse_gains, path_warnings
from phaselead.control import learn as learn_path
from phaselead.device import Device
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
    required=True,
    help="Stage file; uploaded when the device holds another.",
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
@report_option
@force_option
@axis_option
@json_option
def learn(
    wave: str,
    port: str,
    model_path: str,
    mode: str,
    gains: str | None,
    follows: Follows | None,
    trials: int,
    output: str | None,
    report: str | None,
    force: bool,
    axis: str,
    json_to: str | None,
) -> None:
    """Drive along WAVE again and again, each time corrected by the error that repeats.

    WAVE: a periodic path in micrometres, as for track. The best of the trials is kept; it is for
    this model, mode and path, and `phaselead track WAVE --learned LEARNED.h5` plays it.
    """
    waveforms, stage = parse_waves(wave, axis), load_stage(model_path)
    axis_gains = {name: parse_gains(gains, stage, name) for name in waveforms}
    warn([*loop_warnings(stage, mode, axis_gains, force=force), *path_warnings(waveforms)])
    with Device.open(port) as device, progress(f"learning {wave}", 1.0) as advance:
        found = learn_path(
            device,
            waveforms,
            mode,
            stage=stage,
            gains=axis_gains,
            trials=trials,
            follows=follows or "true",
            force=force,
            on_progress=advance,
        )
    found = replace(found, wave=wave)
    if output is not None:
        found.save(output, overwrite=overwriting())
    wrote = [f"wrote {output}"] if output is not None else []
    emit(found.as_dict(), json_to, [*found.tables(), *wrote, *write_page(found, report)])
