"""What a command reads and writes, as types of its options, and the one rule for what it writes.

Before a command does anything, an output is refused that could not be written in the end, that is one of the inputs or
another output, and, without --overwrite, that exists.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any, TypeVar, cast

import click
from click.shell_completion import CompletionItem

from phaselead.errors import BadInput

F = TypeVar("F", bound=Callable[..., Any])
OVERWRITE = "overwrite"


class NamedFile(click.ParamType[str]):
    """A file by its name, which the shell completes."""

    name = "file"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(incomplete, type="file")]


class InputFile(NamedFile):
    """What a command reads."""

    def file_of(self, argument: str) -> str:
        return argument


class InputRecord(InputFile):
    """A recording, perhaps with a window: rec.csv@5:7."""

    def file_of(self, argument: str) -> str:
        from phaselead.record import split_argument

        return split_argument(argument)[0]


class OutputFile(NamedFile):
    """What a command writes. ``suffixes`` are those of the format that is written; none: any. ``stdout``: whether "-"
    is the standard output."""

    def __init__(self, *suffixes: str, stdout: bool = False) -> None:
        self.suffixes, self.stdout = suffixes, stdout


INPUT, RECORD = InputFile(), InputRecord()


def json_option(command: F) -> F:
    """--json and --overwrite, which every command has; what it is to write is looked at before it is run."""

    @wraps(command)
    def looked_at(*arguments: Any, **named: Any) -> Any:
        check_named(click.get_current_context())
        return command(*arguments, **named)

    over = click.option(
        "--overwrite",
        is_flag=True,
        expose_value=False,
        help="Write over outputs that exist.",
        callback=lambda context, _option, given: context.meta.update({OVERWRITE: given}),
    )
    figures = click.option(
        "--json",
        "json_to",
        metavar="F",
        type=OutputFile(stdout=True),
        help="Also write the figures as JSON to F; - is stdout.",
    )
    return cast(F, figures(over(looked_at)))


report_option = click.option(
    "--report", metavar="F.html", type=OutputFile(".html", ".htm"), help="Also write a page with figures."
)


def overwriting() -> bool:
    """Whether the command that runs may write over what exists."""
    return bool(click.get_current_context().meta.get(OVERWRITE))


def check_named(context: click.Context) -> None:
    """Raises BadInput for outputs on the command line that cannot or must not be written."""
    given = list(_given(context))
    if not given:
        return
    from phaselead.record import check_output, is_special  # brings numpy, which status need not wait for

    inputs = [kind.file_of(path) for kind, path in given if isinstance(kind, InputFile)]
    written: set[str] = set()
    for kind, path in given:
        if not isinstance(kind, OutputFile) or (path == "-" and kind.stdout):
            continue
        if path == "-":
            raise BadInput("-: only --json writes to the standard output with it; give a file name")
        check_output(path, suffixes=kind.suffixes, inputs=inputs, overwrite=overwriting())
        place = os.path.realpath(path)
        if place in written and not is_special(path):
            raise BadInput(f"{path}: is to hold two outputs at once; give each a name of its own")
        written.add(place)


def _given(context: click.Context) -> Iterator[tuple[NamedFile, str]]:
    """Every file that was named, with the type of its option."""
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if isinstance(parameter.type, NamedFile) and value is not None:
            for path in value if isinstance(value, tuple) else (value,):
                yield parameter.type, path
