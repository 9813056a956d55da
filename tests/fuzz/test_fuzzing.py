"""What `make fuzz` says where it cannot."""

from __future__ import annotations

import sys

import pytest

import fuzz


@pytest.mark.parametrize(("arguments", "status"), [([], 2), (["--those-installed"], 0)])
def test_a_missing_fuzzer_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], status: int
) -> None:
    monkeypatch.setattr(fuzz, "command_of", lambda target: None)
    monkeypatch.setattr(sys, "argv", ["fuzz.py", *arguments])
    monkeypatch.delenv("CI", raising=False)
    assert fuzz.main() == status
    said = capsys.readouterr().err
    assert said.count("\n") == 1 + (status == 0)
    assert ("LEFT OUT: fuzzing of the device" in said) == (status == 0)
    assert "apt install" in said
    assert "requirements-fuzz.lock" in said
