"""The manual against the code: commands parse, links resolve, and its tables are those of the code."""

from __future__ import annotations

import ctypes
import re
import shlex
import tomllib
from collections.abc import Iterator
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import click
import pytest

from phaselead.cli import main
from phaselead.device import wire
from phaselead.sim.device import load_library

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGE_NAMES = [page.name for page in PAGES]
PROMPT = "$ "


def text_of(name: str) -> str:
    return (ROOT / "docs" / name).read_text("utf-8")


def parted(text: str) -> tuple[list[str], list[str]]:
    """Lines of code blocks, fenced or indented, and the other lines. A line that goes on is joined to the next."""
    code: list[str] = []
    prose: list[str] = []
    fenced = False
    for line in text.replace("\\\n> ", "").replace("\\\n", "").splitlines():
        if line.startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            code.append(line.strip())
        else:
            prose.append(line)
    return code, prose


def commands_of(line: str) -> Iterator[list[str]]:
    """The words of each `phaselead ...` in a line of shell, pipes, redirections and assignments aside."""
    line = line.removeprefix(PROMPT)
    if not re.match(r"(\w+=\S* )*phaselead ", line):
        return
    lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;<>")
    lexer.whitespace_split = True
    words: list[str] = []
    for word in [*lexer, ";"]:
        if word.strip("|&;<>"):
            words.append(word)
            continue
        while words and re.fullmatch(r"\w+=.*", words[0]):
            words.pop(0)
        if words and words[0] == "phaselead":
            yield words[1:]
        words = []


def commands_in(text: str) -> list[list[str]]:
    return [words for line in parted(text)[0] for words in commands_of(line)]


def parse(words: list[str]) -> str:
    """Parses as the command line would, running nothing; gives the command's name. Raises click.UsageError."""
    command: click.Command = main
    left, path = list(words), ["phaselead"]
    while isinstance(command, click.Group) and left:
        if command.invoke_without_command and left[0] not in command.commands:
            break
        path.append(left.pop(0))
        found = command.get_command(click.Context(command), path[-1])
        if found is None:
            raise click.UsageError(f"{' '.join(path)}: no such command")
        command = found
    command.make_context(path[-1], left)
    return " ".join(path[1:])


def commands_that_exist() -> Iterator[str]:
    for name in main.list_commands(click.Context(main)):
        command = main.get_command(click.Context(main), name)
        if isinstance(command, click.Group):
            yield from (f"{name} {part}" for part in command.list_commands(click.Context(command)))
        else:
            yield name


@pytest.mark.parametrize("page", PAGES, ids=PAGE_NAMES)
def test_every_command_line_parses(page: Path) -> None:
    for words in commands_in(page.read_text("utf-8")):
        try:
            parse(words)
        except click.UsageError as error:
            pytest.fail(f"{page.name}: phaselead {shlex.join(words)}: {error.format_message()}")


def test_every_command_has_an_example() -> None:
    shown = {parse(words) for page in PAGES for words in commands_in(page.read_text("utf-8"))}
    assert set(commands_that_exist()) <= shown


def test_the_gap_workflow_is_wrapped_where_it_is_prose() -> None:
    prose = [line for line in parted(text_of("gap.md"))[1] if not line.startswith(("|", "!["))]
    assert [line for line in prose if len(line) > 120] == []


def slugs(text: str) -> set[str]:
    """The anchors of a page's headings."""
    headings = [line.lstrip("#").strip() for line in parted(text)[1] if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=PAGE_NAMES)
def test_every_link_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", "\n".join(parted(page.read_text("utf-8"))[1])):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.is_file(), f"{page.name}: {link}"
        assert target.is_relative_to(ROOT), f"{page.name}: {link}"
        if anchor:
            assert anchor in slugs(target.read_text("utf-8")), f"{page.name}: {link}"


def named(function: Any) -> list[str]:
    """The names that a function of the firmware library gives for 0, 1, 2 ..."""
    return [name.decode() for name in takewhile(bool, map(function, count()))]


@pytest.fixture(name="library", scope="module")
def _library() -> ctypes.CDLL:
    return load_library()


def test_every_fault_has_its_paragraph(library: ctypes.CDLL) -> None:
    schema = tomllib.loads((ROOT / "protocol/schema.toml").read_text("utf-8"))
    faults = {name: number for name, number in schema["enums"]["fault"]["values"].items() if name != "none"}
    sections = dict(re.findall(r"^## (\w+)\n+(.*?)(?=^## |\Z)", text_of("faults.md"), re.MULTILINE | re.DOTALL))
    assert list(sections) == list(faults)
    for name, number in faults.items():
        paragraph = " ".join(sections[name].split("\n\n")[0].split())
        for word in (
            "Cause: ",
            f"Reaction: `{library.host_fault_reaction(number).decode()}`",
            "What to do: ",
            "host port",
        ):
            assert word in paragraph, f"{name}: {word}"


def rows_under(text: str, first_cell: str) -> list[list[str]]:
    """Cells of the table whose heading begins with this cell, the heading included."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(f"| {first_cell} |"))
    table = takewhile(lambda line: line.startswith("|"), lines[start:])
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in table]
    return [rows[0], *rows[2:]]


def test_the_supervisor_table_is_the_firmwares(library: ctypes.CDLL) -> None:
    states, events = named(library.host_state_name), named(library.host_event_name)
    actions = named(library.host_action_name)
    heading, *rows = rows_under(text_of("firmware.md"), "event")
    assert heading[1:] == states == [state.name.lower() for state in wire.State]
    assert [row[0] for row in rows] == events
    for event, row in enumerate(rows):
        steps = [library.host_transition(state, event) for state in range(len(states))]
        assert row[1:] == [f"{states[step & 255]}, {actions[step >> 8]}" for step in steps]


def numbers(cell: str) -> list[float]:
    return [float(part) for part in cell.split(",")]


def parameters(axis: dict[str, Any]) -> dict[str, list[float]]:
    """Every number of an axis of a stage file, by the name that the page gives it."""
    parts: list[tuple[str, dict[str, Any]]] = [(name, part) for name, part in axis.items() if name != "effects"]
    parts += [(effect["name"], effect["params"]) for effect in axis["effects"]]
    found = {f"{name}.{key}": value for name, part in parts for key, value in part.items()}
    return {name: value if isinstance(value, list) else [value] for name, value in found.items()}


def test_the_built_in_stage_is_as_the_page_says() -> None:
    stage = tomllib.loads((ROOT / "host/phaselead/sim/xyz250.toml").read_text("utf-8"))
    heading, *rows = rows_under(text_of("xyz250.md"), "parameter")
    assert heading[1:] == list(stage["axes"])
    for column, axis in enumerate(heading[1:], start=1):
        assert {row[0]: numbers(row[column]) for row in rows} == parameters(stage["axes"][axis])
    _, *coupling = rows_under(text_of("xyz250.md"), "responding")
    assert [[float(cell) for cell in row[1:]] for row in coupling] == stage["cross_coupling"]


def test_every_test_that_a_promise_names_is_there():
    text = text_of("promises.md")
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text)
    assert len(named) > 30
    for path, test in named:
        assert (ROOT / path).is_file(), path
        assert f"def {test}" in (ROOT / path).read_text(), f"{path}::{test}"


def test_every_promise_names_a_test():
    rows = [line for line in text_of("promises.md").splitlines() if line.startswith("| ")]
    headings = ("| what may happen |", "| question |", "| mutant |", "| `core/", "| `app/")
    assert [row for row in rows if "`tests/" not in row and not row.startswith(headings)] == []
