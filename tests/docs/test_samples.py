"""Samples of the manual are run: what is printed is what the page shows, numbers aside."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner, Result

from phaselead.cli import main
from phaselead.device import wire

PAGE = (Path(__file__).parents[2] / "docs" / "commands.md").read_text("utf-8")
STATUS = "; echo $?"
LEFT_OUT = "..."
RUN = (
    "identify -o stage.toml --save",
    "track sine:60um@5Hz --model stage.toml --mode ff+pid",
    "track x=sine:60um@5Hz,y=sine:30um@10Hz",
    "track sine:60um@5Hz --model stage.toml --mode pid --gains",
    "track sine:60um@30Hz",
    "move x=60um --duration",
    "upload",
    "status",
    "info",
    "doctor",
    "explain",
    "limits",
    "track sine:9V@5Hz",
    "log record --drive sine:5V@5Hz --duration 1",
    "log export",
    "log info",
    "track sine:60um@5Hz --mode pid --gains",
    "log faults",
    "replay",
)
"""Of the samples those that need no other program and take no more than seconds, in the order of the page."""


class Sample(NamedTuple):
    """A command as the page shows it, and what it prints."""

    words: list[str]
    shown: list[str]
    status: int


def samples() -> list[Sample]:
    found: list[Sample] = []
    for block in re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            line, *shown = part.rstrip("\n").split("\n")
            command = line.removesuffix(STATUS).removeprefix("phaselead ")
            status = int(shown.pop()) if line.endswith(STATUS) else 0
            alone = line.startswith("phaselead ") and not re.search("[|&>]|/dev/|--port [.]/", line)
            if alone and command.startswith(RUN):
                found.append(Sample(shlex.split(command), shown, status))
    return found


def like(lines: list[str]) -> str:
    """Text in which numbers, and how wide a table is for them, are nothing."""
    text = re.sub(r"[━─┃│┏┳┓┡╇┩┼├┤└┴┘]+", "|", " ".join(lines))
    text = re.sub(r"\b[0-9a-f]{8,64}\b|[-+]?\d[\d.]*(e[-+]?\d+)?", "#", text)
    return " ".join(text.split())


@pytest.fixture(name="printed", scope="module")
def _printed(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Sample, Result]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        return [(sample, CliRunner().invoke(main, sample.words)) for sample in samples()]


def test_what_is_printed_is_what_the_page_shows(printed: list[tuple[Sample, Result]]) -> None:
    assert len(printed) >= len(RUN)
    for sample, result in printed:
        said, at = like((result.stderr + result.stdout).splitlines()), 0
        whole = "\n".join(sample.shown)
        for part in whole.split(f"{LEFT_OUT}\n") if whole else []:
            wanted = like(part.removesuffix(LEFT_OUT).splitlines())
            found = said.find(wanted, at)
            assert found >= 0, f"phaselead {shlex.join(sample.words)}\nshown: {wanted}\nprinted: {said[at:]}"
            at = found + len(wanted)


def test_it_ends_with_the_status_that_the_page_shows(printed: list[tuple[Sample, Result]]) -> None:
    for sample, result in printed:
        faulted = any(line.startswith("phaselead: ") for line in sample.shown)
        assert (result.exit_code != 0) == (faulted or sample.status != 0), sample.words
        assert sample.status in (0, result.exit_code), sample.words


def test_the_wire_is_that_of_the_code() -> None:
    assert f"wire               {wire.VERSION}.{wire.REVISION}\n" in PAGE
    assert f"wire fingerprint   {wire.FINGERPRINT:08x}\n" in PAGE


@pytest.mark.parametrize(
    ("words", "section"),
    [
        ("status", "status, info, ports"),
        ("info", "status, info, ports"),
        ("doctor", "doctor"),
        ("explain host_timeout", "explain"),
        ("limits", "limits"),
        ("park", "arm, park, stop"),
        ("where", "move, hold, where"),
        ("track sine:20um@5Hz --mode pid --duration 0.2", "track"),
        ("log faults", "log"),
    ],
)
def test_every_field_of_its_json_is_on_the_page(words: str, section: str) -> None:
    found: dict[str, Any] = json.loads(CliRunner().invoke(main, [*shlex.split(words), "--json", "-"]).stdout)
    text = PAGE[PAGE.index(f"\n### {section}\n") :].split("\n### ")[1]
    text += PAGE[PAGE.index("\n### status, info, ports\n") :].split("\n### ")[1] if "that of `status`" in text else ""
    for name in found:
        assert f"`{name}`" in text or f'"{name}"' in text, name
