"""A command, a waveform, a message and a board, added as their pages in docs/ say, and nothing else touched."""

from __future__ import annotations

import json

import pytest
from worked_example import copy_tree, follow


@pytest.fixture(scope="module")
def with_command(tmp_path_factory):
    tree = copy_tree(tmp_path_factory.mktemp("command"), "host/phaselead")
    before = tree.run("-m", "phaselead", "--help").stdout
    assert follow("adding-a-command.md", tree) == ["host/phaselead/cli/where.py"]
    return tree, before


def test_an_added_command_is_the_last_of_the_list(with_command):
    tree, before = with_command
    line = "  where     Print where every axis stands, and its output.\n"
    assert tree.run("-m", "phaselead", "--help").stdout == before + line


def test_an_added_command_runs(with_command):
    tree, _ = with_command
    assert "Nothing moves." in tree.run("-m", "phaselead", "where", "--help").stdout
    said = json.loads(tree.run("-m", "phaselead", "where", "--json", "-").stdout)
    assert list(said) == ["x", "y", "z"]
    assert all(" um at 0.000 V" in place for place in said.values())
    refused = tree.run("-m", "phaselead", "where", "--port", "sim://nowhere.toml", check=False)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
