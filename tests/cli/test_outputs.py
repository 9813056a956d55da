"""What commands write: one rule for every option of every command, and one line for what makes no sense."""

from __future__ import annotations

import click
import pytest

from phaselead.cli import main
from phaselead.cli.examples import EXAMPLES
from phaselead.cli.outputs import InputFile, NamedFile, OutputFile

MINE = "mine"


def command_of(words: str) -> click.Command:
    found: click.Command = main
    for word in words.split():
        assert isinstance(found, click.Group)
        below = found.get_command(click.Context(found), word)
        assert below is not None
        found = below
    return found


def outputs(words: str) -> list[click.Parameter]:
    return [one for one in command_of(words).params if isinstance(one.type, OutputFile)]


WRITTEN = [(words, one.name) for words in sorted(EXAMPLES) for one in outputs(words)]


def line(words: str, wanted: click.Parameter, path: str) -> list[str]:
    """A command line that gives what must be given, and this output."""
    given, last = words.split(), []
    for one in command_of(words).params:
        value = path if one is wanted else "bash" if isinstance(one.type, click.Choice) else "not-there.x"
        if not (one is wanted or one.required):
            continue
        if isinstance(one.type, OutputFile) and one is not wanted:
            value = f"free{(*one.type.suffixes, '')[0]}"
        if isinstance(one, click.Option):
            given += [max(one.opts, key=len), value]
        else:
            last.append(value)
    return given + last


def test_every_command_writes_figures_and_none_is_left_out():
    assert {words for words, name in WRITTEN if name == "json_to"} == set(EXAMPLES)
    assert {("track", "output"), ("gap", "report"), ("log export", "output"), ("plot", "output")} <= set(WRITTEN)


@pytest.mark.parametrize(("words", "name"), WRITTEN)
def test_what_exists_is_kept(run, tmp_path, monkeypatch, words, name):
    """No port, no input and no other output is looked at before."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PHASELEAD_PORT", "/dev/not-there")
    (wanted,) = [one for one in outputs(words) if one.name == name]
    path = tmp_path / f"there{(*wanted.type.suffixes, '')[0]}"
    path.write_text(MINE)
    outcome = run(*line(words, wanted, str(path)))
    assert (outcome.status, outcome.error, outcome.err.count("\n")) == (2, None, 1), outcome
    assert "exists already" in outcome.err
    assert "--overwrite" in outcome.err
    assert path.read_text() == MINE


def test_what_exists_is_written_over_where_that_is_said(run, tmp_path):
    path = tmp_path / "there.json"
    path.write_text(MINE)
    assert run("ports", "--json", path, "--overwrite").status == 0
    assert path.read_text() != MINE


def test_every_file_on_a_command_line_is_known_for_one():
    """An option that is named like a file and is none would be neither checked nor completed."""
    for words in EXAMPLES:
        for one in command_of(words).params:
            shape = (one.metavar or "").rpartition(".")[2]
            if shape in ("toml", "h5", "html", "csv", "json", "..") or one.name == "model_path":
                assert isinstance(one.type, NamedFile), (words, one.name)


def test_inputs_complete_as_files():
    (model,) = [one for one in command_of("track").params if one.name == "model_path"]
    assert isinstance(model.type, InputFile)
    (item,) = model.type.shell_complete(click.Context(command_of("track")), model, "sta")
    assert (item.value, item.type) == ("sta", "file")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("track",), ("missing argument 'WAVE'", "`phaselead track --help`")),
        (("track", "sine:60um@5Hz", "--gain", "1"), ("'--gain', did you mean --gains", "`phaselead track --help`")),
        (("trak",), ("'trak', did you mean track?", "`phaselead --help`")),
        (("log", "recor"), ("did you mean record", "`phaselead log --help`")),
        (("--bogus",), ("no such option '--bogus'", "`phaselead --help`")),
        (("move", "x=5um", "y=5um"), ("unexpected extra argument (y=5um)", "`phaselead move --help`")),
        (("learn", "sine:3um@5Hz", "--model", "m.toml", "--trials", "0"), ("0 is not in the range", "--help`")),
    ],
)
def test_a_usage_error_is_one_line_that_names_the_help(run, words, said):
    outcome = run(*words)
    assert (outcome.status, outcome.out, outcome.err.count("\n")) == (2, "", 1), outcome
    assert outcome.err.startswith("phaselead: ")
    for part in said:
        assert part in outcome.err


def test_a_group_alone_shows_its_help(run):
    assert "record" in run("log").err


def test_brackets_are_printed_as_they_are(run, tmp_path):
    """They were taken for the markup of the library that draws tables: units vanished, and [/x] was an error."""
    path = tmp_path / "rig.txt"
    rows = "\n".join(f"{i * 0.001:.3f} {i % 50} {i % 49}" for i in range(200))
    path.write_text(f"t[s] U[V] x[/um]\n{rows}\n")
    outcome = run("log", "import", path, "--map", "t_s=1,u_V=2,x_um=3")
    assert (outcome.status, outcome.error) == (0, None), outcome
    assert "x[/um]" in outcome.out
