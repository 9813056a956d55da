"""The list of commands is read from the sources, and is true of what they define."""

from __future__ import annotations

import subprocess
import sys

import click
import pytest

from phaselead.cli import listing, main

CONTEXT = click.Context(main)
COMMANDS = main.list_commands(CONTEXT)


def test_the_list_begins_with_the_story_and_has_every_command_once():
    assert COMMANDS[:5] == ["demo", "identify", "fit", "verify", "predict"]
    assert len(COMMANDS) == len(set(COMMANDS)) >= 19


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_what_its_source_says(name):
    command = main.get_command(CONTEXT, name)
    assert command is not None
    assert command.name == name
    summary = command.get_short_help_str(200)
    assert summary in " ".join(whole_help().split())


def whole_help() -> str:
    with click.Context(main, terminal_width=400, max_content_width=400) as context:
        return main.get_help(context)


def test_there_is_no_other_command():
    assert main.get_command(CONTEXT, "levitate") is None


def test_listing_imports_no_command():
    code = (
        "import sys\nfrom click.testing import CliRunner\nfrom phaselead.cli import main\n"
        "assert CliRunner().invoke(main, ['--help']).exit_code == 0\n"
        "print(*[m for m in sys.modules if m.startswith('phaselead.') or m == 'numpy'])"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    light = {"cli", "cli.examples", "cli.listing", "cli.output_level", "cli.usage", "errors", "interrupt", "version"}
    assert set(loaded) == {f"phaselead.{name}" for name in light}


def test_marks_are_read_as_they_are_written(tmp_path):
    (tmp_path / "two.py").write_text(
        "@top_level()\n@click.command()\ndef late_one():\n    '''Late. Very.'''\n\n"
        "@top_level(order=5)\n@click.command()\ndef early(): ...\n\n"
        "@click.command()\ndef unmarked(): ...\n"
    )
    (tmp_path / "none.py").write_text("def early(): ...\n")
    found = listing.listed((str(tmp_path),))
    assert list(found) == ["early", "late-one"]
    assert found["late-one"] == (listing.LAST, "late_one", "two", "Late. Very.", listing.USUAL_GROUP)
