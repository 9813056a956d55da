"""track: drive axes along paths and judge the result."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping

import click

from phaselead.cli.common import (
    axes_option,
    duration_option,
    emit,
    force_option,
    held_if_refused,
    json_option,
    port_option,
    progress,
    report_option,
    still_held,
    tell,
    trigger_in_option,
    trigger_out_option,
    wait_told,
    warn_of_gaps,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, OutputFile, overwriting
from phaselead.control import (
    FOLLOWS,
    MODES,
    Follows,
    OnRehearsed,
    Predicted,
    connect,
    load_learned,
    parse_outputs,
)
from phaselead.errors import BadInput, DeviceRefused
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


def telling(json_to: str | None, edge_within_s: float | None = None) -> OnRehearsed:
    """Says what the rehearsal says, before anything moves."""

    def said(predicted: Mapping[str, Predicted]) -> None:
        for axis, one in predicted.items():
            tell(one.sentence(axis), json_to)
        for line in wait_told(edge_within_s):
            tell(line, json_to)

    return said


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
    help="Default: ff+pid, of held axes theirs; with --learn inverse+pid, with --learned the table's.",
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
@trigger_out_option
@trigger_in_option
@click.option("--hold", is_flag=True, help="Hold where the path ends instead of parking.")
@axes_option
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
    trigger_out: str | None,
    trigger_in: float | None,
    hold: bool,
    axes: str | None,
    report: str | None,
    json_to: str | None,
) -> None:
    """Drive along WAVE, record, and print the tracking error.

    WAVE: EVERY_KIND, sine:60um+20um@5Hz (20 to 80 um), or in volts
    for mode open: sine:5V@5Hz. Amplitudes are peak-to-peak. Several axes: x=sine:60um@5Hz,y=sine:30um@5Hz.

    Axes that an earlier command holds go on from there, in the mode that they are held in.
    """
    parse_outputs(trigger_out, parse_waves(wave, axes))  # what is written wrong is told before the port is opened
    stage = load_stage(model_path) if model_path else None
    if table and trials:
        raise BadInput("--learned plays what was learned, --learn learns it: give one of them")
    known = load_learned(table) if table else None
    with connect(port, resume=True) as device, held_if_refused(device):
        if trials is not None:
            with progress(f"learning {wave}", 1.0) as advance:
                known = device.learn(
                    wave,
                    mode=mode or "inverse+pid",
                    axis=axes,
                    model=stage,
                    gains=gains,
                    trials=trials,
                    follows=follows or "true",
                    force=force,
                    on_progress=advance,
                    on_rehearsed=telling(json_to),
                )
            if known.in_fault:
                emit({"learned": known.as_dict()}, json_to, known.tables())
                sys.exit(DeviceRefused.exit_status)
        with progress(f"tracking {wave}", 1.0) as advance:
            run = device.track(
                wave,
                mode=mode,
                axis=axes,
                model=stage,
                gains=gains if trials is None else None,
                duration=duration,
                follows=follows if trials is None else None,
                learned=known,
                force=force,
                output=output,
                overwrite=overwriting(),
                trigger_out=trigger_out,
                trigger_in=trigger_in,
                hold=hold,
                on_progress=advance,
                on_rehearsed=telling(json_to, trigger_in),
            )
            if hold:
                device.leave_running(model_path)
        held = [still_held(device.device.session.name)] if hold else []
    warn_of_gaps(run.recording.facts())
    *parts, counted = run.tables()
    trial_tables = known.tables() if known is not None and trials else []
    learned = {"learned": known.as_dict()} if known is not None else {}
    said = f"{counted}; wrote {output}" if output else counted
    emit(run.figures | learned, json_to, [*trial_tables, *parts, said, *held, *write_page(run, report)])
