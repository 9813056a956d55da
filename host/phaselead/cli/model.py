"""identify, fit, verify, predict: from recordings to a stage file and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from phaselead.api import fit as fit_stage
from phaselead.api import verify as verify_stage
from phaselead.cli.common import (
    SECONDS,
    emit,
    json_option,
    map_option,
    port_option,
    progress,
    rate_option,
    read_recordings,
    report_option,
    tell,
    verbose_option,
    warn,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, RECORD, OutputFile, overwriting
from phaselead.control import describe_gains, describe_unseen, with_gains
from phaselead.identify import Base, FitResult, Verifications, View
from phaselead.model import driven_far_beyond, in_other_times, load_stage
from phaselead.model import predict as predict_position
from phaselead.quantity import HERTZ, VOLTS, number, numbers
from phaselead.record import parse_axes, write_csv
from phaselead.result import Table

records_argument = click.argument("records", metavar="REC...", type=RECORD, nargs=-1, required=True)
model_option = click.option("--model", "model_path", metavar="M", type=INPUT, required=True, help="Stage file.")
stage_output_option = click.option("-o", "--output", metavar="STAGE.toml", type=OutputFile(".toml"), required=True)


def verification_table(found: Verifications, title: str) -> Table:
    """Errors of a model on recordings under this title, with their axes where there are several."""
    table, *_ = found.tables()
    assert isinstance(table, Table)
    one = len({v.axis for v in found}) == 1
    return replace(table.without("axis") if one else table, title=title)


def said_of(fitted: FitResult, verbose: bool) -> list[str]:
    """A fit in words, with every parameter and record where that is asked for."""
    details = fitted.report.lines() if verbose else fitted.report.remarks()
    return [*fitted.summary(), *details, *describe_gains(fitted.model)]


@top_level(order=30, group="model")
@click.command()
@records_argument
@click.option("--base", type=click.Choice(["operator", "linear"]), default="operator", show_default=True)
@click.option("--no-creep", is_flag=True, help="Look for no creep.")
@stage_output_option
@map_option
@rate_option
@verbose_option
@report_option
@json_option
def fit(
    records: tuple[str, ...],
    base: Base,
    no_creep: bool,
    output: str,
    column_map: str | None,
    rate: str | None,
    verbose: bool,
    report: str | None,
    json_to: str | None,
) -> None:
    """Fit a stage file to recordings (CSV or HDF5, any sampling rate).

    A recording may carry a window in absolute seconds: rec.csv@5:7. Rows before it warm the model's memory.
    """
    fitted = fit_stage(read_recordings(records, column_map, rate, doubts=False), base=base, creep=not no_creep)
    fitted.save(output, overwrite=overwriting())
    emit(
        fitted.as_dict() | {"output": output},
        json_to,
        [*said_of(fitted, verbose), f"wrote {output}", *write_page(fitted, report)],
    )


@top_level(order=40, group="model")
@click.command()
@records_argument
@model_option
@click.option("--view", type=click.Choice(["time", "table"]), default="time", show_default=True)
@map_option
@rate_option
@report_option
@json_option
def verify(
    records: tuple[str, ...],
    model_path: str,
    view: View,
    column_map: str | None,
    rate: str | None,
    report: str | None,
    json_to: str | None,
) -> None:
    """Judge a stage file on recordings that it was not fitted on."""
    recordings = read_recordings(records, column_map, rate)
    found = verify_stage(model_path, recordings, view=view)
    warn(found.doubts)
    table = verification_table(found, f"{view} view of {Path(model_path).name}")
    emit(found.as_dict(), json_to, [table, *found.remarks(), *write_page(found, report)])


@top_level(order=50, group="model")
@click.command()
@click.argument("record", metavar="REC", type=RECORD)
@model_option
@click.option("-o", "--output", metavar="OUT.csv", type=OutputFile(".csv"), required=True)
@map_option
@rate_option
@json_option
def predict(
    record: str, model_path: str, output: str, column_map: str | None, rate: str | None, json_to: str | None
) -> None:
    """Predict the response to a recorded voltage; writes t_s,u_V,x_um. The memory starts from rest."""
    stage = load_stage(model_path)
    (recording,) = read_recordings([record], column_map, rate)
    predicted = predict_position(stage, recording)
    warn([*in_other_times(stage, [recording]), *driven_far_beyond(stage, [recording])])
    write_csv(output, predicted, overwrite=overwriting())
    figures = {"output": output, "samples": len(predicted.t_s)}
    emit(figures, json_to, [f"wrote {output}, {len(predicted.t_s)} samples"])


@top_level(order=20, group="model")
@click.command()
@port_option
@stage_output_option
@click.option(
    "--model", "model_path", metavar="M", type=INPUT, help="Stage file with limits and calibration; uploaded first."
)
@click.option("--axis", "axes", metavar="AXES", default="x", show_default=True, help="x, or several: x,y,z.")
@click.option(
    "--creep/--no-creep",
    default=None,
    help="The hold that shows creep takes 52 s an axis. Default: with it, as far as --duration leaves the time.",
)
@click.option("--levels", metavar="V,V...", help="Peak-to-peak voltages; default: 0.5,1,2,3.5,4.5,6,8,10V.")
@click.option("--frequencies", metavar="Hz,Hz...", help="Default: 1,2,4,7,10,13,17,20Hz.")
@click.option("--u-max", metavar="V", help="Scale the levels so that the largest is this.")
@click.option(
    "--duration", metavar="S", type=SECONDS, help="Thin the grid evenly until all of it takes no longer than this."
)
@click.option("--save", "save_to", metavar="DIR", help="Keep every recording of the experiment there, as HDF5.")
@click.option("--resume", is_flag=True, help="Go on with the recordings that are there.")
@verbose_option
@report_option
@json_option
def identify(
    port: str,
    output: str,
    model_path: str | None,
    axes: str,
    creep: bool | None,
    levels: str | None,
    frequencies: str | None,
    u_max: str | None,
    duration: float | None,
    save_to: str | None,
    resume: bool,
    verbose: bool,
    report: str | None,
    json_to: str | None,
) -> None:
    """Run the identification experiment on a device, fit both views, verify on held-out inputs.

    Sines of 0.5-10 V peak-to-peak at 1-20 Hz, open loop, rising level by level; 5 V at 5 Hz and 3 V at 15 Hz are
    recorded but not used for the fit. In the end each axis rests for 40 s and holds 5 V for 12 s, which shows its
    creep. How long all this takes is said first. Limits and calibration are those of --model, else of the model the
    device holds.

    Each recording is on disk as soon as it is there: in --save DIR, else in STAGE.toml.records until the stage file is
    written. After an interruption --resume goes on.
    """
    from phaselead.control import assumed_limits, lacking_gains
    from phaselead.device import Device
    from phaselead.identify import identify_device, keeping, plan_as_time_allows

    axis_names = parse_axes(axes, "--axis")
    plan, creeping, said = plan_as_time_allows(
        axis_names,
        creep=creep,
        duration_s=duration,
        levels_V=numbers("--levels", levels, VOLTS),
        f_Hz=numbers("--frequencies", frequencies, HERTZ),
        u_max_V=number("--u-max", u_max, VOLTS),
    )
    if said is not None:
        warn([f"--duration: {said}; --creep thins the sines for it"])
    stage = load_stage(model_path) if model_path else None
    folder, holds = save_to or f"{output}.records", axis_names if creeping else ()
    keep = keeping(folder, plan, holds, resume=resume, overwrite=overwriting(), only_until_done=save_to is None)
    with keep as kept, Device.open(port) as device:
        if resume and kept.is_empty(plan, holds):
            warn([f"{folder}: holds no record to go on from; the experiment begins at its first"])
        if stage is None and (warning := assumed_limits(device)) is not None:
            warn([warning])
        tell(f"{kept.ahead(plan, holds)}; Ctrl-C parks, --resume goes on", json_to)
        with progress("identifying", 1.0) as advance:
            found = identify_device(device, axis_names, advance, plan=plan, kept=kept, stage=stage, creep=creeping)
        fitted = found.as_fit()
        fitted = replace(fitted, model=with_gains(fitted.model))
        fitted.save(output, overwrite=overwriting())
    held_out = [verification_table(found, f"held out, {view} view") for view, found in fitted.held_out.items()]
    figures = fitted.report.as_dict() | {"output": output} | fitted.as_dict()
    unseen = describe_unseen(fitted.model, max(one.f_Hz for one in plan))
    said_of_it = [*said_of(fitted, verbose), *lacking_gains(fitted.model), *unseen]
    emit(figures, json_to, [*said_of_it, f"wrote {output}", *write_page(fitted, report), *held_out])
    warn(fitted.doubts())
