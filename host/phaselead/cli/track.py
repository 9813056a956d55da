"""track: drive axes along paths and judge the result."""

from __future__ import annotations

from collections.abc import Callable

import click

from phaselead.cli.common import (
    axis_option,
    check_report,
    duration_option,
    emit,
    force_option,
    json_option,
    own_overwrite_option,
    port_option,
    progress,
    report_option,
    warn,
    warn_of_gaps,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.control import MODES, held_stage, held_warning, loop_warnings, parse_gains, path_warnings, track_to_file
from phaselead.device import Device
from phaselead.model import load_stage
from phaselead.record import RUN_SUFFIXES, check_output
from phaselead.waveforms import examples, parse_waves


def names_every_kind(command: Callable[..., None]) -> Callable[..., None]:
    """Puts a way to write every kind of waveform into a command's help."""
    command.__doc__ = (command.__doc__ or "").replace("EVERY_KIND", ", ".join(examples()))
    return command


@top_level(order=70)
@click.command()
@click.argument("wave", metavar="WAVE")
@port_option
@click.option(
    "--model",
    "model_path",
    metavar="M",
    help="Stage file; uploaded when the device holds another. Default: what the device holds.",
)
@click.option("--mode", type=click.Choice(MODES), default="ff+pid", show_default=True)
@click.option(
    "--gains",
    metavar="paper|KP,KI,KD",
    help="V/um, V/(um s), V s/um; default: the stage file's, else designed for it; without one: paper.",
)
@force_option
@own_overwrite_option
@duration_option("ten periods, or a move and a second")
@click.option("-o", "--output", metavar="RUN.h5", help="Keep the run: recording, raw codes, what replay needs.")
@axis_option
@report_option
@json_option
@names_every_kind
def track(
    wave: str,
    port: str,
    model_path: str | None,
    mode: str,
    gains: str | None,
    force: bool,
    overwrite: bool,
    duration: float | None,
    output: str | None,
    axis: str,
    report: str | None,
    json_to: str | None,
) -> None:
    """Drive along WAVE, record, and print the tracking error.

    WAVE: EVERY_KIND, sine:60um+20um@5Hz (20 to 80 um; the
    output goes to 20 um first), or in volts for mode open: sine:5V@5Hz. Amplitudes are
    peak-to-peak. Several axes: x=sine:60um@5Hz,y=sine:30um@5Hz.
    """
    inputs = [model_path] if model_path else []
    check_output(output, suffixes=RUN_SUFFIXES, inputs=inputs, overwrite=overwrite or force)
    check_report(report, inputs)
    waveforms = parse_waves(wave, axis)
    stage = load_stage(model_path) if model_path else None
    with Device.open(port) as device, progress(f"tracking {wave}", 1.0) as advance:
        held = held_stage(device) if stage is None else None
        axis_gains = {name: parse_gains(gains, stage or held, name) for name in waveforms}
        warn(held_warning(held, mode, axis_gains))
        warn([*loop_warnings(stage, mode, axis_gains, force=force), *path_warnings(waveforms, stage)])
        run = track_to_file(
            device,
            waveforms,
            mode,
            output=output,
            stage=stage,
            gains=axis_gains,
            duration_s=duration,
            force=force,
            on_progress=advance,
        )
    warn_of_gaps(run.recording.facts())
    *parts, counted = run.tables()
    said = f"{counted}; wrote {output}" if output else counted
    emit(run.figures, json_to, [*parts, said, *write_page(run, report)])
