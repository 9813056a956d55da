"""log record, trigger, pull, faults, export, info, recover; replay."""

from __future__ import annotations

import sys

import click

from phaselead.cli.common import (
    axes_option,
    axis_option,
    duration_option,
    emit,
    emit_pairs,
    emit_result,
    forgotten,
    json_option,
    map_option,
    port_option,
    progress,
    rate_option,
    read_recordings,
    tell,
    warn,
    warn_of_gaps,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, RECORD, OutputFile, overwriting
from phaselead.record import RUN_SUFFIXES, SUFFIXES
from phaselead.result import pairs_table

TRIGGERS = ("fault", "set_point", "threshold", "input")


@top_level(order=140, group="records")
@click.group()
def log() -> None:
    """Take recordings, look into them, convert them; what the device remembers."""


@log.command()
@port_option
@click.option("--drive", metavar="WAVE", help="Drive this in volts meanwhile, e.g. sine:5V@5Hz; default: only listen.")
@duration_option("ten periods, or 1 s when only listening")
@click.option("-o", "--output", metavar="RUN.h5", type=OutputFile(*RUN_SUFFIXES), required=True)
@axes_option
@json_option
def record(
    port: str, drive: str | None, duration: float | None, output: str, axes: str | None, json_to: str | None
) -> None:
    """Record what the device does, open loop; needs no model."""
    from phaselead.control import path_warnings, record_to_file, said_of_disk
    from phaselead.device import Device
    from phaselead.waveforms import parse_waves

    waveforms = parse_waves(drive, axes) if drive else None
    if said := said_of_disk(duration, len(waveforms or axes or "x")):
        tell(said, json_to)
    warn(path_warnings(waveforms or {}))
    with Device.open(port, park_on_exit=waveforms is not None) as device, progress("recording", 1.0) as advance:
        facts = record_to_file(device, waveforms, axes or "x", output=output, duration_s=duration, on_progress=advance)
    warn_of_gaps(facts)
    emit_pairs(facts, json_to)


@log.command()
@port_option
@click.option("--on", type=click.Choice(TRIGGERS), default="fault", show_default=True)
@axis_option
@click.option("--above", "above_um", metavar="UM", type=float, help="threshold: when the position rises above this.")
@click.option("--below", "below_um", metavar="UM", type=float, help="threshold: when it falls below this.")
@click.option("--every", metavar="N", type=int, default=1, show_default=True, help="Keep each Nth tick only.")
@click.option("--after", metavar="SHARE", type=float, default=0.25, show_default=True, help="Of it after the trigger.")
@json_option
def trigger(
    port: str,
    on: str,
    axis: str,
    above_um: float | None,
    below_um: float | None,
    every: int,
    after: float,
    json_to: str | None,
) -> None:
    """Choose what freezes the recorder that is always on; a fault always does."""
    from phaselead.control import connect

    with connect(port, park_on_exit=False) as device:
        facts = device.trigger(on, axis=axis, above_um=above_um, below_um=below_um, every=every, after=after)
    emit(facts, json_to, [pairs_table(facts), *forgotten(port, "this trigger")])


@log.command()
@port_option
@click.option(
    "-o",
    "--output",
    metavar="OUT",
    type=OutputFile(*SUFFIXES),
    required=True,
    help="Ends in .csv, .h5, .mat or .parquet.",
)
@click.option("--keep", is_flag=True, help="Leave it frozen; default: it waits for the next fault.")
@json_option
def pull(port: str, output: str, keep: bool, json_to: str | None) -> None:
    """Fetch what the recorder that is always on has frozen: what led to a fault or another trigger."""
    from phaselead.control import connect
    from phaselead.record import export as export_recording

    with connect(port, park_on_exit=False) as device:
        recording = device.pull(keep=True)
        export_recording(recording, output, overwrite=overwriting())
        if not keep:
            device.trigger()
    emit_pairs(recording.facts() | {"output": output}, json_to)


@log.command()
@port_option
@json_option
def faults(port: str, json_to: str | None) -> None:
    """Print the last 16 faults of the device, those before its last resets included."""
    from phaselead.control import connect

    with connect(port, park_on_exit=False) as device:
        found = device.fault_log()
    emit_result(found, json_to)


@log.command()
@click.argument("recording_path", metavar="REC", type=RECORD)
@map_option
@rate_option
@json_option
def info(recording_path: str, column_map: str | None, rate: str | None, json_to: str | None) -> None:
    """Say what a recording holds."""
    (recording,) = read_recordings([recording_path], column_map, rate)
    hashes = {"sha256": recording.sha256, "samples_sha256": recording.samples_sha256}
    figures = recording.facts() | hashes
    before = "the samples before the window are read too: they warm up a model's memory, and are not judged"
    emit(figures, json_to, [pairs_table(figures), *([] if recording.from_rest else [before])])


@log.command()
@click.argument("recording_path", metavar="REC", type=RECORD)
@click.argument("output", metavar="OUT", type=OutputFile(*SUFFIXES))
@map_option
@rate_option
@json_option
def export(
    recording_path: str,
    output: str,
    column_map: str | None,
    rate: str | None,
    json_to: str | None,
) -> None:
    """Convert a recording: OUT ends in .csv, .h5, .mat or .parquet. Of REC@FROM:TO the rows of the window alone."""
    from phaselead.record import export as export_recording
    from phaselead.record import scored_alone

    recording = scored_alone(*read_recordings([recording_path], column_map, rate))
    export_recording(recording, output, overwrite=overwriting())
    emit_pairs({"output": output, "samples": len(recording.t_s)}, json_to)


@log.command("import")
@click.argument("files", metavar="FILE...", type=INPUT, nargs=-1, required=True)
@click.option("-o", "--output", metavar="OUT", help="Where to: .h5, .csv, .mat, .parquet; without it a preview.")
@click.option(
    "--map",
    "column_map",
    metavar="COLUMNS",
    help="Columns by label or 1-based number, e.g. u_V=drive,x_um=5*1e6; default: a guess that says what it assumed.",
)
@rate_option
@click.option("--flip", is_flag=True, help="Turn the sign of positions: the sensor counts backwards.")
@json_option
def import_(
    files: tuple[str, ...],
    output: str | None,
    column_map: str | None,
    rate: str | None,
    flip: bool,
    json_to: str | None,
) -> None:
    """Make a recording of files that other programs wrote: text, .npy, .npz, .mat, HDF5.

    Prints which column became what and why, and the first rows. Several files stand side by side: voltages in one,
    positions in another. Arrays of more dimensions give several recordings, OUT-1, OUT-2 ...
    """
    from phaselead.api import import_recordings
    from phaselead.record import check_output, import_names
    from phaselead.record import export as export_recording

    found = import_recordings(files, map=column_map, rate=rate, flip=flip)
    names = [] if output is None else import_names(output, len(found.recordings))
    for name in names:
        check_output(name, inputs=files, overwrite=overwriting())
    for name, recording in zip(names, found.recordings, strict=bool(names)):
        export_recording(recording, name, overwrite=overwriting())
    said = [f"wrote {', '.join(names)}"] if names else ["nothing was written: give -o OUT.h5"]
    emit(found.as_dict() | {"output": names}, json_to, [*found.tables(), *said])


@log.command()
@click.argument("journal", metavar="JOURNAL", type=INPUT)
@click.option("-o", "--output", metavar="RUN.h5", type=OutputFile(*RUN_SUFFIXES), required=True)
@json_option
def recover(journal: str, output: str, json_to: str | None) -> None:
    """Finish a capture whose program was killed: turn its journal into a recording."""
    from phaselead.control import recover_run

    emit_pairs(recover_run(journal, output), json_to)


@top_level(order=150, group="records")
@click.command()
@click.argument("run", metavar="RUN", type=INPUT)
@json_option
def replay(run: str, json_to: str | None) -> None:
    """Execute a run again and compare every DAC code.

    Exit status 0: every code is the same. 1: prints the first tick that differs. 2: the recording lacks what a replay
    needs (it is gapped, decimated, or was not taken from a device).
    """
    from phaselead.api import replay as execute_again

    replayed = execute_again(run)
    emit_result(replayed, json_to)
    sys.exit(0 if replayed else 1)
