"""move, hold, where: go to a place and stay there."""

from __future__ import annotations

from collections.abc import Mapping

import click

from phaselead.cli.common import (
    SECONDS,
    axes_option,
    checked_duration,
    emit,
    emit_result,
    force_option,
    held_if_refused,
    json_option,
    port_option,
    show,
    still_held,
    trigger_in_option,
    trigger_out_option,
    wait_told,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT
from phaselead.cli.track import gains_option
from phaselead.control import MODES, Planned, connect, parse_targets
from phaselead.model import load_stage


@top_level(order=72)
@click.command()
@click.argument("target", metavar="TARGET")
@port_option
@click.option(
    "--model", "model_path", metavar="M", type=INPUT, help="Stage file; uploaded when the device holds another."
)
@click.option("--mode", type=click.Choice([mode for mode in MODES if mode != "open"]), help="Default: the best it can.")
@gains_option
@click.option(
    "--duration", metavar="S", type=SECONDS, callback=checked_duration, help="How long the move takes: 1, 1s, 50ms."
)
@click.option("--speed", metavar="UM_PER_S", help="Its highest speed, instead: 500, 500um/s, 0.5mm/s.")
@click.option("--window", metavar="UM", help="On target is what stays within so much of it: 0.05, 50nm.")
@click.option("--park", "park_after", is_flag=True, help="Park after the move instead of holding.")
@trigger_out_option
@trigger_in_option
@force_option
@axes_option
@json_option
def move(
    target: str,
    port: str,
    model_path: str | None,
    mode: str | None,
    gains: str | None,
    duration: float | None,
    speed: str | None,
    window: str | None,
    park_after: bool,
    trigger_out: str | None,
    trigger_in: float | None,
    force: bool,
    axes: str | None,
    json_to: str | None,
) -> None:
    """Move to TARGET and hold there: x=50um, x=+5um (relative), x=50um,y=20um.

    All axes arrive together, as fast as the limits allow unless told. The stage is still held when the
    command ends, without a host: until the next move, or `phaselead park`. Ctrl-C under way parks.
    """
    targets = {name: f"{one.um:+}um" if one.relative else one.um for name, one in parse_targets(target, axes).items()}
    stage = load_stage(model_path) if model_path else None

    def announce(planned: Planned, predicted: Mapping[str, float | None]) -> None:
        if json_to != "-":
            show({}, None, [*planned.sentences(predicted), *wait_told(trigger_in)])

    with connect(port, resume=True) as device, held_if_refused(device):
        moved = device.move(
            x=targets.get("x"),
            y=targets.get("y"),
            z=targets.get("z"),
            mode=mode,
            model=stage,
            gains=gains,
            duration=duration,
            speed=speed,
            window=window,
            force=force,
            trigger_out=trigger_out,
            trigger_in=trigger_in,
            on_planned=announce,
        )
        if not park_after:
            device.leave_running(model_path)
        emit(
            moved.as_dict(),
            json_to,
            [*moved.tables(), "parked" if park_after else still_held(device.device.session.name)],
        )


@top_level(order=74)
@click.command()
@port_option
@json_option
def hold(port: str, json_to: str | None) -> None:
    """Stop every axis that is moving, within its limits, and hold.

    A device that is parked is armed, and holds axis x where it stands.
    """
    with connect(port, resume=True) as device:
        found = device.hold()
        device.leave_running(None)
        emit(found.as_dict(), json_to, [*found.tables(), still_held(device.device.session.name)])


@top_level(order=76)
@click.command()
@port_option
@json_option
def where(port: str, json_to: str | None) -> None:
    """Print where the axes are, in um and V, and whether they are on target. Nothing moves."""
    with connect(port, resume=True, park_on_exit=False) as device:
        emit_result(device.where(), json_to)
