"""arm, park, stop, status, info, upload: talk to a device."""

from __future__ import annotations

import sys

import click

from phaselead.cli.common import (
    emit,
    emit_pairs,
    emit_result,
    force_option,
    forgotten,
    json_option,
    port_option,
)
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT
from phaselead.control import connect, own_loop_warnings
from phaselead.device import Device, device_model
from phaselead.model import load_stage
from phaselead.result import pairs_table


@top_level(order=80)
@click.command()
@port_option
@click.option("--model-crc", metavar="CRC", default="0", help="Names the model, which a fallback model requires.")
@json_option
def arm(port: str, model_crc: str, json_to: str | None) -> None:
    """Arm the device: its output is live and at the safe value until a path is started."""
    with connect(port, park_on_exit=False) as device:
        found = device.arm(parse_crc(model_crc))
    emit(found.as_dict(), json_to, [*found.tables(), *forgotten(port, "this session")])


def parse_crc(text: str) -> int:
    """A CRC as `info` prints it (hexadecimal), or 0."""
    try:
        return int(text, 16)
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is no CRC; `phaselead info` prints the model's", param_hint="--model-crc"
        ) from None


@top_level(order=90)
@click.command()
@port_option
@json_option
def park(port: str, json_to: str | None) -> None:
    """Ramp every axis to its safe value and disarm."""
    with connect(port, resume=True) as device:
        emit_result(device.park(), json_to)


@top_level(order=100)
@click.command()
@port_option
@json_option
def stop(port: str, json_to: str | None) -> None:
    """Ramp to the safe value at once, whatever session armed the device.

    It needs the port: a phaselead command that is running holds it, and Ctrl-C there parks.
    """
    state = Device.stop_now(port)
    emit_pairs({"stopped": True, "tick": state.tick}, json_to)


@top_level(order=110)
@click.command()
@port_option
@json_option
def status(port: str, json_to: str | None) -> None:
    """Print what the device is doing, and where its axes stand."""
    with connect(port, resume=True, park_on_exit=False) as device:
        emit_result(device.status(), json_to)


@top_level(order=120)
@click.command()
@port_option
@json_option
def info(port: str, json_to: str | None) -> None:
    """Print what the device is: build, schema, model, timing of its tick, last fault."""
    with connect(port, park_on_exit=False) as device:
        emit_pairs(device.info(), json_to)


@top_level(order=115)
@click.command()
@port_option
@json_option
def doctor(port: str, json_to: str | None) -> None:
    """Go through link, timing, faults, model, limits and sensors, and say in words what is wrong.

    Nothing moves. Exit status 1 when something wants a look.
    """
    with connect(port, park_on_exit=False) as device:
        found = device.doctor()
    emit_result(found, json_to)
    if not found.healthy:
        sys.exit(1)


@top_level(order=60)
@click.command()
@click.argument("model_path", metavar="M", type=INPUT)
@port_option
@click.option("--persist", is_flag=True, help="Also write it to flash, so that it survives a power cycle.")
@force_option
@json_option
def upload(model_path: str, port: str, persist: bool, force: bool, json_to: str | None) -> None:
    """Upload a stage file's model as one transaction, read it back and compare."""
    stage = load_stage(model_path)
    device_model(stage)  # a coefficient that does not fit is refused before the port is opened
    own_loop_warnings(stage, force=force)  # and gains that are refused
    with connect(port) as device:
        uploaded = device.upload(stage, persist=persist, force=force)
    figures = {"model": model_path} | uploaded.as_dict()
    emit(figures, json_to, [pairs_table(figures), *forgotten(port, "this model", flash=persist)])
