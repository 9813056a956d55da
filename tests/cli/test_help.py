"""Help, examples, completion and quiet: what a newcomer types first."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator

import click
import pytest

from phaselead.cli import main
from phaselead.cli.completion import SHELLS
from phaselead.cli.examples import EXAMPLES
from phaselead.cli.listing import GROUPS


def test_the_list_is_in_groups(run):
    said = run("--help").out
    places = [said.index(f"{heading}:\n") for heading in GROUPS.values()]
    assert places == sorted(places)
    assert said.index("  fit ") < said.index("Device:") < said.index("  track ") < said.index("Records:")
    for name in main.list_commands(click.Context(main)):
        assert f"\n  {name} " in said


def parsed(words: list[str]) -> None:
    """Raises click.UsageError for what the command line would refuse."""
    command: click.Command = main
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(click.Context(command), words[0])
        assert found is not None, words
        command, words = found, words[1:]
    command.make_context("phaselead", words)


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_shown_and_would_run(run, name):
    said = run(*name.split(), "--help").out
    for line in EXAMPLES[name]:
        assert f"  phaselead {line}\n" in said
        words = shlex.split(line)
        parsed(words[: words.index(">>")] if ">>" in words else words)


def named(command: click.Command, name: str = "") -> Iterator[str]:
    """Every command below this one, by its words; a group only where it does something by itself."""
    context = click.Context(command)
    if name and not (isinstance(command, click.Group) and command.no_args_is_help):
        yield name
    for below in command.list_commands(context) if isinstance(command, click.Group) else ():
        found = command.get_command(context, below)
        assert found is not None
        yield from named(found, f"{name} {below}".strip())


def test_every_command_has_examples():
    names = set(named(main))
    assert {"log record", "gap", "gap next", "track"} <= names
    assert names == set(EXAMPLES)


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_of_every_shell(run, shell):
    said = run("completion", shell).out
    assert f"_PHASELEAD_COMPLETE={shell}_complete" in said


def completed(shell: str, words: str, at: int) -> list[str]:
    """What the program answers to the script of a shell."""
    asked = {"COMP_WORDS": words, "COMP_CWORD": words.split()[-1] if shell == "fish" else str(at)}
    done = subprocess.run(
        [sys.executable, "-m", "phaselead"],
        env={**os.environ, **asked, "_PHASELEAD_COMPLETE": f"{shell}_complete"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.parametrize("shell", SHELLS)
def test_commands_options_and_choices_complete(shell):
    assert any("track" in word for word in completed(shell, "phaselead tra", 1))
    assert any("--model" in word for word in completed(shell, "phaselead track --mod", 2))
    assert any("inverse+pid" in word for word in completed(shell, "phaselead track --mode inv", 3))


def test_quiet_keeps_to_itself_what_is_for_people(run, tmp_path):
    words = ("track", "sine:20um@5Hz", "--mode", "pid", "--duration", 0.1)
    for place in (("--quiet", *words), (*words, "--quiet")):
        outcome = run(*place)
        assert (outcome.status, outcome.out, outcome.err) == (0, "", "")
    assert run("--quiet", *words, "--json", "-").json["mode"] == "pid"
    assert run("--quiet", "track", "sine:60um@5Hz").err.startswith("phaselead: ")
    assert run(*words).out
