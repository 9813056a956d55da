"""A check that leaves something out says so, and fails where CI could have had the tool."""

from __future__ import annotations

import shutil
import sys

import pytest

import coverage_of_c
import left_out
import static_analysis


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A machine without any optional tool, its packages on offer."""
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(left_out, "apt_offers", lambda package: True)
    monkeypatch.delenv("CI", raising=False)
    return monkeypatch


def test_static_analysis_says_what_is_left_out_and_fails_in_ci(
    bare: pytest.MonkeyPatch, tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare.setattr(static_analysis, "NEWLIB", tmp_path / "none")
    bare.setattr(static_analysis, "run", lambda command: (True, ""))
    assert static_analysis.main() == 0
    said = capsys.readouterr().err
    assert said.count("LEFT OUT: ") == 2
    assert "sudo apt install cppcheck" in said
    bare.setenv("CI", "true")
    assert static_analysis.main() == 1
    bare.setattr(left_out, "apt_offers", lambda package: False)
    assert static_analysis.main() == 0


@pytest.mark.parametrize(("ci", "status"), [("", 0), ("true", 1)])
def test_branch_coverage_says_that_gcov_is_missing(
    bare: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ci: str, status: int
) -> None:
    bare.setenv("CI", ci)
    bare.setattr(sys, "argv", ["coverage_of_c.py"])
    assert coverage_of_c.main() == status
    assert "LEFT OUT: branch coverage of firmware/core and firmware/app; needs gcc" in capsys.readouterr().err


def test_what_apt_offers_is_read_from_its_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    class Said:
        stdout = ""

    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(left_out.subprocess, "run", lambda *_, **__: Said)
    for policy, offered in (
        ("cppcheck:\n  Installed: (none)\n  Candidate: 2.10-2\n", True),
        ("cppcheck:\n  Installed: (none)\n  Candidate: (none)\n", False),
        ("", False),
    ):
        Said.stdout = policy
        assert left_out.apt_offers("cppcheck") == offered
