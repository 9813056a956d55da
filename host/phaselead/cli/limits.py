"""limits: what no model may loosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import click

from phaselead.cli.common import axes_option, emit, forgotten, json_option, port_option
from phaselead.cli.listing import top_level
from phaselead.control import connect
from phaselead.quantity import UM, V_PER_S, VOLTS, number


def limit_option(
    name: str, units: Mapping[str, float], text: str
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """An option for a limit in the first of the ``units`` that has a name."""

    def parsed(_context: click.Context, _parameter: click.Parameter, value: str | None) -> float | None:
        return number(name, value, units)

    return click.option(name, metavar=next(filter(None, units)), callback=parsed, help=text)


@top_level(order=65)
@click.command()
@port_option
@axes_option
@limit_option("--u-min", VOLTS, "Lowest output.")
@limit_option("--u-max", VOLTS, "Highest output.")
@limit_option("--slew", V_PER_S, "Fastest output.")
@limit_option("--x-min", UM, "Lowest position: of a set-point, and of an axis that follows a path.")
@limit_option("--x-max", UM, "Highest position.")
@click.option("--none", "remove", is_flag=True, help="No limits for this axis but those given with it.")
@json_option
def limits(
    port: str,
    axes: str | None,
    u_min: float | None,
    u_max: float | None,
    slew: float | None,
    x_min: float | None,
    x_max: float | None,
    remove: bool,
    json_to: str | None,
) -> None:
    """Show or set the hard limits of voltage, slew and position.

    They are kept in the device's own flash, apart from the model: a model may be tighter, never looser. Set them while
    the device is parked.
    """
    given = remove or any(value is not None for value in (u_min, u_max, slew, x_min, x_max))
    if given != (axes is not None):
        raise click.UsageError("to set limits give --axis and at least one limit, or --none; to show them, neither")
    with connect(port, park_on_exit=False) as device:
        if axes is None:
            found = device.limits()
        else:
            found = device.set_limits(
                axes, u_min_V=u_min, u_max_V=u_max, slew_V_per_s=slew, x_min_um=x_min, x_max_um=x_max, remove=remove
            )
    ended = forgotten(port, "these limits", flash=True) if given else []
    emit(found.as_dict(), json_to, [*found.tables(), *ended])
