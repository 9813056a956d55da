"""track: drive axes along paths and judge the result."""

from __future__ import annotations

from collections.abc import Callable

import click

from phaselead.cli.common import (
    axis_option,
    duration_option,
    emit,
    force_option,
    json_option,
    port_option,
    progress,
    report_option,
    warn,
    warn_of_gaps,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, OutputFile
from phaselead.control import (
    FOLLOWS,
    MODES,
    Follows,
    held_stage,
    held_warning,
    learn,
    load_learned,
    loop_warnings,
    parse_gains,
    path_warnings,
    track_to_file,
)
from phaselead.device import Device
from phaselead.errors import BadInput
from phaselead.model import load_stage
from phaselead.record import RUN_SUFFIXES
from phaselead.waveforms import examples, parse_waves


def names_every_kind(command: Callable[..., None]) -> Callable[..., None]:
    """Puts a way to write every kind of waveform into a command's help."""
    command.__doc__ = (command.__doc__ or "").replace("EVERY_KIND", ", ".join(examples()))
    return command


follows_option = click.option(
    "--track",
    "follows",
    type=click.Choice(FOLLOWS),
    help="What follows a periodic path: the stage itself, where the model has its sensor's lag (the default), or what"
    " that shows.",
)


gains_option = click.option(
    "--gains",
    metavar="paper|KP,KI,KD",
    help="V/um, V/(um s), V s/um; default: the stage file's, else designed for it; without one: paper.",
)


@top_level(order=70)
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
@click.option(
    "--mode",
    type=click.Choice(MODES),
    help="Default: ff+pid; with --learn inverse+pid, with --learned the table's.",
)
@gains_option
@follows_option
@click.option("--learn", "trials", type=click.IntRange(min=1), metavar="N", help="Learn it first, in up to N trials.")
@click.option(
    "--learned", "table", metavar="LEARNED.h5", type=INPUT, help="Play what phaselead learn wrote of this path."
)
@force_option
@duration_option("ten periods, or a move and a second")
@click.option(
    "-o",
    "--output",
    metavar="RUN.h5",
    type=OutputFile(*RUN_SUFFIXES),
    help="Keep the run: recording, raw codes, what replay needs.",
)
@axis_option
@report_option
@json_option
@names_every_kind
def track(
    wave: str,
    port: str,
    model_path: str | None,
    mode: str | None,
    gains: str | None,
    follows: Follows | None,
    trials: int | None,
    table: str | None,
    force: bool,
    duration: float | None,
    output: str | None,
    axis: str,
    report: str | None,
    json_to: str | None,
) -> None:
    """Drive along WAVE, record, and print the tracking error.

    WAVE: EVERY_KIND, sine:60um+20um@5Hz (20 to 80 um), or in volts
    for mode open: sine:5V@5Hz. Amplitudes are peak-to-peak. Several axes: x=sine:60um@5Hz,y=sine:30um@5Hz.
    """
    waveforms = parse_waves(wave, axis)
    stage = load_stage(model_path) if model_path else None
    if table and trials:
        raise BadInput("--learned plays what was learned, --learn learns it: give one of them")
    known = load_learned(table) if table else None
    mode = mode or (known.mode if known is not None else "inverse+pid" if trials else "ff+pid")
    with Device.open(port) as device:
        held = held_stage(device) if stage is None else None
        axis_gains = {name: parse_gains(gains, stage or held, name) for name in waveforms}
        if known is not None:
            axis_gains = axis_gains if gains else known.gains()
            waveforms = known.waveforms(waveforms, stage, mode, axis_gains, follows)
        warn(held_warning(held, mode, axis_gains))
        warn([*loop_warnings(stage, mode, axis_gains, force=force), *path_warnings(waveforms)])
        if trials is not None:
            with progress(f"learning {wave}", 1.0) as advance:
                known = learn(
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
            waveforms = known.waveforms(waveforms, stage, mode, axis_gains)
        with progress(f"tracking {wave}", 1.0) as advance:
            run = track_to_file(
                device,
                waveforms,
                mode,
                output=output,
                stage=stage,
                gains=axis_gains,
                duration_s=duration,
                force=force,
                follows=follows or "true",
                on_progress=advance,
            )
    warn_of_gaps(run.recording.facts())
    *parts, counted = run.tables()
    trial_tables = known.tables() if known is not None and trials else []
    learned = {"learned": known.as_dict()} if known is not None else {}
    said = f"{counted}; wrote {output}" if output else counted
    emit(run.figures | learned, json_to, [*trial_tables, *parts, said, *write_page(run, report)])
