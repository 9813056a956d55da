"""The demo: its page tells what its commands print, from files that are there; a second one asks first."""

from __future__ import annotations

import hashlib
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

from phaselead.cli import main
from phaselead.report.demo import ANEW, FROM_FILES


@pytest.fixture(name="folder", scope="module")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "out"
    ended = CliRunner().invoke(main, ["demo", "--out", str(folder)])
    assert ended.exit_code == 0, ended.output
    assert ended.output.splitlines()[-1] == str(folder / "report.html")
    return folder


def test_every_file_is_on_the_page_by_its_hash(folder):
    page = (folder / "report.html").read_text("utf-8")
    files = list(folder.glob("*.h5"))
    assert len(files) >= 9
    for file in files:
        assert f'{file.name} <code title="{hashlib.sha256(file.read_bytes()).hexdigest()}">' in page


def test_its_commands_give_its_numbers(folder, monkeypatch):
    monkeypatch.chdir(folder)
    page = (folder / "report.html").read_text("utf-8")
    rows = 0
    for line in FROM_FILES:
        ended = CliRunner().invoke(main, [*shlex.split(line)[1:], "--json", "found.json", "--overwrite"])
        assert ended.exit_code == 0, line
        for one in re.findall(r'"mean_um": ([\d.]+)', (folder / "found.json").read_text()):
            assert f"<td>{float(one):.3f}</td>" in page, line
            rows += 1
    assert rows == 4


def test_what_it_says_of_a_device_parses(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for line in ANEW:
        program, name, *words = shlex.split(line)
        command = main.get_command(None, name)
        if name == "log":
            command, words = command.get_command(None, words[0]), words[1:]
        assert program == "phaselead"
        command.make_context(name, words)


def test_an_interrupted_demo_leaves_no_empty_folder(tmp_path, monkeypatch):
    def interrupted(*_arguments, **_named):
        raise KeyboardInterrupt

    monkeypatch.setattr(import_module("phaselead.demo"), "identify_device", interrupted)
    for folder, left in ((tmp_path / "new", False), (tmp_path / "mine", True)):
        if left:
            folder.mkdir()
        assert CliRunner().invoke(main, ["demo", "--out", str(folder)]).exit_code == 130
        assert folder.exists() is left


def test_an_earlier_demo_is_not_written_over(folder):
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    ended = CliRunner().invoke(main, ["demo", "--out", str(folder)])
    assert ended.exit_code == 2
    assert "--overwrite" in ended.output
    assert {file.name: file.stat().st_mtime_ns for file in folder.iterdir()} == before


def test_it_does_not_mix_its_files_into_a_folder_of_others(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    ended = CliRunner().invoke(main, ["demo", "--out", str(tmp_path)])
    assert ended.exit_code == 2
    assert ended.stderr.count("\n") == 1
    assert "holds notes.txt, and the demo keeps" in ended.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
