"""Options and output that the commands share.

The room `record` is opened where it is needed: it loads numpy, which `phaselead ports` does without.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as TerminalTable

from phaselead.cli.output_level import quiet
from phaselead.cli.outputs import json_option as json_option
from phaselead.cli.outputs import overwriting
from phaselead.cli.outputs import report_option as report_option
from phaselead.cli.usage import warn as warn
from phaselead.errors import BadInput, DeviceRefused
from phaselead.quantity import IN_SECONDS, number
from phaselead.result import Table, json_text, pairs_table
from phaselead.serial_ports import DEFAULT_PORT, PORT_VARIABLE, is_virtual, keeps_flash

if TYPE_CHECKING:
    from phaselead.control import Controller
    from phaselead.record import Recording

SHORTEST_S = 0.0004

HELD = "held; `phaselead move`, `where` and `hold` go on from here, `phaselead park` ends it"


class WithUnit(click.ParamType[float]):
    """Text that is a number with one of these units: 5, 5s, 500ms or 2min. A default is written as text too."""

    def __init__(self, name: str, units: Mapping[str, float]) -> None:
        self.name, self.units = name, units

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if isinstance(value, int | float):
            return float(value)
        found = number(param.opts[0] if param else self.name, value, self.units)
        assert found is not None
        return found


SECONDS = WithUnit("seconds", IN_SECONDS)
PERCENT = WithUnit("percent", {"%": 0.01, "": 0.01})


def named_port(_context: click.Context, _option: click.Parameter, port: str) -> str:
    """A port that has a name. Raises BadInput."""
    if not port.strip():
        raise BadInput("--port is empty; name one, `phaselead ports` lists them, or leave it out for the virtual stage")
    return port


port_option = click.option(
    "--port",
    default=DEFAULT_PORT,
    callback=named_port,
    envvar=PORT_VARIABLE,
    show_default=True,
    show_envvar=True,
    help="Serial port, or sim://xyz250, or sim://STAGE.toml.",
)


def checked_duration(_context: click.Context, _option: click.Parameter, seconds: float | None) -> float | None:
    """A duration that is a number of at least two ticks. Raises BadInput."""
    if seconds is not None and not SHORTEST_S <= seconds < math.inf:
        raise BadInput(f"--duration {seconds:g}: give seconds, at least {SHORTEST_S:g} (two ticks)")
    return seconds


def duration_option(default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--duration; ``default`` says what happens without it."""
    text = f"5, 5s or 500ms; default: {default}."
    return click.option("--duration", metavar="S", type=SECONDS, callback=checked_duration, help=text)


trigger_out_option = click.option(
    "--trigger-out",
    metavar="MARKS",
    help="Where the trigger outputs pulse: frame,line,pixel=256; start, target, pixel=2ms, pixel=0.5um.",
)


def _checked_wait(_context: click.Context, _option: click.Parameter, seconds: float | None) -> float | None:
    if seconds is not None and not 0 < seconds < math.inf:
        raise BadInput(f"--trigger-in {seconds:g}: give the seconds to wait for an edge, above 0")
    return seconds


def wait_told(edge_within_s: float | None) -> list[str]:
    """What is said before an edge is waited for."""
    if edge_within_s is None:
        return []
    return [f"waiting for an edge of the trigger input, {edge_within_s:g} s at most; Ctrl-C parks"]


trigger_in_option = click.option(
    "--trigger-in",
    metavar="S",
    type=SECONDS,
    callback=_checked_wait,
    help="Begin at a rising edge of the trigger input, which may take S seconds.",
)
force_option = click.option("--force", is_flag=True, help="Go on where the model says that it will go wrong.")
verbose_option = click.option("-v", "--verbose", is_flag=True, help="Print every parameter and record too.")
axis_option = click.option("--axis", type=click.Choice(["x", "y", "z"]), default="x", show_default=True)
axes_option = click.option(
    "--axis",
    "axes",
    metavar="AXES",
    callback=lambda _context, _option, text: None if text is None else _letters(text),
    help="x or several: x,y. Default: x, or the axes that are named in what is given.",
)
"""Of what may name its axes itself: x=...,y=..."""
map_option = click.option(
    "--map",
    "column_map",
    metavar="COLUMNS",
    help="1-based columns of a file without our header, e.g. u_V=1,x_um=5 or x_um=3*1e6 for metres.",
)
rate_option = click.option("--rate", metavar="RATE", help="Sampling rate of a file without times, e.g. 200Hz.")


def _letters(text: str) -> str:
    from phaselead.record import parse_axes

    return "".join(parse_axes(text, "--axis"))


def tell(line: str, json_to: str | None) -> None:
    """What a person wants to know beforehand; nothing where only JSON is to be printed."""
    if json_to != "-" and not quiet.get():
        click.echo(line)


