"""learn: take out of a path's error what repeats."""

from __future__ import annotations

import os

import click

from phaselead.cli.common import axis_option, emit, force_option, json_option, port_option, progress, warn
from phaselead.cli.listing import top_level
from phaselead.cli.track import follows_option, gains_option
from phaselead.control import Follows, loop_warnings, parse_gains, path_warnings
from phaselead.control import learn as learn_path
from phaselead.device import Device
from phaselead.errors import BadInput
from phaselead.model import load_stage
from phaselead.record import check_output
from phaselead.waveforms import parse_waves


def _learned_file(_context: click.Context, _option: click.Parameter, path: str | None) -> str | None:
    if path is not None and os.path.splitext(path)[1].lower() not in (".h5", ".hdf5"):
        raise BadInput(f"{path}: a learned table is HDF5; give a name that ends in .h5")
    check_output(path)
    return path


@top_level(order=75)
@click.command()
@click.argument("wave", metavar="WAVE")
@port_option
@click.option(
    "--model", "model_path", metavar="M", required=True, help="Stage file; uploaded when the device holds another."
)
@click.option("--mode", type=click.Choice(["inverse", "inverse+pid"]), default="inverse+pid", show_default=True)
@gains_option
@follows_option
@click.option("--trials", type=click.IntRange(min=1), default=10, show_default=True, help="Corrected ones, at most.")
@click.option("-o", "--output", metavar="LEARNED.h5", callback=_learned_file, help="The table, for track --learned.")
@click.option("--report", metavar="PAGE.html", help="Error against trial, as a page.")
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
    check_output(report, inputs=[model_path])
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
    if output is not None:
        found.save(output)
    if report is not None:
        from phaselead.report import write_learning_report  # matplotlib is slow to load and is needed here only

        write_learning_report(report, wave, found)
    wrote = [f"wrote {name}" for name in (output, report) if name is not None]
    emit(found.as_dict(), json_to, [*found.tables(), *wrote])
