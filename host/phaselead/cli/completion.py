"""completion: what a shell needs to complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from phaselead.cli.common import emit, json_option
from phaselead.cli.listing import top_level

SHELLS = ("bash", "zsh", "fish")


@top_level(order=200, group="start")
@click.command()
@click.argument("shell", type=click.Choice(SHELLS))
@json_option
def completion(shell: str, json_to: str | None) -> None:
    """Print what makes bash, zsh or fish complete commands and options.

    bash and zsh: add eval "$(phaselead completion bash)" to ~/.bashrc, the same with zsh to ~/.zshrc. fish: phaselead
    completion fish > ~/.config/fish/completions/phaselead.fish
    """
    from phaselead.cli import main

    found = get_completion_class(shell)
    assert found is not None
    script = found(main, {}, "phaselead", "_PHASELEAD_COMPLETE").source()
    emit({"shell": shell, "script": script}, json_to, [])
    if json_to != "-":
        click.echo(script)
