"""The command ``phaselead``: parse, call the library, print."""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Mapping
from typing import Any

import click

from phaselead import __version__, interrupt
from phaselead.cli.listing import Listed, listed
from phaselead.errors import PhaseleadError


class CommandLine(click.Group):
    """Imports a command's module when the command is run, and turns our errors into one line and a status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(listed(tuple(__path__)))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        found = listed(tuple(__path__)).get(cmd_name)
        if found is None:
            return None
        command: click.Command = getattr(importlib.import_module(f"{__name__}.{found.module}"), found.name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is meant; of a word that is none, the one like it."""
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith("-") and not ctx.resilient_parsing:
            close = difflib.get_close_matches(args[0], names, n=1, cutoff=0.5)
            ctx.fail(f"No such command {args[0]!r}." + (f" Did you mean {close[0]}?" if close else ""))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of `phaselead --help`, without importing the commands."""
        Contents(listed(tuple(__path__))).format_commands(ctx, formatter)

    def invoke(self, ctx: click.Context) -> Any:
        interrupt.install()
        try:
            return super().invoke(ctx)
        except PhaseleadError as error:
            fail(str(error), error.exit_status)
        except KeyboardInterrupt as ended:
            fail("; ".join(["interrupted", *map(str, ended.args)]), 130)
        except BrokenPipeError:
            raise  # whoever read our output has gone: click ends quietly
        except OSError as error:
            fail(f"{error.filename or 'output'}: {error.strerror or error}; check the path and the space left", 2)


class Contents(click.Group):
    """Commands that only say what they are, in their order."""

    def __init__(self, found: Mapping[str, Listed]) -> None:
        super().__init__(commands={name: click.Command(name, help=one.help) for name, one in found.items()})

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


def fail(line: str, status: int) -> None:
    """Prints one line on stderr and leaves with this status."""
    click.echo(f"phaselead: {' '.join(line.split())}", err=True)
    sys.exit(status)


@click.group(cls=CommandLine, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="phaselead")
def main() -> None:
    """Identify, drive and understand piezo stages.

    Every command that talks to a device takes --port; without one it uses $PHASELEAD_PORT or the built-in virtual
    stage, sim://xyz250. Exit status: 0 done, 1 the answer is no (a replay differs), 2 bad input, 3 no usable port,
    4 the device refused or latched a fault.
    """
