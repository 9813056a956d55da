"""A command, a waveform, a message and a board, added as their pages in docs/ say, and nothing else touched."""

from __future__ import annotations

import json

import h5py
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


@pytest.fixture(scope="module")
def with_waveform(tmp_path_factory):
    tree = copy_tree(tmp_path_factory.mktemp("waveform"), "host/phaselead", "docs/commands.md")
    assert follow("adding-a-waveform.md", tree) == ["host/phaselead/waveforms/trapezoid.py"]
    return tree


def test_an_added_waveform_is_in_the_help_and_the_manual(with_waveform):
    said = with_waveform.run("-m", "phaselead", "track", "--help").stdout
    assert "goto:120um, trapezoid:60um@5Hz," in " ".join(said.split())
    with_waveform.run("-m", "phaselead.report.waveform_table", "docs")
    row = "| `trapezoid:60um@5Hz` | up to 60 um, held, down to 0 and held, a quarter of the period each |\n"
    assert row in with_waveform.text("docs/commands.md")
    said = with_waveform.run("-m", "phaselead", "track", "wiggle:1um", check=False).stderr
    assert said.endswith("goto:120um, trapezoid:60um@5Hz\n")


def test_an_added_waveform_is_tracked(with_waveform, tmp_path):
    run = tmp_path / "run.h5"
    track = ("-m", "phaselead", "track", "trapezoid:60um@2Hz", "--mode", "pid", "--duration", "2", "-o", str(run))
    figures = json.loads(with_waveform.run(*track, "--json", "-").stdout)
    assert figures["range_um"] == pytest.approx(60, abs=1e-3)
    assert figures["max_pct"] < 10
    with h5py.File(run) as file:
        reference_um = file["r_um"][:2500]
    corners = [0, 625, 1250, 1875]
    assert reference_um[corners] == pytest.approx([0, 60, 60, 0], abs=0.2)
    assert reference_um[312] == pytest.approx(30, abs=0.2)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["trapezoid:60um"], "has no frequency; write it as in trapezoid:60um@5Hz"),
        (["trapezoid:300um@1Hz", "--mode", "pid"], "outside what the sensor sees"),
        (["trapezoid:5V@100Hz", "--mode", "open"], "it needs 2000 V/s, the slew limit is 1000 V/s; stay below 50 Hz"),
        (["trapezoid:60um@1Hz", "--mode", "open"], "mode open takes volts"),
    ],
)
def test_an_added_waveform_is_checked_before_anything_moves(with_waveform, words, told):
    stage = ("--model", str(with_waveform.root / "host/phaselead/sim/xyz250.toml"))
    refused = with_waveform.run("-m", "phaselead", "track", *words, *stage, check=False)
    assert refused.returncode == 2
    assert told in refused.stderr
