"""A run for which there is no room is refused before anything moves, in one line with its size."""

from __future__ import annotations

import os
import shutil
from collections import namedtuple

import pytest
from click.testing import CliRunner

import phaselead as pl
from phaselead.cli import main
from phaselead.device import Device

Usage = namedtuple("Usage", "total used free")


@pytest.fixture(autouse=True)
def _nothing_runs(monkeypatch):
    def capture(*_arguments, **_named):
        raise AssertionError("it ran")

    monkeypatch.setattr(Device, "capture", capture)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("track sine:20um@5Hz --mode pid --gains paper --duration 1e9", "a run of 1e+09 s takes 4e+05 GB of memory"),
        ("log record -o run.h5 --duration 1e12", "a run of 1e+12 s takes up to 8e+07 GB of the disk"),
        (
            "log record -o run.h5 --drive sine:5V@5Hz --duration 1e12",
            "a run of 1e+12 s takes up to 8e+07 GB of the disk",
        ),
    ],
)
def test_more_than_there_is(words, said, tmp_path, monkeypatch):
    """No memory for 5000000025000 true positions, and a disk that filled."""
    monkeypatch.chdir(tmp_path)
    ran = CliRunner().invoke(main, words.split())
    assert ran.exit_code == 2
    assert said in ran.stderr
    assert "choose a shorter duration" in ran.stderr
    assert ran.stderr.count("\n") == 1
    assert os.listdir() == []


def test_of_python_too(tmp_path, monkeypatch):
    with pl.connect() as dev:
        with pytest.raises(pl.BadInput, match="of memory"):
            dev.record(duration=1e9)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1e12, 1e12, 1e6))
        with pytest.raises(pl.BadInput, match=r"takes up to 0\.004 GB of the disk, 0\.001 GB are free"):
            dev.track("sine:20um@5Hz", mode="pid", gains="paper", duration=50, output=tmp_path / "run.h5")


def test_how_much_it_takes_is_said_beforehand(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1e12, 0, 1e12))
    ran = CliRunner().invoke(main, ["log", "record", "-o", str(tmp_path / "run.h5"), "--duration", "10000"])
    assert "recording 10000 s takes up to 0.8 GB of the disk" in ran.stdout
