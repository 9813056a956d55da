"""The command ``phaselead``: parse, call the library, print."""

from __future__ import annotations

import difflib
import importlib
from typing import Any

import click
from click.shell_completion import CompletionItem

from phaselead import __version__, interrupt
from phaselead.cli.examples import START, show_examples
from phaselead.cli.listing import GROUPS, listed
from phaselead.cli.output_level import QUIET, quiet
from phaselead.cli.usage import fail, usage_in_one_line, warnings_said
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
        show_examples(cmd_name, command)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """--quiet may stand anywhere."""
        end = args.index("--") if "--" in args else len(args)
        quiet.set(QUIET in args[:end])
        with usage_in_one_line():
            return super().parse_args(ctx, [word for i, word in enumerate(args) if word != QUIET or i > end])

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is meant; of a word that is none, the one like it."""
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith("-") and not ctx.resilient_parsing:
            close = difflib.get_close_matches(args[0], names, n=1, cutoff=0.5)
            ctx.fail(f"no such command {args[0]!r}" + (f", did you mean {close[0]}?" if close else ""))
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """The names of the commands without importing them; options as ever."""
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        found = listed(tuple(__path__))
        short = {name: click.Command(name, help=one.help).get_short_help_str() for name, one in found.items()}
        return [CompletionItem(name, help=short[name]) for name in found if name.startswith(incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of `phaselead --help`, by what the commands are about, without importing them."""
        found = listed(tuple(__path__))
        width = max(map(len, found))
        for group, heading in GROUPS.items():
            lines = [
                (name.ljust(width), click.Command(name, help=one.help).get_short_help_str(formatter.width - width - 6))
                for name, one in found.items()
                if one.group == group
            ]
            if lines:
                with formatter.section(heading):
                    formatter.write_dl(lines)

    def invoke(self, ctx: click.Context) -> Any:
        interrupt.install()
        try:
            with usage_in_one_line(), warnings_said():
                return super().invoke(ctx)
        except PhaseleadError as error:
            fail(str(error), error.exit_status)
        except KeyboardInterrupt as ended:
            fail("; ".join(["interrupted", *map(str, ended.args)]), 130)
        except BrokenPipeError:
            raise  # whoever read our output has gone: click ends quietly
        except OSError as error:
            fail(f"{error.filename or 'output'}: {error.strerror or error}; check the path and the space left", 2)


@click.group(cls=CommandLine, context_settings={"help_option_names": ["-h", "--help"]}, epilog=START)
@click.option(QUIET, is_flag=True, expose_value=False, help="Print nothing but warnings, errors and --json -.")
@click.version_option(__version__, prog_name="phaselead")
def main() -> None:
    """Identify, drive and understand piezo stages.

    Every command that talks to a device takes --port; without one it uses $PHASELEAD_PORT or the built-in virtual
    stage, sim://xyz250. Exit status: 0 done, 1 the answer is no (a replay differs), 2 bad input, 3 no usable port,
    4 the device refused or latched a fault.
    """