def forgotten(port: str, what: str, *, flash: bool = False) -> list[str]:
    """The line that says so where ``what`` the command did ends with it: it is in the memory of a virtual stage or,
    with ``flash``, in one whose flash is kept nowhere."""
    if keeps_flash(port) if flash else not is_virtual(port):
        return []
    kept = f"--port '{port}{'&' if '?' in port else '?'}state=flash.bin' keeps its flash, " if flash else ""
    return [f"the virtual stage has ended, and {what} with it: {kept}`phaselead sim --pty` serves a stage that stays"]


@contextmanager
def held_if_refused(device: Controller) -> Iterator[None]:
    """What an earlier command holds stays held where this one is refused."""
    held = device.resumed
    try:
        yield
    except (BadInput, DeviceRefused):
        if held and device.where().state == "running":
            device.leave_running()
        raise


def still_held(port: str) -> str:
    """The line after a command that leaves axes held at this port."""
    return next(iter(forgotten(port, "what it holds")), HELD)


def warn_of_gaps(facts: Mapping[str, Any]) -> None:
    """On the standard error, when ticks that were asked for are not in the recording with these facts."""
    missing = int(facts.get("missing_ticks", 0))
    if missing:
        asked = missing + facts["samples"]
        warn(
            [
                f"{missing} of {asked} ticks are missing: lost on the line or dropped by the device; fit, verify and "
                "replay refuse such a recording, its gaps say where"
            ]
        )


def read_recordings(
    arguments: tuple[str, ...] | list[str], column_map: str | None, rate: str | None, *, doubts: bool = True
) -> list[Recording]:
    """Reads every recording argument under one --map and --rate. Says so where a map looks wrong; without ``doubts``
    what takes them does."""
    from phaselead.record import doubts_about, parse_column_map, parse_rate, read_recording, refuse_map_of_some

    columns = parse_column_map(column_map) if column_map else None
    rate_Hz = parse_rate(rate) if rate else None
    refuse_map_of_some(arguments, columns)
    found = [read_recording(argument, columns=columns, rate_Hz=rate_Hz) for argument in arguments]
    if doubts and columns is not None:
        warn(line for recording in found for line in doubts_about(recording))
    return found


def emit(figures: dict[str, Any], json_to: str | None, parts: Sequence[Table | str]) -> None:
    """Prints ``parts``, tables and sentences, or JSON alone when ``--json -``; writes the JSON file otherwise."""
    if json_to and json_to != "-":
        from phaselead.record import write_text

        write_text(json_to, json_text(figures), overwrite=overwriting())
    show(figures, json_to, parts)


def asked_of_a_person() -> bool:
    """Whether somebody can answer."""
    return sys.stdin.isatty()


def confirmed(question: str, yes: bool) -> None:
    """Asks before something moves that may do harm. Raises BadInput when the answer is no, and where nobody can be
    asked, unless ``yes``."""
    if yes:
        return
    if not asked_of_a_person():
        raise BadInput(f"{question} Nobody can be asked here: give --yes if it may")
    if not click.confirm(question, err=True):
        raise BadInput("nothing was moved, as you answered")


yes_option = click.option("-y", "--yes", is_flag=True, help="Do not ask first.")


class Printed(Protocol):
    """A result that is figures to a program and tables to a person."""

    def as_dict(self) -> dict[str, Any]: ...
    def tables(self) -> Sequence[Table | str]: ...


def emit_result(result: Printed, json_to: str | None) -> None:
    """A result as it prints itself, or as JSON."""
    emit(result.as_dict(), json_to, result.tables())


def write_page(result: Any, path: str | None) -> list[str]:
    """The page of a result where one is asked for, and the line that says so."""
    if path is None:
        return []
    from phaselead.api import write_report

    write_report(result, path, overwrite=overwriting())
    return [f"wrote {path}"]


def emit_pairs(figures: dict[str, Any], json_to: str | None) -> None:
    """Figures as they are: one line each for a person, or JSON."""
    emit(figures, json_to, [pairs_table(figures)])


def show(figures: dict[str, Any], json_to: str | None, parts: Sequence[Table | str]) -> None:
    """Prints ``parts``, or JSON alone when ``--json -``; files are the caller's."""
    if json_to == "-":
        click.echo(json_text(figures), nl=False)
    if json_to == "-" or quiet.get():
        return
    console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 120)
    for part in parts:
        console.print(part if isinstance(part, str) else terminal_table(part))


def terminal_table(table: Table) -> TerminalTable:
    """The table of a result as the terminal draws it: with lines where it has headings."""
    plain = not any(table.headings)
    look: Mapping[str, Any] = {"show_header": False, "box": None, "pad_edge": False} if plain else {}
    drawn = TerminalTable(*table.headings, title=table.title or None, **look)
    for row in table.rows:
        drawn.add_row(*row)
    return drawn


@contextmanager
def progress(description: str, total: float) -> Iterator[Callable[[float], None]]:
    """A progress bar on stderr, on a terminal only; yields a function that takes what is done so far."""
    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f}%"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal or quiet.get(),
        transient=True,
    )
    with bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)
