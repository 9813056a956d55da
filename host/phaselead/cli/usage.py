"""What a command says on the standard error: refusals in one line that says what to do next, and warnings."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import click
from click.exceptions import NoArgsIsHelpError


def fail(line: str, status: int) -> None:
    """Prints one line on stderr and leaves with this status."""
    click.echo(f"phaselead: {' '.join(line.split())}", err=True)
    sys.exit(status)


@contextmanager
def usage_in_one_line() -> Iterator[None]:
    """Ends the program with that line. A group without a command still shows its help."""
    try:
        yield
    except NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        if error.ctx is not None and error.ctx.resilient_parsing:
            raise
        fail(usage_line(error), error.exit_code)


def usage_line(error: click.UsageError) -> str:
    """What is wrong, the words that may have been meant, and where help is."""
    said, close = error.format_message(), list(getattr(error, "possibilities", None) or ())
    said = said.partition(" (Did you mean")[0].partition(" Did you mean")[0].rstrip(".")
    if close:
        said += f", did you mean {' or '.join(close)}?"
    elif not said.endswith("?"):
        said += ";"
    words = [] if error.ctx is None else error.ctx.command_path.split()[1:]
    return f"{said[:1].lower()}{said[1:]} `{' '.join(('phaselead', *words, '--help'))}` shows the way"


def warn(lines: Iterable[str]) -> None:
    """Each on the standard error."""
    for line in lines:
        click.echo(f"warning: {line}", err=True)


@contextmanager
def warnings_said() -> Iterator[None]:
    """What the library warns of meanwhile is said at once and once, before what it warns of happens."""

    told: set[str] = set()
    shown_otherwise = warnings.showwarning

    def said(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if not issubclass(category, UserWarning):  # none of ours
            shown_otherwise(message, category, *where, **more)
        elif str(message) not in told:
            warn([str(message)])
            told.add(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = said
        yield
