"""What `tune` writes, and what it refuses to write over, before anything moves."""

from __future__ import annotations

import pytest


def refused(outcome) -> str:
    assert (outcome.status, outcome.error, outcome.err.count("\n")) == (2, None, 1), outcome
    return outcome.err


def test_a_stage_file_that_exists_is_kept(run, tmp_path):
    there = tmp_path / "there.toml"
    there.write_text("mine")
    assert "--overwrite" in refused(run("tune", "--port", "sim://xyz250", "-o", there))
    assert there.read_text() == "mine"


@pytest.mark.parametrize("option", ["--json", "--report"])
def test_one_file_is_not_two_outputs(run, tmp_path, option):
    name = tmp_path / ("out.toml" if option == "--json" else "out.html")
    said = refused(run("tune", "--port", "sim://xyz250", "-o", tmp_path / "out.toml", option, name, "--json", name))
    assert "two outputs at once" in said
    assert not list(tmp_path.iterdir())
