"""The command ``phaselead``: parse, call the library, print."""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path
from typing import Any

import click

from phaselead import __version__, interrupt
from phaselead.errors import PhaseleadError

# Loaded when called: importing the numerical libraries costs more than most of these commands.
COMMANDS = {
    "demo": "phaselead.cli.demo:demo",
    "identify": "phaselead.cli.model:identify",
    "fit": "phaselead.cli.model:fit",
    "verify": "phaselead.cli.model:verify",
    "predict": "phaselead.cli.model:predict",
    "upload": "phaselead.cli.device:upload",
    "track": "phaselead.cli.track:track",
    "arm": "phaselead.cli.device:arm",
    "park": "phaselead.cli.device:park",
    "stop": "phaselead.cli.device:stop",
    "status": "phaselead.cli.device:status",
    "info": "phaselead.cli.device:info",
    "ports": "phaselead.cli.ports:ports",
    "log": "phaselead.cli.log:log",
    "replay": "phaselead.cli.log:replay",
    "gap": "phaselead.cli.gap:gap",
    "sim": "phaselead.cli.sim:sim",
    "flash": "phaselead.cli.board:flash",
    "selftest": "phaselead.cli.board:selftest",
}


def summary(command: str, longest: int) -> str:
    """What a command does, in at most ``longest`` characters: its docstring, read from its file as text."""
    module, function = COMMANDS[command].split(":")
    source = ast.parse((Path(__file__).parent / f"{module.rpartition('.')[2]}.py").read_text(encoding="utf-8"))
    written = next(node for node in source.body if isinstance(node, ast.FunctionDef) and node.name == function)
    return click.Command(command, help=ast.get_docstring(written)).get_short_help_str(longest)


class LazyGroup(click.Group):
    """Imports a command's module when the command is looked up, and turns our errors into one line and a status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name].split(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands with a line each, without loading them."""
        room = formatter.width - 6 - max(map(len, COMMANDS))
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary(name, room)) for name in COMMANDS])

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


def fail(line: str, status: int) -> None:
    """Prints one line on stderr and leaves with this status."""
    click.echo(f"phaselead: {' '.join(line.split())}", err=True)
    sys.exit(status)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="phaselead")
def main() -> None:
    """Identify, drive and understand piezo stages.

    Every command that talks to a device takes --port; without one it uses $PHASELEAD_PORT or the built-in virtual
    stage, sim://xyz250. Exit status: 0 done, 1 the answer is no (a replay differs), 2 bad input, 3 no usable port,
    4 the device refused or latched a fault.
    """
