"""phaselead scope: what it refuses before it opens anything."""

from __future__ import annotations

import importlib


def test_the_command_says_what_is_wrong_before_it_opens_anything(run, tmp_path):
    (tmp_path / "kept").write_text("no folder")
    refused = run("scope", "--out", str(tmp_path / "kept"), "--no-browser")
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "no folder can be made there" in refused.err
    assert run("scope", "--park-after", "-1", "--no-browser").status == 2


def test_the_folder_for_what_the_page_saves_is_made(run, tmp_path, monkeypatch):
    def served(*_given, **_how):
        raise KeyboardInterrupt

    monkeypatch.setattr(importlib.import_module("phaselead.scope.server"), "Hub", served)
    run("scope", "--out", str(tmp_path / "day" / "kept"), "--no-browser")
    assert (tmp_path / "day" / "kept").is_dir()
