"""tune: a loop with margins, shaped on the measured response."""

from __future__ import annotations

import click

from phaselead.cli.common import (
    PERCENT,
    axis_option,
    emit,
    json_option,
    port_option,
    progress,
    report_option,
    warn,
    write_page,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, OutputFile, overwriting
from phaselead.control import connect
from phaselead.model import load_stage
from phaselead.quantity import VOLTS, number


@top_level(order=55, group="model")
@click.command()
@port_option
@click.option(
    "-o",
    "--output",
    metavar="STAGE.toml",
    type=OutputFile(".toml"),
    required=True,
    help="The stage file with the new gains.",
)
@click.option("--model", "model_path", metavar="M", type=INPUT, help="Stage file; default: what the device holds.")
@axis_option
@click.option(
    "--level", metavar="VOLTS", help="E.g. 500mV: peak-to-peak of the multisine; default: a sixtieth of the limits."
)
@click.option("--middle", metavar="VOLTS", help="E.g. 4V: what it is about; default: the middle of the limits.")
@click.option("--peak", type=float, default=2.0, show_default=True, help="Allowed peak sensitivity.")
@click.option(
    "--mode-shift", type=PERCENT, default="10%", show_default=True, help="How far modes may move, up and down."
)
@click.option(
    "--gain-share", type=PERCENT, default="10%", show_default=True, help="How far the gain may change, up and down."
)
@click.option("--save", "save_to", metavar="DIR", help="Keep every run there, as HDF5.")
@report_option
@json_option
def tune(
    port: str,
    output: str,
    model_path: str | None,
    axis: str,
    level: str | None,
    middle: str | None,
    peak: float,
    mode_shift: float,
    gain_share: float,
    save_to: str | None,
    report: str | None,
    json_to: str | None,
) -> None:
    """Measure the response of an axis, shape PID and filters on it, and measure the loop they make.

    A multisine of some micrometres is played in open loop, then one in closed loop. The gains have their margin at
    every local gain of the model and with modes and gain up and down; they go into the stage file, where `track` finds
    them.
    """
    level_V, middle_V = number("--level", level, VOLTS), number("--middle", middle, VOLTS)
    stage = load_stage(model_path) if model_path else None
    with connect(port) as device, progress(f"tuning {axis}", 1.0) as advance:
        found = device.tune(
            axis,
            model=stage,
            level=level_V,
            middle=middle_V,
            peak=peak,
            mode_shift=mode_shift,
            gain_share=gain_share,
            save=save_to,
            overwrite=overwriting(),
            on_progress=advance,
        )
    found.save(output, overwrite=overwriting())
    if found.closed.peak_sensitivity > peak:
        warn(
            [f"the measured loop has a peak sensitivity of {found.closed.peak_sensitivity:.3g}, {peak:g} was asked for"]
        )
    emit(
        found.as_dict() | {"output": output}, json_to, [*found.tables(), f"wrote {output}", *write_page(found, report)]
    )
